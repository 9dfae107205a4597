"""Layouts whose curves would be lost or misread, and layers that reach far beyond the film."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import ezdxf
import gdstk
import numpy as np
import pytest

from femnl import load
from femnl.core.device import Model
from femnl.core.errors import GeometryError
from femnl.core.resources import find_geometry
from femnl.device.geometry import curves, parse
from femnl.device.layout import import_layout
from femnl.device.layout.export import export_layout
from femnl.device.mesh import covers
from femnl.device.mesh.symmetry import FULL, find_wedge
from tests.unit.layouts import write

UM = 1e-6
LIKE = load(find_geometry("square-270um"))


def imported(path: Path, **layers: str) -> Model:
    """Return the device of a layout."""
    return import_layout(path, layers, LIKE).model


def dxf(path: Path, draw: Callable[[ezdxf.layouts.Modelspace], object], units: int = 13) -> Path:
    """Write a drawing in µm."""
    document = ezdxf.new()
    document.units = units
    draw(document.modelspace())
    document.saveas(path)
    return path


def square(space: ezdxf.layouts.Modelspace, half: float, layer: str = "F") -> None:
    """Draw a square that repeats its first corner and is closed."""
    corners = [(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)]
    space.add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})


def test_a_closed_polyline_may_repeat_its_first_corner(tmp_path: Path) -> None:
    model = imported(dxf(tmp_path / "a.dxf", lambda space: square(space, 100)), film="F")
    assert model.outline.length == pytest.approx(200 * UM)


def test_a_curve_within_another_of_its_layer_is_refused(tmp_path: Path) -> None:
    def draw(space: ezdxf.layouts.Modelspace) -> None:
        square(space, 100)
        space.add_circle((0, 0), 20, dxfattribs={"layer": "F"})

    with pytest.raises(GeometryError, match=r"film: the curve at .* lies within another"):
        imported(dxf(tmp_path / "a.dxf", draw), film="F")


def hatched(space: ezdxf.layouts.BaseLayout) -> None:
    """Draw a film with a round end, a round hole, an elliptic one and one of four edges."""
    bulge = np.tan(np.pi / 8)
    corners = [(-100, -50, 0), (100, -50, bulge), (150, 0, bulge), (100, 50, 0), (-100, 50, 0)]
    space.add_hatch(dxfattribs={"layer": "F"}).paths.add_polyline_path(corners, is_closed=True)
    borders = [space.add_hatch(dxfattribs={"layer": "H"}).paths.add_edge_path() for _ in range(3)]
    borders[0].add_arc((0, 0), 10, 0, 360)
    borders[1].add_ellipse((40, 0), (12, 5), 0.4, 90, 450)
    borders[2].add_line((-60, -10), (-40, -10))
    borders[2].add_arc((-40, 0), 10, -90, 90)
    borders[2].add_line((-40, 10), (-60, 10))
    borders[2].add_spline(control_points=[(-60, 10), (-75, 0), (-60, -10)], degree=2)


def test_borders_of_hatches_are_read_where_nothing_else_is_drawn(tmp_path: Path) -> None:
    model = imported(dxf(tmp_path / "a.dxf", hatched), film="F", holes="H")
    assert curves.area(model.outline) == pytest.approx(200 * 100e-12 + np.pi / 2 * 2500e-12)
    assert model.holes.radius == pytest.approx(10e-6)
    parabola = 2 / 3 * 20 * 7.5
    areas = sorted(curves.area(o) * 1e12 for o in model.openings)
    assert areas == pytest.approx([np.pi * 0.4 * 169, 400 + np.pi / 2 * 100 + parabola], rel=1e-4)


def test_a_border_through_fit_points_is_read_as_the_spline_is(tmp_path: Path) -> None:
    points = [(100, 0), (0, 60), (-100, 0), (0, -60), (100, 0)]

    def hatch(space: ezdxf.layouts.Modelspace) -> None:
        border = space.add_hatch(dxfattribs={"layer": "F"}).paths.add_edge_path()
        border.add_spline(fit_points=points)

    def spline(space: ezdxf.layouts.Modelspace) -> None:
        space.add_spline(points, dxfattribs={"layer": "F"})

    filled, drawn = (
        imported(dxf(tmp_path / f"{draw.__name__}.dxf", draw), film="F") for draw in (hatch, spline)
    )
    assert curves.area(filled.outline) == pytest.approx(curves.area(drawn.outline), rel=1e-9)


def test_a_hatch_beside_lines_is_left_out_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def draw(space: ezdxf.layouts.Modelspace) -> None:
        square(space, 100)
        fill = space.add_hatch(dxfattribs={"layer": "F"})
        fill.paths.add_polyline_path([(-90, -90), (90, -90), (90, 90)], is_closed=True)

    model = imported(dxf(tmp_path / "a.dxf", draw), film="F")
    assert model.outline.length == pytest.approx(200 * UM)
    assert "layer F (film): its hatches (1) are left out" in caplog.text


def test_shapes_that_are_not_read_and_widths_of_lines_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def draw(space: ezdxf.layouts.Modelspace) -> None:
        square(space, 100)
        space.add_circle((0, 0), 5, dxfattribs={"layer": "H"})
        space.add_solid([(30, 30), (40, 30), (30, 40), (40, 40)], dxfattribs={"layer": "H"})
        space.add_text("name", dxfattribs={"layer": "H"})
        corners = [(-50, -50), (-40, -50), (-40, -40)]
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "H", "const_width": 2})

    imported(dxf(tmp_path / "a.dxf", draw), film="F", holes="H")
    assert "layer H: SOLID are not read and left out" in caplog.text
    assert "layer H: polylines have a width, which is not read" in caplog.text


def test_a_closed_spline_is_an_outline(tmp_path: Path) -> None:
    def draw(space: ezdxf.layouts.Modelspace) -> None:
        turn = np.arange(8) * np.pi / 4
        corners = [(100 * np.cos(t), 60 * np.sin(t), 0) for t in turn]
        space.add_spline(dxfattribs={"layer": "F"}).set_closed(corners)

    model = imported(dxf(tmp_path / "a.dxf", draw), film="F")
    # A uniform cubic spline of eight points on a circle is one of radius (2 + cos 45°)/3 to 1e-3
    radius = (2 + np.cos(np.pi / 4)) / 3
    area = np.pi * 100 * 60 * radius**2 * UM**2
    assert curves.area(model.outline) == pytest.approx(area, rel=2e-3)


def test_hatches_of_a_mirrored_block_are_mirrored(tmp_path: Path) -> None:
    def draw(space: ezdxf.layouts.Modelspace) -> None:
        hatched(space.doc.blocks.new("half"))
        space.add_blockref("half", (30, 0), dxfattribs={"xscale": -1})

    def whole(space: ezdxf.layouts.Modelspace) -> None:
        hatched(space)

    mirrored, drawn = (
        imported(dxf(tmp_path / f"{one.__name__}.dxf", one), film="F", holes="H")
        for one in (draw, whole)
    )
    assert curves.area(mirrored.outline) == pytest.approx(curves.area(drawn.outline))
    # The middle of the film is the origin, so that nothing is left of the block's own place
    np.testing.assert_allclose(mirrored.holes.centres * [-1, 1], drawn.holes.centres, atol=1e-12)
    ends = [sorted(s.start for s in opening.segments) for opening in mirrored.openings]
    flipped = [sorted((-s.start[0], s.start[1]) for s in o.segments) for o in drawn.openings]
    reached = [np.ptp(np.array(places), axis=0) for places in (*ends, *flipped)]
    np.testing.assert_allclose(reached[:2], reached[2:], atol=2e-9)
    for opening, other in zip(mirrored.openings, drawn.openings, strict=True):
        assert curves.area(opening) == pytest.approx(curves.area(other), rel=1e-6)


def test_a_tilted_hatch_is_refused(tmp_path: Path) -> None:
    def draw(space: ezdxf.layouts.Modelspace) -> None:
        fill = space.add_hatch(dxfattribs={"layer": "F", "extrusion": (0, 0.6, 0.8)})
        fill.paths.add_polyline_path([(-90, -90), (90, -90), (90, 90)], is_closed=True)

    with pytest.raises(GeometryError, match="layer F: a hatch is drawn on a tilted plane"):
        imported(dxf(tmp_path / "a.dxf", draw), film="F")


def test_names_of_dxf_layers_heed_no_case(tmp_path: Path) -> None:
    path = dxf(tmp_path / "a.dxf", lambda space: square(space, 100, "Film"))
    assert imported(path, film="FILM").outline.length == pytest.approx(200 * UM)


SVG = """<svg xmlns="http://www.w3.org/2000/svg" width="1mm" height="1mm" viewBox="0 0 1000 1000">
<g id="F"><rect width="1000" height="1000"/></g><g id="H"{}><circle r="50" cx="200" cy="200"/>
<g style="fill: red; display : none"><circle r="50" cx="700" cy="200"/></g>
<circle r="50" cx="700" cy="700" display="none"/>
<circle r="50" cx="200" cy="700" display="none" style="display:inline"/></g></svg>"""


def test_hidden_shapes_of_an_svg_are_left_out_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.svg"
    path.write_text(SVG.format(""))
    assert len(imported(path, film="F", holes="H").holes.centres) == 2
    assert "group H (holes): hidden shapes (2) are left out" in caplog.text
    path.write_text(SVG.format(' style="display:none"'))
    with pytest.raises(GeometryError, match=r"group H \(holes\) is hidden .*show it"):
        imported(path, film="F", holes="H")


def test_a_length_with_a_unit_within_an_svg_is_refused_for_what_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    path.write_text(SVG.format("").replace('r="50"', 'r="0.05mm"'))
    with pytest.raises(GeometryError, match=r"'0.05mm'; give plain numbers, without units"):
        imported(path, film="F")


def test_circles_drawn_twice_are_no_lattice(tmp_path: Path) -> None:
    def draw(space: ezdxf.layouts.Modelspace) -> None:
        square(space, 100)
        for at in ((0, 0), (20, 20), (0, 20), (0, 20)):
            space.add_circle(at, 3, dxfattribs={"layer": "H"})

    with pytest.raises(GeometryError, match=r"hole 3 at .* and hole 4 at .* overlap"):
        imported(dxf(tmp_path / "a.dxf", draw), film="F", holes="H")


def test_a_unit_of_a_drawing_that_is_not_read_is_refused(tmp_path: Path) -> None:
    path = dxf(tmp_path / "a.dxf", lambda space: square(space, 100), units=9)
    with pytest.raises(GeometryError, match=r"\$INSUNITS = 9 is no unit that is read"):
        imported(path, film="F")


@pytest.mark.parametrize(
    ("box", "told"),
    [
        ('width="2mm" height="1mm" viewBox="0 0 1000 1000"', "by its width and .* by its height"),
        ('width="2mm" height="1mm" viewBox="0 0 0 0"', "expected a positive width and height"),
    ],
)
def test_a_view_box_that_tells_no_scale_is_refused(box: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" {box}><g id="F">'
        '<path d="M0 0H200V200H0Z"/></g></svg>'
    )
    with pytest.raises(GeometryError, match=told):
        imported(path, film="F")


def test_wafer_left_inside_a_film_is_not_lost(tmp_path: Path) -> None:
    film = gdstk.rectangle((-100, -100), (100, 100), layer=1)
    left = gdstk.rectangle((-10, -10), (10, 10), layer=3)
    with pytest.raises(GeometryError, match="leave an inner edge at"):
        imported(write(tmp_path / "a.gds", film, left), film="1/0", frame="3/0")


def test_metal_within_a_hole_of_metal_stays(tmp_path: Path) -> None:
    film = gdstk.rectangle((-100, -100), (100, 100), layer=1)
    ring = gdstk.ellipse((0, 0), 60, inner_radius=40, layer=5, tolerance=1e-3)
    dot = gdstk.rectangle((-10, -10), (10, 10), layer=5)
    model = imported(write(tmp_path / "a.gds", film, ring, dot), film="1/0", metal="5/0")
    (layer,) = model.layers
    places = UM * np.array([[0.0, 0.0], [30.0, 0.0], [50.0, 0.0], [80.0, 0.0]])
    assert covers(layer, places).tolist() == [True, False, True, False]


@pytest.mark.parametrize("side", [150, 1300, 20_000])
def test_a_layer_to_one_side_is_symmetric_at_no_size(side: float) -> None:
    text = find_geometry("metallised-drum").read_text(encoding="utf-8")
    drum = parse(text)
    away = 0.1 * drum.outline.length / UM + side / 2
    part = f'{{ shape = {{ kind = "square", side = "{side} um" }}, at = ["{away} um", "0 um"] }}'
    pad = f'shape = {{ kind = "combined", parts = [{part}] }}'
    head, _, rest = text.partition("shape = ")
    model = parse(head + pad + "\n" + rest.partition("\n")[2])
    wedge = find_wedge(replace(model), "auto")
    assert wedge > FULL / 4


def test_film_on_both_sides_of_a_frame_is_refused(tmp_path: Path) -> None:
    film = gdstk.rectangle((-100, -100), (100, 100), layer=1)
    outside = gdstk.rectangle((-50, -50), (50, 50), layer=3)
    opening = gdstk.rectangle((-40, -40), (40, 40), layer=3)
    ring = gdstk.boolean(outside, opening, "not", layer=3)
    with pytest.raises(GeometryError, match="there is film around it"):
        imported(write(tmp_path / "a.gds", film, *ring), film="1/0", frame="3/0")


def test_what_a_block_has_on_layer_0_is_on_the_layer_of_its_insertion(tmp_path: Path) -> None:
    document = ezdxf.new()
    document.units = 13
    block = document.blocks.new("HOLE")
    block.add_circle((0, 0), 5, dxfattribs={"layer": "0"})
    space = document.modelspace()
    square(space, 100)
    space.add_circle((-40, 0), 5, dxfattribs={"layer": "H"})
    space.add_blockref("HOLE", (40, 0), dxfattribs={"layer": "H"})
    document.saveas(tmp_path / "a.dxf")
    model = imported(tmp_path / "a.dxf", film="F", holes="H")
    assert sorted(model.holes.centres[:, 0] / UM) == pytest.approx([-40, 40])


@pytest.mark.parametrize(
    ("inside", "told"),
    [
        ('<circle id="c" cx="50" cy="50" r="5"/><use href="#c" x="60"/>', "<use> is not read"),
        ('<a><circle cx="50" cy="50" r="5"/></a>', "<a> is not read"),
        ('<svg><circle cx="50" cy="50" r="5"/></svg>', "<svg> is not read"),
        (
            '<g style="transform:scale(2)"><circle cx="50" cy="50" r="5"/></g>',
            "a transform within style is not read",
        ),
    ],
)
def test_what_an_svg_shows_and_is_not_read_is_refused(
    inside: str, told: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="1mm" viewBox="0 0 1000 1000"><g id="F">'
        f'<path d="M0 0H200V200H0Z"/></g><g id="H">{inside}</g></svg>'
    )
    with pytest.raises(GeometryError, match=told):
        imported(path, film="F", holes="H")


def test_a_frame_that_is_a_ring_leaves_the_film_in_its_opening(tmp_path: Path) -> None:
    film = gdstk.rectangle((-100, -100), (100, 100), layer=1)
    outside = gdstk.rectangle((-150, -150), (150, 150), layer=3)
    opening = gdstk.rectangle((-90, -90), (90, 90), layer=3)
    ring = gdstk.boolean(outside, opening, "not", layer=3)
    model = imported(write(tmp_path / "a.gds", film, *ring), film="1/0", frame="3/0")
    assert model.outline.length == pytest.approx(180 * UM)
    assert all(segment.clamped for segment in model.outline.segments)


CORNERS = [(-40, -50), (40, -50), (50, -40), (50, 40), (40, 50), (-40, 50), (-50, 40), (-50, -40)]
QUARTER = float(np.tan(np.pi / 8))


@pytest.mark.parametrize("clockwise", [False, True])
def test_a_closed_polyline_may_turn_either_way(tmp_path: Path, clockwise: bool) -> None:
    """Its bulges are negative where it turns clockwise, and its arcs come the other way round."""
    bulged = [(*corner, QUARTER * (k % 2)) for k, corner in enumerate(CORNERS)]
    if clockwise:
        bulged = [(*c, -QUARTER * (k % 2)) for k, c in enumerate(CORNERS[::-1])]

    def draw(space: ezdxf.layouts.Modelspace) -> None:
        space.add_lwpolyline(bulged, "xyb", close=True, dxfattribs={"layer": "F"})

    model = imported(dxf(tmp_path / "a.dxf", draw), film="F")
    assert model.outline.kind == "square"
    assert curves.area(model.outline) == pytest.approx((1e4 - (4 - np.pi) * 100) * UM**2)


def test_a_polyline_may_be_hollow_and_a_lens_has_two_arcs(tmp_path: Path) -> None:
    def draw(space: ezdxf.layouts.Modelspace) -> None:
        hollow = [(-100, -100), (100, -100), (100, 100, -QUARTER), (-100, 100)]
        full = [(*corner, 0.0)[:3] for corner in hollow]
        space.add_lwpolyline(full, "xyb", close=True, dxfattribs={"layer": "F"})
        lens = [(-30, -50, QUARTER), (30, -50, QUARTER)]
        space.add_lwpolyline(lens, "xyb", close=True, dxfattribs={"layer": "H"})

    model = imported(dxf(tmp_path / "a.dxf", draw), film="F", holes="H")
    segment = (np.pi / 4 - 0.5) * 2  # a quarter of a circle less its triangle, of chord 2: r² = 2
    assert curves.area(model.outline) == pytest.approx((4e4 - segment * 1e4) * UM**2)
    (opening,) = model.openings
    assert curves.area(opening) == pytest.approx(2 * segment * 900 * UM**2)


def test_a_polygon_with_fillets_survives_export_and_import(tmp_path: Path) -> None:
    """Some of its coordinates are zero but for rounding, which a geometry refuses."""
    path = tmp_path / "six.toml"
    text = find_geometry("square-270um").read_text(encoding="utf-8")
    shape = 'kind = "regular-polygon"\nsides = 6\nlong_axis = "100 um"\nfillet = "5 um"'
    path.write_text(text.replace('kind = "square"\nside = "270 um"', shape), encoding="utf-8")
    model = load(path)
    export_layout(model, tmp_path / "six.gds")
    again = imported(tmp_path / "six.gds", film="1/0")
    assert curves.area(again.outline) == pytest.approx(curves.area(model.outline), rel=1e-6)
