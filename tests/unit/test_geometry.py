"""Geometry files become the device that they describe, in SI units."""

import re
import time
import tomllib
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pint import UnitRegistry

from femnl.core import resources
from femnl.core.errors import GeometryError
from femnl.device.geometry import curves, load, parse, shipped
from femnl.device.geometry.quantities import USUAL
from femnl.device.geometry.tables import EXAMPLES, Table

SHIPPED = {
    "circle",
    "dandelion",
    "hexagon-278um",
    "hexagon-278um-etched",
    "hexagon-278um-perforated",
    "lotus",
    "rectangle",
    "soft-clamped-honeycomb",
    "soft-clamped-square",
    "metallised-drum",
    "spider-web",
    "square-270um",
    "square-270um-etched",
    "square-270um-perforated",
    "square-700um",
    "trampoline",
}
FILM = """
[film]
thickness = "183.75 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1101.5 MPa"
"""
SQUARE = 'name = "test"\n[outline]\nkind = "square"\nside = "270 um"\n'
ROUNDS = settings(derandomize=True, database=None, deadline=None, max_examples=100)


def polygon(points: list[tuple[float, float]], free: list[int]) -> str:
    corners = ", ".join(f'["{x} um", "{y} um"]' for x, y in points)
    return (
        f'name = "test"\n[outline]\nkind = "polygon"\npoints = [{corners}]\nfree = {free}\n{FILM}'
    )


def test_the_named_devices_ship() -> None:
    assert {name for name, _ in shipped()} == SHIPPED


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_a_shipped_geometry_is_called_as_its_file_and_states_source_and_assumptions(
    name: str,
) -> None:
    model = load(name)
    text = (resources.geometries() / f"{name}.toml").read_text(encoding="utf-8")
    assert (model.name, model.text) == (name, text)
    assert model.source
    assert model.assumed
    assert text.startswith("# ")
    assert tomllib.loads(text)["assumed"] == list(model.assumed)


@pytest.mark.parametrize(("name", "line"), shipped())
def test_a_shipped_geometry_is_described_in_one_line(name: str, line: str) -> None:
    assert line.splitlines() == [line]
    assert line.startswith(load(name).outline.kind)


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_segments_follow_one_another_around_the_film(name: str) -> None:
    segments = load(name).outline.segments
    assert all(a.end == b.start for a, b in zip(segments, segments[1:] + segments[:1], strict=True))
    assert curves.area(load(name).outline) > 0
    for s in segments:
        if s.centre is not None:
            assert np.hypot(*np.subtract(s.end, s.centre)) == pytest.approx(
                curves.radius(s), rel=1e-9
            )


def test_the_device_of_the_source_paper_has_the_published_numbers() -> None:
    model = load("square-270um-perforated")
    assert (model.film.thickness, model.film.young, model.film.stress) == (
        183.75e-9,
        250e9,
        1101.5e6,
    )
    assert (model.film.poisson, model.film.density, model.film.taper) == (0.23, 3100.0, 0.0)
    assert (model.outline.size, model.outline.length) == ((270e-6, 270e-6), 270e-6)
    assert (len(model.holes.centres), model.holes.radius) == (900, 0.9e-6)
    assert (model.bending, model.edge) == (True, "clamped")
    x = np.unique(np.round(model.holes.centres[:, 0], 12))
    np.testing.assert_allclose(np.diff(x), 8.56e-6, rtol=1e-6)
    assert x[0] == pytest.approx(-x[-1])


def test_the_stack_is_that_of_the_papers_table_unless_the_file_gives_one() -> None:
    stack = load("square-270um").stack
    assert stack is not None
    assert [layer.thickness for layer in stack.layers] == [np.inf, 183.75e-9, 3226.25e-9, np.inf]
    assert stack.gap == 2
    # Table of supplement S6, at 632.8 nm and 532 nm.
    assert dict(stack.layers[1].index) == {632.8e-9: 2.0395, 532e-9: 2.0559}
    assert dict(stack.layers[3].index) == {632.8e-9: 3.8640 - 0.0158j, 532e-9: 4.1366 - 0.0338j}
    assert parse(SQUARE + FILM).stack is None


