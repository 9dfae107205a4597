"""Layouts become geometries with the designer's numbers, and geometries become layouts."""

import os
import re
import signal
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import ezdxf
import gdstk
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import femnl
from femnl.core.device import Model
from femnl.core.errors import GeometryError, MissingLibraryError, ParameterError
from femnl.device.geometry import curves, load
from femnl.device.layout import (
    Imported,
    export_layout,
    import_layout,
    read_layers,
    read_metal,
)
from femnl.device.layout.apart import apart
from femnl.device.layout.recognise import circle_of, recognise
from femnl.device.mesh import mesh
from tests.unit.layouts import box, circle, from_points, trampoline, write

LAYERS = "film=1/0,release=3/0,holes=2/0"
LIKE = "square-270um"


def imported(path: Path, layers: str, **options: Any) -> Imported:
    return import_layout(path, read_layers(layers), load(LIKE), **options)


def outline(path: Path, layers: str = "film=1/0") -> dict[str, Any]:
    return dict(tomllib.loads(imported(path, layers).text)["outline"])


def test_a_trampoline_comes_back_with_the_numbers_of_its_designer(tmp_path: Path) -> None:
    path = write(tmp_path / "a.gds", *trampoline(15.0, (1234.5, -77.125)))
    found = imported(path, LAYERS)
    tables = tomllib.loads(found.text)
    assert len(tables["outline"]["points"]) == 20
    assert set(tables["outline"]["fillet"]) == {"15 um", "0 um"}
    assert tables["outline"]["fillet"].count("15 um") == 12
    assert tables["holes"][0]["radius"] == "5 um"
    held = [s for s in found.model.outline.segments if s.clamped]
    assert len(held) == 4
    assert all(abs(abs(x) + abs(y) - 253e-6) < 1e-12 for s in held for x, y in [s.start])
    assert "recognised 12 fillets drawn as chords" in found.notes
    assert any("(1234.5, -77.125) um" in note for note in found.notes)
    assert mesh(found.model).copies == 4


@pytest.mark.parametrize("suffix", [".gds", ".oas"])
@pytest.mark.parametrize(
    ("name", "layers"),
    [
        ("circle", "film=1/0"),
        ("hexagon-278um", "film=1/0"),
        ("square-270um-perforated", "film=1/0,holes=2/0"),
        ("trampoline", "film=1/0,frame=3/0"),
        ("hexagon-278um-etched", "film=1/0,holes=2/0"),
    ],
)
def test_a_geometry_comes_back_from_its_layout(
    tmp_path: Path, name: str, layers: str, suffix: str
) -> None:
    before = load(name)
    path = tmp_path / f"a{suffix}"
    notes = export_layout(before, path)
    assert notes[0] == f"--layers {layers}"
    after = imported(path, layers).model
    area = curves.area(before.outline)
    assert curves.area(after.outline) == pytest.approx(area, rel=3e-7)
    assert curves.distance(before.outline, ends(after)).max() < 1e-7 * before.outline.length
    assert curves.distance(after.outline, ends(before)).max() < 1e-7 * before.outline.length
    assert after.holes.radius == pytest.approx(before.holes.radius, rel=1e-12)
    first, second = (
        np.array(sorted(np.round(m.holes.centres * 1e9, 1).tolist())) for m in (before, after)
    )
    assert np.abs(first - second).max(initial=0.0) < 0.2
    assert [s.clamped for s in after.outline.segments].count(False) == [
        s.clamped for s in before.outline.segments
    ].count(False)


def ends(model: Model) -> Any:
    return np.concatenate([curves.point_at(s, [0.0, 0.5]) for s in model.outline.segments])


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("circle", marks=pytest.mark.slow),
        pytest.param("hexagon-278um", marks=pytest.mark.slow),
        "trampoline",
        pytest.param("spider-web", marks=pytest.mark.slow),
    ],
)
def test_frequencies_survive_a_round_trip(tmp_path: Path, name: str) -> None:
    before = load(name)
    path = tmp_path / "a.gds"
    notes = export_layout(before, path)
    drawn = imported(path, notes[0].removeprefix("--layers ")).model
    after = replace(drawn, film=before.film)  # which no layout holds
    one, other = (
        femnl.solve_modes(m, 6, symmetry="quarter", cache=False).frequency for m in (before, after)
    )
    np.testing.assert_allclose(other, one, rtol=1e-6)


