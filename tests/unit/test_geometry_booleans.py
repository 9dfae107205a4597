"""Unions, differences and intersections keep areas, curves and clamps."""

import tomllib

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from femnl.core.outline import Outline, Segment
from femnl.device.geometry import curves
from femnl.device.geometry.booleans import Operation, Region, combine
from femnl.device.geometry.corners import loop
from femnl.device.geometry.placing import held, placed
from femnl.device.geometry.schema import GeometryFile
from femnl.device.geometry.shapes import ellipse
from femnl.device.geometry.splines import spline
from femnl.sweep.axes import put

Loop = tuple[Segment, ...]
ROUNDS = settings(derandomize=True, database=None, deadline=None, max_examples=80)
PLACES = st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))


def box(width: float, height: float) -> Loop:
    x = width / 2
    y = height / 2
    return loop(np.array([(-x, -y), (x, -y), (x, y), (-x, y)]))


def outline(segments: Loop) -> Outline:
    return Outline("", segments, None, 1.0)


def area(region: Region) -> float:
    return curves.area(outline(region.outer)) - sum(curves.area(outline(i)) for i in region.inner)


def total(operation: Operation, one: Loop, other: Loop) -> float:
    return sum(area(region) for region in combine([("add", one), (operation, other)]))


@st.composite
def shapes(draw: st.DrawFn) -> Loop:
    kind = draw(st.sampled_from(["box", "circle", "ellipse"]))
    a = draw(st.floats(0.3, 2))
    b = draw(st.floats(0.3, 2))
    made = box(a, b)
    if kind != "box":
        made = ellipse((0.0, 0.0), (a / 2, a / 2 if kind == "circle" else b / 2))
    angle = draw(st.floats(0, 3))
    return placed(outline(made), draw(PLACES), angle).segments


def test_ellipses_that_nearly_touch_are_cut_where_they_cross() -> None:
    """Chords meet between two crossings that are a chord apart, where the curves are parallel."""
    one = ellipse((0.0, 0.0), (0.9285906951309413, 0.6312738029643242))
    one = placed(outline(one), (0.6316093665806779, 0.35), 2.7072632603507407).segments
    other = ellipse((0.0, 0.0), (0.9110987048808249, 0.48))
    other = placed(outline(other), (0.0, 0.453750675437932), 0.453750675437932).segments
    areas = [curves.area(outline(s)) for s in (one, other)]
    both = total("intersect", one, other)
    assert total("add", one, other) + both == pytest.approx(sum(areas), rel=1e-9)
    assert total("subtract", one, other) + both == pytest.approx(areas[0], rel=1e-9)


@ROUNDS
@given(shapes(), shapes())
def test_areas_add_up(one: Loop, other: Loop) -> None:
    areas = [curves.area(outline(s)) for s in (one, other)]
    union = total("add", one, other)
    both = total("intersect", one, other)
    rest = total("subtract", one, other)
    # Slits thinner than the chords show are no area of either
    assert union + both == pytest.approx(sum(areas), rel=1e-4)
    assert rest + both == pytest.approx(areas[0], rel=1e-4)
    assume(both > 1e-3 and rest > 1e-3)
    assert union + both == pytest.approx(sum(areas), rel=1e-9)
    assert rest + both == pytest.approx(areas[0], rel=1e-9)


@ROUNDS
@given(shapes(), shapes())
def test_what_remains_is_closed_and_lies_on_the_curves(one: Loop, other: Loop) -> None:
    for region in combine([("add", one), ("add", other)]):
        for ring in (region.outer, *region.inner):
            after = ring[1:] + ring[:1]
            assert all(a.end == b.start for a, b in zip(ring, after, strict=True))
            assert curves.area(outline(ring)) > 0
            points = np.concatenate([curves.point_at(s, [0.0, 0.3, 0.7]) for s in ring])
            gaps = np.minimum(
                curves.distance(outline(one), points), curves.distance(outline(other), points)
            )
            assert gaps.max() < 1e-7


def test_a_ring_keeps_its_hole() -> None:
    (region,) = combine(
        [("add", ellipse((0.0, 0.0), (1.0, 1.0))), ("subtract", ellipse((0.1, 0.0), (0.5, 0.5)))]
    )
    assert len(region.inner) == 1
    assert area(region) == pytest.approx(np.pi * 0.75, rel=1e-12)


def test_where_edges_coincide_the_clamp_wins() -> None:
    free = held(outline(box(2, 1)), False).segments
    (region,) = combine([("add", free), ("intersect", box(1, 1))])
    assert all(s.clamped for s in region.outer)
    (other,) = combine([("add", free), ("intersect", box(1, 3))])
    assert sorted(s.clamped for s in other.outer) == [False, False, True, True]


def test_a_line_that_touches_an_arc_meets_it_at_its_end() -> None:
    slot = [box(2, 1), *(ellipse((x, 0.0), (0.5, 0.5)) for x in (-1.0, 1.0))]
    turned = [placed(outline(part), (0.3, 0.1), 0.7).segments for part in slot]
    (region,) = combine([("add", part) for part in turned])
    assert area(region) == pytest.approx(2 + np.pi / 4, rel=1e-12)
    assert outline(region.outer).corners == ()


@pytest.mark.parametrize("points", [5, 8, 20])
def test_a_spline_through_a_circle_is_smooth_and_nearly_round(points: int) -> None:
    angle = 2 * np.pi * np.arange(points) / points
    found = outline(spline(np.stack([np.cos(angle), np.sin(angle)], axis=1)))
    assert found.corners == ()
    # A cubic spline errs as the fourth power of the spacing
    radii = np.hypot(*curves.polyline(found, 720).T)
    assert np.abs(radii - 1).max() < 0.02 * (5 / points) ** 4 + 2e-6


def test_a_spline_passes_through_its_points_either_way_round() -> None:
    points = np.array([(1.0, 0.0), (0.2, 0.9), (-1.0, 0.3), (0.0, -0.5)])
    one = outline(spline(points))
    other = outline(spline(points[::-1]))
    assert curves.distance(one, points).max() < 1e-12
    assert curves.area(one) == pytest.approx(-curves.area(other), rel=1e-6)
    assert one.corners == other.corners == ()


def test_every_number_of_a_combined_shape_can_vary_in_a_sweep() -> None:
    text = """name = "any"
[outline]
kind = "combined"
[[outline.parts]]
shape = {kind = "square", side = "100 um"}
[[outline.parts]]
shape = {kind = "circle", diameter = "60 um"}
at = ["50 um", "0 um"]
[[holes]]
lattice = "rectangular"
pitch = ["20 um", "10 um"]
count = [2, 2]
shape = {kind = "rectangle", width = "6 um", height = "4 um", fillet = "1 um"}
[film]
thickness = "50 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
"""
    varied = {
        "outline.parts.2.at": ["60 um", "0 um"],
        "outline.parts.1.shape.side": "120 um",
        "holes.1.shape.fillet": "2 um",
    }
    tables = put(tomllib.loads(text), varied)
    model = GeometryFile.model_validate(tables).build("")
    x0, y0, x1, y1 = curves.box(model.outline)
    assert [x0, y0, x1, y1] == pytest.approx([-60e-6, -60e-6, 90e-6, 60e-6])
    fillets = {round(float(s.frame[0, 0]) * 1e6, 9) for s in model.openings[0].segments if s.centre}
    assert fillets == {2.0}
