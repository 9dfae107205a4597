"""Circles, ellipses, arcs and fillets that a layout draws as many short chords."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.outline import Outline, Segment
from femnl.device.geometry.corners import arc_through
from femnl.device.geometry.shapes import ellipse
from femnl.device.layout.circles import FITTED, MOVED_ALL_AROUND, Circle, fitted, rounded
from femnl.device.layout.ellipses import WIDEST, whole_ellipse

Array = NDArray[np.float64]
Loop = tuple[Segment, ...]

FEWEST = 4
"""Chords that make an arc."""
ROUNDING = 0.75
"""Steps of the grid by which a corner may lie off its curve: rounding x and y takes 0.71."""
SHARPEST = np.radians(150.0)
"""A corner that turns by more has no fillet: its two edges meet far away."""


def recognise(corners: Array, grid: float) -> tuple[Loop, Counter[str]]:
    """Return the curves that a closed polygon (n, 2) [m] draws, and how many of each kind.

    All corners of a run lie within ROUNDING of the grid from the curve that takes their place. An
    arc that touches the two lines beside it becomes their fillet exactly; a radius becomes the
    roundest number that fits.
    """
    tolerance = ROUNDING * grid
    points = _without_straight_angles(corners, 1e-3 * grid)
    if len(points) >= 2 * np.pi / WIDEST:
        whole = _whole_curve(points, tolerance, grid)
        if whole is not None:
            return whole
    runs = _runs(points, tolerance, grid)
    return _loop(points, runs, tolerance, grid)


def circle_of(loop: Loop) -> tuple[Array, float] | None:
    """Return centre (2,) and radius of a loop that is one whole circle, else None."""
    first = loop[0]
    if first.centre is None or first.semi_axes is not None:
        return None
    if any(s.centre != first.centre or s.semi_axes is not None for s in loop):
        return None
    return np.array(first.centre), float(first.frame[0, 0])


def _whole_curve(points: Array, tolerance: float, grid: float) -> tuple[Loop, Counter[str]] | None:
    """Return the circle or ellipse that all corners lie on, if there is one."""
    spokes = points - points.mean(axis=0)
    turns = _cross(spokes[:-1], spokes[1:])
    chords = np.hypot(*(_next(points) - points).T)
    if not (np.all(turns > 0) or np.all(turns < 0)):
        return None
    circle = rounded(fitted(points), points, grid, MOVED_ALL_AROUND)
    if circle is not None and chords.max() <= WIDEST * circle.radius + 2 * tolerance:
        centre = (float(circle.centre[0]), float(circle.centre[1]))
        return ellipse(centre, (circle.radius, circle.radius)), Counter(circles=1)
    return whole_ellipse(points, FITTED * grid)


@dataclass(frozen=True)
class _Run:
    """Chords from corner `first` to corner `last` (which may exceed the number of corners)."""

    first: int
    last: int
    circle: Circle


def _runs(points: Array, tolerance: float, grid: float) -> list[_Run]:
    """Return runs of chords that lie on one circle each."""
    number = len(points)
    along = _next(points) - points
    before = _previous(along)
    turn = np.arctan2(_cross(before, along), np.sum(before * along, axis=1))
    gentle = np.abs(turn) <= WIDEST + 2 * tolerance / np.hypot(*along.T)
    # No arc runs past a sharp corner or, where all are gentle, past the longest straight edge
    sharp = np.flatnonzero(~gentle)
    offset = int(sharp[0]) if len(sharp) else int(np.argmax(np.hypot(*along.T)) + 1) % number
    found = []
    k = offset
    while k + FEWEST <= offset + number:
        run = _longest(points, turn, gentle, k, offset + number, FITTED * grid)
        if run is None:
            k += 1
            continue
        circle = rounded(run.circle, points[np.arange(k, run.last + 1) % number], grid)
        found.append(run if circle is None else _Run(run.first, run.last, circle))
        k = run.last
    return found


def _longest(
    points: Array, turn: Array, gentle: NDArray[np.bool_], first: int, end: int, tolerance: float
) -> _Run | None:
    """The longest run of chords on one circle that starts at a corner; None for fewer than four.

    One chord more does not lie on it. Runs are tried up to twice as long each time.
    """
    number = len(points)
    inner = np.arange(first + 1, end) % number
    bends = gentle[inner] & (turn[inner] * turn[inner[0]] > 0)
    farthest = end if bends.all() else first + 1 + int(np.argmin(bends))

    def run_to(last: int) -> _Run | None:
        some = points[np.arange(first, last + 1) % number]
        circle = fitted(some)
        if circle is None or circle.off(some) > tolerance:
            return None
        chords = np.hypot(*np.diff(some, axis=0).T)
        if chords.max() > WIDEST * circle.radius + 2 * tolerance:
            return None
        return _Run(first, last, circle)

    longest = run_to(first + FEWEST) if first + FEWEST <= farthest else None
    failed = farthest + 1
    while longest is not None and failed - longest.last > 1:
        last = min(2 * longest.last - first, (longest.last + failed) // 2)
        run = run_to(last)
        if run is None:
            failed = last
        else:
            longest = run
    return longest


def _loop(
    points: Array, runs: list[_Run], tolerance: float, grid: float
) -> tuple[Loop, Counter[str]]:
    """Put arcs and fillets in the place of runs of chords."""
    number = len(points)
    begins = {run.first % number: run for run in runs}
    start = runs[0].first % number if runs else 0
    found: list[Segment] = []
    counts: Counter[str] = Counter()
    fillets = []
    k = start
    while k < start + number:
        run = begins.get(k % number)
        last = k + 1 if run is None else k + run.last - run.first
        a = points[k % number]
        b = points[last % number]
        if run is None:
            found.append(Segment(_pair(a), _pair(b)))
        else:
            inner = points[np.arange(k, last + 1) % number]
            found.append(_arc(a, b, inner[len(inner) // 2], run.circle))
            fillets.append((len(found) - 1, run, inner))
        k = last
    for index, run, inner in fillets:
        if _make_fillet(found, index, run.circle, inner, tolerance, grid):
            counts["fillets"] += 1
        else:
            counts["arcs"] += 1
    return tuple(found), counts


def _arc(a: Array, b: Array, inner: Array, circle: Circle) -> Segment:
    """The arc from a to b through the point of a circle that is nearest to an inner one."""
    spoke = inner - circle.centre
    return arc_through(a, circle.centre + circle.radius * spoke / np.hypot(*spoke), b, True)


def _make_fillet(
    segments: list[Segment],
    index: int,
    circle: Circle,
    inner: Array,
    tolerance: float,
    grid: float,
) -> bool:
    """Make an arc touch the lines beside it, where its corners allow that."""
    before = segments[index - 1]
    after = segments[(index + 1) % len(segments)]
    if before.centre is not None or after.centre is not None or len(segments) < 3:
        return False
    one = np.subtract(before.end, before.start)
    other = np.subtract(after.end, after.start)
    one = one / np.hypot(*one)
    other = other / np.hypot(*other)
    turn = float(np.arctan2(_cross(one, other), one @ other))
    if not 1e-3 < abs(turn) < SHARPEST:
        return False
    corner = np.subtract(before.end, 0.0) + one * (
        _cross(np.subtract(after.start, before.end), other) / _cross(one, other)
    )
    inward = np.sign(turn) * np.array([-one[1], one[0]])
    cut = circle.radius * np.tan(abs(turn) / 2)
    # Drawn corners lie on the grid, turned ones do not
    for place in (np.round(corner / grid) * grid, corner):
        start = place - cut * one
        end = place + cut * other
        ideal = Circle(start + circle.radius * inward, circle.radius)
        # The tangent points are rounded like all others, along lines whose ends are rounded too
        if ideal.off(inner) <= 2 * tolerance:
            break
    else:
        return False
    far = max(np.hypot(*(start - inner[0])), np.hypot(*(end - inner[-1])))
    # Along the line a tangent point is known to the chord that leaves it by a rounding
    if far > 2 * tolerance + np.sqrt(8 * tolerance * circle.radius):
        return False
    segments[index - 1] = Segment(before.start, _pair(start))
    segments[index] = Segment(_pair(start), _pair(end), _pair(ideal.centre), clockwise=turn < 0)
    segments[(index + 1) % len(segments)] = Segment(_pair(end), after.end)
    return True


def _without_straight_angles(corners: Array, tolerance: float) -> Array:
    """Leave out corners that coincide with the next or lie on the line between their neighbours."""
    points = corners[np.hypot(*(_next(corners) - corners).T) > tolerance]
    if len(points) < 3:
        return np.asarray(points)
    before = points - _previous(points)
    after = _next(points) - points
    height = np.abs(_cross(before, after)) / np.hypot(*(before + after).T).clip(tolerance)
    return np.asarray(points[height > tolerance])


def _next(points: Array) -> Array:
    """Each point's neighbour after it around a loop, as np.roll finds it in five times the time."""
    return np.concatenate([points[1:], points[:1]])


def _previous(points: Array) -> Array:
    return np.concatenate([points[-1:], points[:-1]])


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def outline_of(loop: Loop) -> Outline:
    """Return a loop as an outline without a length."""
    return Outline("", loop, None, 0.0)