@pytest.mark.parametrize("chords", [16, 24, 64, 500])
def test_many_chords_are_a_circle(tmp_path: Path, chords: int) -> None:
    angle = 2 * np.pi * np.arange(chords) / chords
    points = 80 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    path = write(tmp_path / "a.gds", from_points(points))
    assert outline(path) == {"kind": "circle", "diameter": "160 um"}


@pytest.mark.parametrize("sides", [3, 6, 8, 12])
def test_few_sides_stay_a_polygon(tmp_path: Path, sides: int) -> None:
    angle = 2 * np.pi * np.arange(sides) / sides
    points = 80 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = outline(write(tmp_path / "a.gds", from_points(points)))
    assert found["kind"] == "polygon"
    assert len(found["points"]) == sides


@settings(derandomize=True, database=None, deadline=None, max_examples=40)
@given(
    st.integers(20, 400),
    st.integers(20, 400),
    st.integers(1, 60),
    st.integers(-5000, 5000),
    st.floats(0, 90),
)
def test_turned_and_moved_boxes_keep_their_fillets(
    width: int, height: int, radius: int, x: int, turn: float
) -> None:
    radius = min(radius, int(0.45 * min(width, height)))
    shape = box(width, height)
    shape.fillet(radius, tolerance=1e-3)
    shape.rotate(np.radians(turn)).translate(x * 1e-3, 0)
    corners = np.round(np.asarray(shape.points) * 1e3) * 1e-9
    loop, counts = recognise(corners, 1e-9)
    assert counts["fillets"] == 4
    arcs = [s for s in loop if s.centre is not None]
    radii = [float(s.frame[0, 0]) for s in arcs]
    assert radii == pytest.approx([radius * 1e-6] * 4, abs=2e-9)