def test_a_stack_may_be_given_layer_by_layer() -> None:
    readout = """
[readout]
gap = "2 um"
layers = [
  { material = "vacuum", index = { "1550 nm" = 1 } },
  { material = "Al", thickness = "30 nm", index = { "1550 nm" = "1.44 - 16.0i" } },
  { material = "SiN", thickness = "film", index = { "1550 nm" = 1.99 } },
  { material = "vacuum", thickness = "gap", index = { "1550 nm" = 1.0 } },
  { material = "Si", index = { "1550 nm" = 3.48 } },
]
"""
    stack = parse(SQUARE + FILM + readout).stack
    assert stack is not None
    assert [layer.thickness for layer in stack.layers] == [np.inf, 30e-9, 183.75e-9, 2e-6, np.inf]
    assert stack.gap == 3
    assert stack.layers[1].index == ((1550e-9, 1.44 - 16.0j),)


@given(
    st.decimals(min_value="0.02", max_value="9999", places=3),
    st.sampled_from(["nm", "um", "µm", "mm"]),
)
@ROUNDS
def test_a_length_with_a_prefix_becomes_the_nearest_double_in_metres(
    number: Decimal, unit: str
) -> None:
    exponent = {"nm": -9, "um": -6, "µm": -6, "mm": -3}[unit]
    text = SQUARE.replace("270 um", f"{number} {unit}") + FILM.replace("183.75 nm", "1 pm")
    assert parse(text).outline.length == float(f"{number}e{exponent}")


@pytest.mark.parametrize(
    ("written", "pascal"),
    [
        ("1 GPa", 1e9),
        ("1e9 N/m^2", 1e9),
        ("1000 N/mm**2", 1e9),
        ("10 kbar", 1e9),
        ("1 kN / mm²", 1e9),
        ("1GPa", 1e9),
    ],
)
def test_any_unit_of_the_right_dimension_will_do(written: str, pascal: float) -> None:
    assert parse(SQUARE + FILM.replace("250 GPa", written)).film.young == pascal


def test_a_taper_reaches_the_film() -> None:
    holes = '[holes]\nlattice = "list"\ncentres = [["0 um", "1 um"]]\nradius = "1 um"\n'
    film = parse(SQUARE + holes + FILM + 'taper = "60 nm"\ntaper_length = "4 um"').film
    assert (film.taper, film.taper_length) == (60e-9, 4e-6)


def test_the_hexagon_has_its_long_axis_along_x() -> None:
    outline = load("hexagon-278um").outline
    assert outline.segments[0].start == (278.7e-6 / 2, 0.0)
    x0, y0, x1, y1 = curves.box(outline)
    assert (x1 - x0, y1 - y0) == pytest.approx((278.7e-6, 278.7e-6 * np.sqrt(3) / 2), rel=1e-14)
    assert (outline.length, outline.size) == (278.7e-6, None)


def test_a_hexagonal_lattice_of_rings_has_six_neighbours_and_corners_along_x() -> None:
    holes = load("hexagon-278um-perforated").holes.centres
    assert len(holes) == 1 + 3 * 15 * 16
    steps = np.hypot(*(holes[:, None] - holes[None]).transpose(2, 0, 1))
    neighbours = np.sum(np.abs(steps - 8.56e-6) < 1e-12, axis=1)
    assert neighbours[np.argmin(np.hypot(*holes.T))] == 6
    assert sorted(np.unique(neighbours)) == [3, 4, 6]
    np.testing.assert_allclose(holes[np.argmax(holes[:, 0])], [15 * 8.56e-6, 0], atol=1e-15)


def test_a_hexagonal_lattice_of_rows_is_centred_and_shifted_by_the_offset() -> None:
    holes = (
        '[holes]\nlattice = "hexagonal"\npitch = "10 um"\ncount = [4, 3]\nradius = "1 '
        'um"\noffset = ["2 um", '
        '"-3 um"]\n'
    )
    centres = parse(SQUARE + holes + FILM).holes.centres
    assert len(centres) == 12
    np.testing.assert_allclose((centres.min(0) + centres.max(0)) / 2, [2e-6, -3e-6], atol=1e-15)
    np.testing.assert_allclose(np.ptp(centres, axis=0), [35e-6, 20e-6 * np.sqrt(3) / 2])
    np.testing.assert_allclose(np.hypot(*(centres[4] - centres[0])), 10e-6)


