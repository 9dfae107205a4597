"""Smooth closed curves through points, as arcs of circles."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from femnl.core.outline import Segment

Array = NDArray[np.float64]
Curve = Callable[[float], tuple[Array, Array]]
"""Point (2,) [m] and direction (2,) of a curve at a parameter."""

WITHIN = 1e-6
"""Of the extent: how far the arcs may lie from the spline."""
DEEPEST = 12  # halvings of the piece between two points


def spline(points: Array) -> tuple[Segment, ...]:
    """Return arcs along the closed cubic spline through points (n, 2) [m].

    Parametrised by the root of the distance from point to point (centripetal), which makes no
    loops; each pair of arcs has the spline's points and directions at both ends (biarcs) and lies
    within WITHIN of it.

    Source: Lee, Comput. Aided Des. 21 (1989) 363 (centripetal parameters); Bolton, Comput. Aided
    Des. 7 (1975) 89 (biarcs).
    """
    from scipy.interpolate import CubicSpline

    closed = np.concatenate([points, points[:1]])
    knots = np.concatenate([[0.0], np.cumsum(np.sqrt(np.hypot(*np.diff(closed, axis=0).T)))])
    through = CubicSpline(knots, closed, bc_type="periodic")
    slope = through.derivative()

    def curve(place: float) -> tuple[Array, Array]:
        along = np.asarray(slope(place))
        return np.asarray(through(place)), along / np.hypot(*along)

    tolerance = WITHIN * float(np.ptp(points, axis=0).max())
    found: list[Segment] = []
    for low, high in pairwise(knots):
        found += arcs_along(curve, float(low), float(high), tolerance)
    return tuple(found)


def arcs_along(
    curve: Curve, low: float, high: float, tolerance: float, depth: int = 0
) -> list[Segment]:
    """Return arcs and lines along a piece of a smooth curve, within a tolerance [m] of it."""
    start = curve(low)
    end = curve(high)
    pair = _biarc(*start, *end)
    inner = np.array([curve(low + part * (high - low))[0] for part in (0.2, 0.4, 0.6, 0.8)])
    gaps = np.min([_gaps(segment, inner) for segment in pair], axis=0)
    if gaps.max() <= tolerance or depth == DEEPEST:
        return pair
    middle = (low + high) / 2
    return [
        *arcs_along(curve, low, middle, tolerance, depth + 1),
        *arcs_along(curve, middle, high, tolerance, depth + 1),
    ]


def _biarc(a: Array, along_a: Array, b: Array, along_b: Array) -> list[Segment]:
    """Return two arcs that leave a along one direction and reach b along the other.

    With equal tangent lengths d they meet in the middle of a + d t_a and b − d t_b, where
    |b − a − d (t_a + t_b)| = 2d.
    """
    chord = b - a
    both = along_a + along_b
    # (2 − 2 t_a·t_b) d² + 2 d chord·both − |chord|² = 0
    square = 4 - both @ both
    linear = 2 * chord @ both
    size = chord @ chord
    if square < 1e-12:
        length = size / linear
    else:
        length = (-linear + np.sqrt(linear**2 + 4 * square * size)) / (2 * square)
    middle = (a + length * along_a + b - length * along_b) / 2
    return [_arc_from(a, along_a, middle), _arc_into(middle, b, along_b)]


def _arc_from(start: Array, along: Array, end: Array) -> Segment:
    """Return the arc that leaves `start` in a direction and ends at `end`."""
    chord = end - start
    across = np.array([-along[1], along[0]])
    offset = float(chord @ across)
    ends = (_pair(start), _pair(end))
    if abs(offset) < 1e-9 * np.hypot(*chord):
        return Segment(*ends)
    radius = float(chord @ chord) / (2 * offset)
    return Segment(*ends, _pair(start + radius * across), clockwise=offset < 0)


def _arc_into(start: Array, end: Array, along: Array) -> Segment:
    back = _arc_from(end, -along, start)
    if back.centre is None:
        return Segment(back.end, back.start)
    return Segment(back.end, back.start, back.centre, clockwise=not back.clockwise)


def _gaps(segment: Segment, points: Array) -> Array:
    """Distances (n,) of points (n, 2) from the circle or line that a segment is part of."""
    if segment.centre is not None:
        radius = np.hypot(*np.subtract(segment.start, segment.centre))
        return np.asarray(np.abs(np.hypot(*(points - segment.centre).T) - radius))
    chord = np.subtract(segment.end, segment.start)
    away = points - segment.start
    return np.asarray(np.abs(away[:, 0] * chord[1] - away[:, 1] * chord[0]) / np.hypot(*chord))


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