@settings(derandomize=True, database=None, deadline=None, max_examples=40)
@given(st.floats(0.5, 500), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_a_circle_rounded_to_the_grid_is_found_within_it(r: float, x: float, y: float) -> None:
    corners = np.round(np.asarray(circle(r, (x, y)).points) * 1e3) * 1e-9
    loop, counts = recognise(corners, 1e-9)
    assert counts["circles"] == 1
    found = circle_of(loop)
    assert found is not None
    assert np.abs(found[0] - np.array([x, y]) * 1e-6).max() < 0.75e-9
    assert found[1] == pytest.approx(r * 1e-6, abs=0.75e-9)


def test_an_ellipse_keeps_axes_and_angle(tmp_path: Path) -> None:
    shape = gdstk.ellipse((0, 0), (30, 12), tolerance=1e-3, layer=2).rotate(np.radians(30))
    path = write(tmp_path / "a.gds", box(200, 200), shape)
    group = tomllib.loads(imported(path, "film=1/0,holes=2/0").text)["holes"][0]
    axes = [float(size.split()[0]) for size in group["semi_axes"]]
    assert axes == pytest.approx([30, 12], abs=1e-3)
    assert float(group["angle"].split()[0]) == pytest.approx(30, abs=1e-3)


@pytest.mark.parametrize(("a", "b", "turn"), [(2.5, 1.0, 30), (5.0, 0.5, 45), (40.0, 2.0, 20)])
@pytest.mark.parametrize("place", [(0.0, 0.0), (-3.717, 1.204)])
def test_a_slender_ellipse_rounded_to_the_grid_is_one(
    a: float, b: float, turn: float, place: tuple[float, float]
) -> None:
    drawn = gdstk.ellipse(place, (a, b), tolerance=1e-3).rotate(np.radians(turn), place)
    loop, counts = recognise(np.round(np.asarray(drawn.points) * 1e3) * 1e-9, 1e-9)
    assert counts["ellipses"] == 1
    assert loop[0].semi_axes == pytest.approx((a * 1e-6, b * 1e-6), abs=0.75e-9)
    assert loop[0].centre == pytest.approx(np.array(place) * 1e-6, abs=0.75e-9)
    assert np.degrees(loop[0].angle) == pytest.approx(turn, abs=0.05)


def test_a_rounded_square_is_no_ellipse() -> None:
    drawn = box(20, 20).fillet(8, tolerance=1e-3)
    loop, counts = recognise(np.round(np.asarray(drawn.points) * 1e3) * 1e-9, 1e-9)
    assert counts["ellipses"] == 0
    assert len(loop) == 8


def test_like_holes_become_one_array(tmp_path: Path) -> None:
    holes = [box(4, 2, (20 * i, 10 * j), layer=2) for i in range(3) for j in range(4)]
    path = write(tmp_path / "a.gds", box(200, 200, (20, 15)), *holes)
    (group,) = tomllib.loads(imported(path, "film=1/0,holes=2/0").text)["holes"]
    assert group == {
        "lattice": "rectangular",
        "pitch": ["20 um", "10 um"],
        "count": [3, 4],
        "shape": {"kind": "rectangle", "width": "4 um", "height": "2 um"},
    }


def test_polygons_that_abut_are_one_film(tmp_path: Path) -> None:
    path = write(tmp_path / "a.gds", box(60, 40, (-30, 0)), box(60, 40, (30, 0)))
    assert outline(path) == {"kind": "rectangle", "width": "120 um", "height": "40 um"}


def test_a_hole_drawn_by_a_cut_is_a_hole(tmp_path: Path) -> None:
    ring = gdstk.boolean(box(100, 100), circle(20), "not", layer=1)
    model = imported(write(tmp_path / "a.gds", *ring), "film=1/0").model
    assert model.outline.kind == "square"
    assert model.holes.radius == pytest.approx(20e-6)


def test_holes_across_the_edge_leave_a_free_edge(tmp_path: Path) -> None:
    path = write(tmp_path / "a.gds", box(100, 100), circle(20, (50, 0)))
    model = imported(path, "film=1/0,holes=2/0").model
    assert [s.clamped for s in model.outline.segments].count(False) > 0
    assert all(s.centre is not None for s in model.outline.segments if not s.clamped)
    assert curves.area(model.outline) == pytest.approx(1e-8 - np.pi * 2e-10, rel=1e-9)


def test_posts_are_clamped(tmp_path: Path) -> None:
    path = write(tmp_path / "a.gds", box(100, 100), circle(5, (20, 0), layer=4))
    (post,) = imported(path, "film=1/0,posts=4/0").model.openings
    assert all(s.clamped for s in post.segments)


FAULTS: dict[str, tuple[list[Any], str, str]] = {
    "open path": (
        [box(100, 100), gdstk.FlexPath([(7, 8), (20, 8)], 0, layer=2, simple_path=True)],
        "film=1/0,holes=2/0",
        "open path on layer 2/0 (holes) at (7, 8) um; femnl geometry check marks them",
    ),
    "self-intersection": (
        [from_points([(0, 0), (100, 0), (0, 100), (100, 100)])],
        "film=1/0",
        "self-intersection (film) at (50, 50) um; femnl geometry check marks them",
    ),
    "pieces": (
        [box(10, 10), box(10, 10, (50, 0))],
        "film=1/0",
        "the film falls into 2 pieces: 100 um² at",
    ),
    "line as an area": (
        [from_points([(0, 0), (50, 0), (50, 0), (0, 0)])],
        "film=1/0",
        "film encloses no area; draw it as a closed curve",
    ),
    "empty layer": (
        [box(10, 10)],
        "film=7/0",
        "layer 7/0 (film) of cell DEVICE is empty; expected one of 1/0",
    ),
    "no film": (
        [box(10, 10), box(10, 10, (50, 0), layer=3)],
        "film=1/0,release=3/0",
        "film, release and holes leave no film; check the layers",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_wrong_layout_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    drawn, layers, line = FAULTS[name]
    path = tmp_path / "a.gds"
    library = gdstk.Library()
    library.new_cell("DEVICE").add(*drawn)
    library.write_gds(path)
    with pytest.raises(GeometryError) as caught:
        imported(path, layers)
    assert str(caught.value).startswith(f"{path}: {line}")
    assert len(str(caught.value).splitlines()) == 1


def test_arrays_of_arrays_are_counted_before_they_are_followed(tmp_path: Path) -> None:
    library = gdstk.Library()
    inner = library.new_cell("DEVICE").add(box(10, 10))
    for level in range(4):
        array = gdstk.Reference(inner, columns=1000, rows=1, spacing=(1, 1))
        inner = library.new_cell(f"L{level}").add(array)
    library.write_gds(tmp_path / "a.gds")
    line = r"cell L3 draws 1,000,000,000,000 polygons with all references, and a device has at "
    with pytest.raises(GeometryError, match=line):
        imported(tmp_path / "a.gds", "film=1/0")
    assert imported(tmp_path / "a.gds", "film=1/0", cell="DEVICE").model.outline.kind == "square"


def test_a_cell_within_itself_is_refused(tmp_path: Path) -> None:
    library = gdstk.Library()
    inner = library.new_cell("DEVICE").add(box(10, 10))
    outer = library.new_cell("OUTER").add(gdstk.Reference(inner))
    inner.add(gdstk.Reference(outer))
    library.write_gds(tmp_path / "a.gds")
    with pytest.raises(GeometryError, match=r"cell DEVICE refers to itself; export it again$"):
        imported(tmp_path / "a.gds", "film=1/0", cell="DEVICE")


def test_slivers_and_steps_below_the_grid_are_told(tmp_path: Path) -> None:
    sliver = box(80, 0.02, (0, 0), layer=2)
    step = from_points([(-50, -50), (50, -50), (50, 0), (50.001, 0), (50.001, 50), (-50, 50)])
    notes = imported(write(tmp_path / "a.gds", sliver, step), "film=1/0,holes=2/0").notes
    assert any("sliver 20 nm wide (holes) at (-40, -0.01) um" in note for note in notes)
    assert any("edge of 1 nm, below the grid (film) at (50, 0) um" in note for note in notes)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("holes=2/0", "--layers names no film; write e.g. film=1/0,holes=2/0"),
        ("film", '--layers "film": expected role=layer, write e.g. film=1/0,holes=2/0'),
        ("film=1/0,hole=2/0", "--layers hole: did you mean holes?"),
        ("film=1/0,film=2/0", "--layers film stands twice; leave one of them out"),
    ],
)
def test_wrong_layers_are_refused(text: str, line: str) -> None:
    with pytest.raises(ParameterError) as caught:
        read_layers(text)
    assert str(caught.value) == line


def test_a_dxf_that_is_cut_after_its_first_tag_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.dxf").write_text("0\nSECTION\n", encoding="utf-8")
    with pytest.raises(GeometryError, match=r"not a whole DXF file; export it again"):
        imported(tmp_path / "a.dxf", "film=1/0")


@pytest.mark.parametrize("suffix", [".gds", ".oas", ".dxf", ".svg"])
def test_what_is_no_layout_is_refused(
    tmp_path: Path, suffix: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"no layout")
    with pytest.raises(GeometryError, match=r"not a whole (GDS|OAS|DXF|SVG) file; export it again"):
        imported(path, "film=1/0")
    assert capfd.readouterr().err == ""


def die(path: Path) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def be_killed(path: Path) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def exhaust(path: Path) -> None:
    raise MemoryError


def test_a_library_that_dies_of_a_file_costs_that_file_alone(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=r"a.oas: not a whole OAS file, .* \(signal 11\)"):
        apart(tmp_path / "a.oas", die)
    for lacking in (exhaust, be_killed):
        with pytest.raises(MemoryError):
            apart(tmp_path / "a.oas", lacking)
    assert apart(tmp_path / "a.oas", Path.with_suffix, ".gds") == tmp_path / "a.gds"


def test_an_oasis_file_with_an_unknown_record_is_refused(tmp_path: Path) -> None:
    library = gdstk.Library()
    library.new_cell("ONE").add(box(10, 10))
    library.write_oas(tmp_path / "a.oas", compression_level=0)
    whole = (tmp_path / "a.oas").read_bytes()
    # Behind the magic bytes and the record of the start, whose length is that of its version
    at = whole.index(b"ONE") - 2
    (tmp_path / "a.oas").write_bytes(whole[:at] + b"\x91" + whole[at:])
    with pytest.raises(GeometryError, match=r"not a whole OAS file"):
        imported(tmp_path / "a.oas", "film=1/0")


def test_a_cell_is_chosen_by_its_name(tmp_path: Path) -> None:
    library = gdstk.Library()
    library.new_cell("ONE").add(box(10, 10))
    library.new_cell("TWO").add(box(20, 20))
    library.write_gds(tmp_path / "a.gds")
    with pytest.raises(GeometryError, match=r"top cells: ONE, TWO; choose one with --cell"):
        imported(tmp_path / "a.gds", "film=1/0")
    with pytest.raises(GeometryError, match=r"no cell TW; did you mean TWO\?"):
        imported(tmp_path / "a.gds", "film=1/0", cell="TW")
    found = imported(tmp_path / "a.gds", "film=1/0", cell="TWO").model
    assert found.name == "TWO"
    assert found.outline.length == pytest.approx(20e-6)


def test_dxf_keeps_arcs_circles_ellipses_and_joins_lines(tmp_path: Path) -> None:
    document = ezdxf.new(units=13)  # µm
    space = document.modelspace()
    bulge = np.tan(np.pi / 8)
    corners = [(-100, -50, 0), (100, -50, bulge), (150, 0, bulge), (100, 50, 0), (-100, 50, 0)]
    space.add_lwpolyline(corners, format="xyb", close=True, dxfattribs={"layer": "FILM"})
    holes = {"layer": "HOLES"}
    space.add_circle((0, 0), 10, dxfattribs=holes)
    space.add_ellipse((40, 0), (12, 5), 0.4, dxfattribs=holes)
    space.add_line((-60, -10), (-40, -10), dxfattribs=holes)
    space.add_line((-40, 10), (-60, 10), dxfattribs=holes)
    space.add_arc((-40, 0), 10, -90, 90, dxfattribs=holes)
    space.add_arc((-60, 0), 10, 90, 270, dxfattribs=holes)
    path = tmp_path / "a.dxf"
    document.saveas(path)
    model = imported(path, "film=FILM,holes=HOLES").model
    assert curves.area(model.outline) == pytest.approx(200 * 100e-12 + np.pi / 2 * 2500e-12)
    assert model.holes.radius == pytest.approx(10e-6)
    areas = sorted(curves.area(o) * 1e12 for o in model.openings)
    assert areas == pytest.approx([np.pi * 0.4 * 169, 400 + np.pi * 100], rel=1e-9)


def test_an_open_chain_of_lines_is_refused(tmp_path: Path) -> None:
    document = ezdxf.new(units=13)
    document.modelspace().add_line((0, 0), (5, 0), dxfattribs={"layer": "FILM"})
    path = tmp_path / "a.dxf"
    document.saveas(path)
    with pytest.raises(GeometryError, match=r"open path on layer FILM \(film\) at \(5, 0\) um"):
        imported(path, "film=FILM")


SVG = """<svg xmlns="http://www.w3.org/2000/svg" width="{width}" viewBox="0 0 400 400">
<g id="film"><rect x="50" y="50" width="300" height="200" rx="20"/></g>
<g id="holes" transform="translate(200,150)"><circle cx="0" cy="0" r="20"/>
<path d="M -80 0 L -60 0 L -60 20 C -60 31 -80 31 -80 20 Z"/></g></svg>"""


def test_svg_keeps_shapes_and_follows_curves(tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    path.write_text(SVG.format(width="0.4mm"), encoding="utf-8")
    found = imported(path, "film=film,holes=holes")
    tables = tomllib.loads(found.text)
    expected = {"kind": "rectangle", "width": "300 um", "height": "200 um", "fillet": "20 um"}
    assert tables["outline"] == expected
    assert found.model.holes.radius == pytest.approx(20e-6)
    # The area under a cubic of height 3/4·11 over a base of 20, with straight arms
    (opening,) = found.model.openings
    assert curves.area(opening) == pytest.approx(20e-6 * (20e-6 + 0.6 * 11e-6), rel=2e-4)


def test_a_file_without_a_unit_asks_for_one(tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    path.write_text(SVG.format(width="400"), encoding="utf-8")
    with pytest.raises(
        GeometryError, match=r"names no unit of length; give one, such as --unit um"
    ):
        imported(path, "film=film")
    assert imported(path, "film=film", unit="um").model.outline.length == pytest.approx(300e-6)


def test_a_missing_reader_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    path = tmp_path / "a.svg"
    path.write_text(SVG.format(width="0.4mm"), encoding="utf-8")
    monkeypatch.delitem(sys.modules, "femnl.device.layout.svg", raising=False)
    monkeypatch.setitem(sys.modules, "svgpathtools", None)
    with pytest.raises(MissingLibraryError, match=r"needs svgpathtools; install femnl\[layout\]"):
        imported(path, "film=film")


def test_a_drawing_is_symmetric_to_its_grid_and_its_pairs_stay_degenerate(tmp_path: Path) -> None:
    angle = np.radians(22.5 + 45 * np.arange(8))
    points = np.round(50 * np.stack([np.cos(angle), np.sin(angle)], axis=1), 3)
    points[[1, 6]] += [[-0.001, -0.001], [0.0, 0.001]]  # as where a tool rounds down
    model = imported(write(tmp_path / "a.gds", from_points(points)), "film=1/0").model
    corners = np.array([s.start for s in model.outline.segments])
    mirrored = corners * [1, -1]
    gaps = [np.hypot(*(corners - one).T).min() for one in mirrored]
    assert max(gaps) > 0.4e-9  # rounding has left it no mirror image of itself
    domain = mesh(model)
    assert (domain.copies, domain.diagonal) == (4, True)
    assert mesh(replace(model, grid=0.0)).copies == 1
    modes = femnl.solve_modes(model, 3, cache=False)
    assert modes.frequency[1] == pytest.approx(modes.frequency[2], rel=1e-12)


def metallised(tmp_path: Path, **options: Any) -> Imported:
    path = write(tmp_path / "pad.gds", box(200, 200), circle(40, layer=5))
    return imported(path, "film=1/0,metal=5/0", **options)


def test_a_metal_has_the_numbers_that_are_given_and_those_of_aluminium(tmp_path: Path) -> None:
    found = metallised(tmp_path, metal=read_metal("thickness=30 nm, poisson=0.44,stress=-80 MPa"))
    (layer,) = found.model.layers
    assert (layer.thickness, layer.poisson, layer.stress) == (30e-9, 0.44, -80e6)
    assert (layer.young, layer.density) == (70e9, 2700)
    assert found.model.assumed == ("film", "layers.1.young", "layers.1.density")
    assert "aluminium with young = 70 GPa, density = 2700 kg/m^3;" in found.assumed[1]


def test_a_metal_all_of_whose_numbers_are_given_is_not_assumed(tmp_path: Path) -> None:
    gold = "thickness=20 nm,young=78 GPa,poisson=0.44,density=19300 kg/m^3,stress=10 MPa"
    found = metallised(tmp_path, metal=read_metal(gold))
    assert found.model.assumed == ("film",)
    assert not any("aluminium" in line for line in found.notes)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("thickness", '--metal "thickness": expected key=value'),
        ("thicknes=30 nm", "--metal thicknes: did you mean thickness"),
        ("poisson=a", '--metal poisson="a": expected a number'),
        ("stress=1 Pa,stress=2 Pa", "--metal stress stands twice"),
    ],
)
def test_wrong_numbers_of_a_metal_are_named(text: str, line: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(line)):
        read_metal(text)


def test_numbers_of_a_metal_need_its_layer(tmp_path: Path) -> None:
    path = write(tmp_path / "a.gds", box(200, 200))
    with pytest.raises(ParameterError, match="--metal gives numbers, and --layers no layer"):
        imported(path, "film=1/0", metal={"thickness": "30 nm"})


def test_a_wrong_unit_of_a_metal_is_named_by_its_key(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=r"\[layers\] (metal )?(1 )?thickness"):
        metallised(tmp_path, metal={"thickness": "30 MPa"})