def test_the_etched_square_fills_the_quoted_box_and_gives_it_for_labels() -> None:
    outline = load("square-270um-etched").outline
    np.testing.assert_allclose(curves.box(outline), [-135e-6, -135e-6, 135e-6, 135e-6], rtol=1e-12)
    assert outline.size == pytest.approx((270e-6, 270e-6), rel=1e-12)
    assert load("hexagon-278um-etched").outline.length == pytest.approx(278.7e-6, rel=1e-12)
    assert load("hexagon-278um-etched").outline.size is None


def test_the_trampoline_is_held_at_the_ends_of_its_tethers_only() -> None:
    held = [s for s in load("trampoline").outline.segments if s.clamped]
    assert len(held) == 4
    assert {round(abs(s.start[0] + s.end[0]) + abs(s.start[1] + s.end[1]), 9) for s in held} == {
        500e-6
    }


@given(st.integers(3, 12), st.data())
@ROUNDS
def test_a_polygon_given_clockwise_is_the_same_film_with_the_same_free_edges(
    number: int, data: st.DataObject
) -> None:
    radii = data.draw(st.lists(st.integers(50, 500), min_size=number, max_size=number))
    free = sorted(data.draw(st.sets(st.integers(1, number), max_size=number - 1)))
    angles = 2 * np.pi * np.arange(number) / number
    points = [
        (round(r * np.cos(a), 3), round(r * np.sin(a), 3))
        for r, a in zip(radii, angles, strict=True)
    ]
    forth = parse(polygon(points, free)).outline
    # Backwards from the same point, edge k is edge n + 1 − k.
    back = parse(polygon([points[0], *points[:0:-1]], [number + 1 - k for k in free])).outline
    assert back == forth
    assert [k + 1 for k, s in enumerate(forth.segments) if not s.clamped] == free


def test_ten_thousand_holes_load_in_well_under_a_second() -> None:
    text = (
        load("square-270um-perforated")
        .text.replace("[30, 30]", "[100, 100]")
        .replace('side = "270 um"', 'side = "1 mm"')
    )
    etched = load("square-270um-etched").text.replace("[30, 30]", "[100, 100]")
    for source in (text, etched):
        begin = time.process_time()
        assert len(parse(source).holes.centres) == 10_000
        assert time.process_time() - begin < 1.0


def test_a_file_is_read_by_its_path_and_a_windows_mark_is_skipped(tmp_path: Path) -> None:
    path = tmp_path / "device.toml"
    path.write_bytes(b"\xef\xbb\xbf" + (SQUARE + FILM).encode())
    assert load(path).text == load(str(path)).text == SQUARE + FILM


def test_a_geometry_that_does_not_exist_is_met_with_the_nearest_name(tmp_path: Path) -> None:
    with pytest.raises(
        GeometryError,
        match=re.escape(
            "square-270: neither a shipped geometry nor a file; did you mean square-270um?"
        ),
    ):
        load("square-270")
    with pytest.raises(
        GeometryError,
        match=r"gone.toml: cannot be read: No such file or directory; give a shipped name or a "
        r"TOML file",
    ):
        load(tmp_path / "gone.toml")
    (tmp_path / "latin.toml").write_bytes('name = "µ"'.encode("latin-1"))
    with pytest.raises(
        GeometryError,
        match=r"latin.toml: not a geometry, a TOML file .invalid start byte at byte 8",
    ):
        load(tmp_path / "latin.toml")


def test_every_key_of_the_schema_has_an_example_for_messages() -> None:
    keys: set[str] = set()
    waiting: list[type[Table]] = [Table]
    while waiting:
        table = waiting.pop()
        keys.update(table.model_fields)
        waiting += table.__subclasses__()
    assert keys - {
        "outline",
        "holes",
        "film",
        "loss",
        "readout",
        "model",
        "layers",
        "clamp",
        "overhang",
    } == set(EXAMPLES)


@pytest.mark.parametrize(("unit", "si"), USUAL, ids=" ".join)
def test_a_usual_unit_is_as_large_as_pint_says(unit: str, si: str) -> None:
    registry: UnitRegistry[Decimal] = UnitRegistry(non_int_type=Decimal)
    assert USUAL[unit, si] == registry.Quantity(Decimal(1), unit).to(si).magnitude
