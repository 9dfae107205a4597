"""Measures of outlines are exact.

Area, box, inside or outside, distance, and the scallops of an etched film.
"""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.geometry import curves, load
from femnl.device.geometry.outlines import Etched
from femnl.device.geometry.shapes import ellipse

Array = NDArray[np.float64]
NAMES = [
    "circle",
    "hexagon-278um",
    "rectangle",
    "square-270um-etched",
    "hexagon-278um-etched",
    "trampoline",
]


def etched(centres: Array, radius: float) -> Outline:
    return Etched.model_validate({"kind": "etched", "etch_radius": f"{radius} um"}).outline(
        Holes(centres * 1e-6, 1e-9)
    )


def chain(seed: int, number: int, step: float) -> Array:
    """Centres of a random walk, every one nearer to its predecessor than `step`."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-0.4, 0.4, number).cumsum()
    length = rng.uniform(0.6 * step, step, number)
    return np.cumsum(length[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1), axis=0)


def area_by_scan_lines(centres: Array, radius: float, lines: int) -> float:
    """Area of a union of discs.

    Lengths of the merged intervals on horizontal lines, by the midpoint rule.
    """
    low = centres[:, 1].min() - radius
    high = centres[:, 1].max() + radius
    spacing = (high - low) / lines
    total = 0.0
    for y in low + spacing * (np.arange(lines) + 0.5):
        near = centres[np.abs(centres[:, 1] - y) < radius]
        half = np.sqrt(radius**2 - (near[:, 1] - y) ** 2)
        order = np.argsort(near[:, 0] - half)
        begin = (near[:, 0] - half)[order]
        reach = np.maximum.accumulate((near[:, 0] + half)[order])
        total += spacing * (np.sum(reach - begin) - np.sum(np.maximum(reach[:-1] - begin[1:], 0)))
    return total


def area_of_patch(polygon: float, edges: int, pitch: float, radius: float) -> float:
    """Area freed around a convex lattice patch.

    Its polygon, a strip of arcs along every edge, corners that add up to a disc.
    """
    strip = pitch / 2 * np.sqrt(radius**2 - pitch**2 / 4) + radius**2 * np.arcsin(
        pitch / (2 * radius)
    )
    return float(polygon + edges * strip + np.pi * radius**2)


def test_the_etched_square_and_hexagon_have_the_area_of_their_closed_form() -> None:
    square = area_of_patch((29 * 8.56) ** 2, 4 * 29, 8.56, 10.88)
    assert curves.area(load("square-270um-etched").outline) == pytest.approx(
        square * 1e-12, rel=1e-12
    )
    hexagon = area_of_patch(1.5 * np.sqrt(3) * (15 * 8.56) ** 2, 6 * 15, 8.56, 10.95)
    assert curves.area(load("hexagon-278um-etched").outline) == pytest.approx(
        hexagon * 1e-12, rel=1e-12
    )


@pytest.mark.parametrize("seed", range(8))
def test_the_area_of_irregular_discs_agrees_with_scan_lines(seed: int) -> None:
    centres = chain(seed, 40, 14.0)
    reference = area_by_scan_lines(centres, 10.0, 10_000)
    assert curves.area(etched(centres, 10.0)) == pytest.approx(reference * 1e-12, rel=1e-6)


def test_two_discs_have_the_area_of_two_less_their_lens() -> None:
    radius = 10.0
    gap = 13.0
    lens = 2 * radius**2 * np.arccos(gap / (2 * radius)) - gap / 2 * np.sqrt(4 * radius**2 - gap**2)
    outline = etched(np.array([[0.0, 0.0], [5.0, 12.0]]), radius)
    assert len(outline.segments) == 2
    assert min(curves.turn(s) for s in outline.segments) > np.pi
    assert curves.area(outline) == pytest.approx((2 * np.pi * radius**2 - lens) * 1e-12, rel=1e-13)


def test_one_hole_is_etched_to_a_circle() -> None:
    outline = etched(np.array([[3.0, 4.0]]), 10.0)
    assert curves.area(outline) == pytest.approx(np.pi * 1e-10, rel=1e-13)
    np.testing.assert_allclose(curves.box(outline), [-7e-6, -6e-6, 13e-6, 14e-6], rtol=1e-13)


@pytest.mark.parametrize("seed", range(4))
def test_a_point_lies_in_the_etched_film_where_a_hole_is_nearer_than_the_etch_radius(
    seed: int,
) -> None:
    centres = chain(seed, 40, 14.0)
    outline = etched(centres, 10.0)
    rng = np.random.default_rng(seed)
    points = rng.uniform(centres.min(0) - 15, centres.max(0) + 15, (20_000, 2))
    gaps = np.asarray(cKDTree(centres).query(points)[0])
    np.testing.assert_array_equal(curves.contains(outline, points * 1e-6), gaps < 10)


@pytest.mark.parametrize("name", NAMES)
def test_area_and_contains_agree_on_random_points(name: str) -> None:
    outline = load(name).outline
    rng = np.random.default_rng(7)
    number = 40_000
    x0, y0, x1, y1 = curves.box(outline)
    points = rng.uniform([x0, y0], [x1, y1], (number, 2))
    share = curves.area(outline) / ((x1 - x0) * (y1 - y0))
    deviation = np.sqrt(share * (1 - share) / number) + 1e-12
    assert abs(curves.contains(outline, points).mean() - share) < 4 * deviation


@pytest.mark.parametrize("name", NAMES)
def test_points_on_the_outline_are_at_no_distance_and_points_beside_it_change_sides(
    name: str,
) -> None:
    outline = load(name).outline
    fractions = np.array([0.2, 0.5, 0.8])
    on = np.concatenate([curves.point_at(s, fractions) for s in outline.segments])
    assert curves.distance(outline, on).max() < 1e-13 * 1e-6 + 1e-12 * outline.length
    ahead = np.concatenate([curves.point_at(s, fractions + 1e-7) for s in outline.segments]) - on
    left = 1e-9 * np.stack([-ahead[:, 1], ahead[:, 0]], 1) / np.hypot(*ahead.T)[:, None]
    assert curves.contains(outline, on + left).all()
    assert not curves.contains(outline, on - left).any()
    np.testing.assert_allclose(curves.distance(outline, on + left), 1e-9, rtol=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_distances_agree_with_a_fine_polyline(name: str) -> None:
    outline = load(name).outline
    rng = np.random.default_rng(3)
    points = rng.uniform(-outline.length, outline.length, (500, 2))
    fine = np.concatenate([curves.point_at(s, np.linspace(0, 1, 2001)) for s in outline.segments])
    np.testing.assert_allclose(
        curves.distance(outline, points),
        cKDTree(fine).query(points)[0],
        atol=1e-4 * outline.length,
        rtol=1e-4,
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_polyline_is_closed_and_stays_on_the_outline(name: str) -> None:
    outline = load(name).outline
    line = curves.polyline(outline)
    np.testing.assert_array_equal(line[0], line[-1])
    assert curves.distance(outline, line).max() < 1e-12 * outline.length
    x, y = line.T
    inscribed = np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2
    assert inscribed == pytest.approx(curves.area(outline), rel=2e-3)


@pytest.mark.parametrize("clockwise", [False, True])
def test_many_polylines_are_those_of_each_curve(clockwise: bool) -> None:
    around = ellipse((3e-6, -1e-6), (2e-6, 2e-6))
    third = np.radians(120) + np.radians(17)
    start = (3e-6 + 2e-6 * float(np.cos(third)), -1e-6 + 2e-6 * float(np.sin(third)))
    arcs = [(start, around[0].start), (around[0].start, start)]
    unequal = [Segment(a, b, around[0].centre, clockwise=clockwise) for a, b in arcs]
    rims = [
        load("square-270um").outline,
        Outline("path", tuple(unequal), None, 4e-6),
        Outline("circle", around, None, 4e-6),
        Outline("ellipse", ellipse((0.0, 0.0), (2e-6, 1e-6)), None, 4e-6),
    ]
    lines = curves.polylines(rims, 36)
    for rim, line in zip(rims, lines, strict=True):
        np.testing.assert_array_equal(line[0], line[-1])
        assert curves.distance(rim, line).max() < 1e-12 * rim.length
    for k in (0, 2, 3):
        np.testing.assert_allclose(lines[k], curves.polyline(rims[k], 36), atol=1e-20)
    # Equal steps all around the circle, which is walked as its first arc is
    x, y = np.subtract(lines[1], (3e-6, -1e-6)).T
    steps = np.diff(np.unwrap(np.arctan2(y, x)))
    np.testing.assert_allclose(steps, (-1 if clockwise else 1) * np.pi / 18, rtol=1e-9)


def test_a_ring_of_discs_leaves_a_pillar_and_is_refused() -> None:
    angle = 2 * np.pi * np.arange(12) / 12
    with pytest.raises(
        GeometryError, match=r"leaves pillars under the film \(1\), one at \(0, 0\) um"
    ):
        etched(30 * np.stack([np.cos(angle), np.sin(angle)], 1), 9.0)
