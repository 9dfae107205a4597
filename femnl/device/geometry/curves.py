"""Exact measures of outlines made of lines and arcs.

Area, box, inside or outside, distance, points to draw.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femnl.core.device import Outline, Segment

Array = NDArray[np.float64]


def radius(segment: Segment) -> float:
    """Return the radius of an arc [m], 0 for a line."""
    return (
        float(np.hypot(*np.subtract(segment.start, segment.centre)))
        if segment.centre is not None
        else 0.0
    )


def turn(segment: Segment) -> float:
    """Return the angle [rad] that an arc walks counter-clockwise, in (0, 2π); 0 for a line."""
    if segment.centre is None:
        return 0.0
    (ax, ay) = np.subtract(segment.start, segment.centre)
    (bx, by) = np.subtract(segment.end, segment.centre)
    return float(np.arctan2(ax * by - ay * bx, ax * bx + ay * by) % (2 * np.pi))


def point_at(segment: Segment, fraction: ArrayLike) -> Array:
    """Return points (..., 2) [m] at fractions of a segment's length, from 0 to 1."""
    part = np.asarray(fraction, float)[..., None]
    start = np.asarray(segment.start)
    if segment.centre is None:
        return np.asarray(start + part * (np.asarray(segment.end) - start))
    centre = np.asarray(segment.centre)
    spoke = start - centre
    angle = part * turn(segment)
    return np.asarray(
        centre + np.cos(angle) * spoke + np.sin(angle) * np.array([-spoke[1], spoke[0]])
    )


def area(outline: Outline) -> float:
    """Return the area inside an outline [m²], holes not subtracted.

    ½∮ x dy − y dx, exact on lines and arcs.
    """
    total = 0.0
    for s in outline.segments:
        centre = np.zeros(2) if s.centre is None else np.asarray(s.centre)
        chord = np.subtract(s.end, s.start)
        about = centre if s.centre is not None else np.asarray(s.start)
        total += about[0] * chord[1] - about[1] * chord[0] + radius(s) ** 2 * turn(s)
    return total / 2


def box(outline: Outline) -> tuple[float, float, float, float]:
    """Return the smallest upright box around an outline.

    x and y of its lower left, then of its upper right corner [m].
    """
    points = [np.array([s.start for s in outline.segments])]
    for s in outline.segments:
        if s.centre is not None:
            extremes = np.asarray(s.centre) + radius(s) * np.array(
                [[1, 0], [0, 1], [-1, 0], [0, -1]]
            )
            points.append(extremes[_on_arc(s, extremes)])
    every = np.concatenate(points)
    (x0, y0) = every.min(0)
    (x1, y1) = every.max(0)
    return float(x0), float(y0), float(x1), float(y1)


def contains(outline: Outline, points: Array) -> NDArray[np.bool_]:
    """Return which of the points (n, 2) [m] lie inside an outline, holes not subtracted.

    The winding number: every segment turns about a point by the angle of its chord, and an arc by
    2π more where the point lies between chord and arc.
    """
    turns = np.zeros(len(points))
    for s in outline.segments:
        a = np.asarray(s.start) - points
        b = np.asarray(s.end) - points
        # No −0, for which arctan2 would turn the other way than `side < 0` says
        side = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] + 0.0
        turns += np.arctan2(side, np.sum(a * b, axis=1)) / (2 * np.pi)
        if s.centre is not None:
            # A counter-clockwise arc bulges to the right of its chord.
            turns += (side < 0) & (np.hypot(*(points - s.centre).T) < radius(s))
    return np.asarray(np.rint(turns) > 0)


def distance(outline: Outline, points: Array) -> Array:
    """Return the distances (n,) [m] of points (n, 2) from an outline, without sign."""
    nearest = np.full(len(points), np.inf)
    for s in outline.segments:
        start = np.asarray(s.start)
        chord = np.subtract(s.end, s.start)
        if s.centre is None:
            along = np.clip((points - start) @ chord / (chord @ chord), 0, 1)
            gaps = np.hypot(*(points - start - along[:, None] * chord).T)
        else:
            ends = np.minimum(np.hypot(*(points - start).T), np.hypot(*(points - s.end).T))
            gaps = np.where(
                _on_arc(s, points), np.abs(np.hypot(*(points - s.centre).T) - radius(s)), ends
            )
        nearest = np.minimum(nearest, gaps)
    return nearest


def polyline(outline: Outline, per_turn: int = 180) -> Array:
    """Return points (n, 2) [m] along an outline, closed: the last is the first.

    Arcs are cut into `per_turn` pieces a full turn.
    """
    pieces = [
        point_at(s, np.arange(n) / n)
        for s in outline.segments
        for n in [max(1, round(turn(s) / (2 * np.pi) * per_turn))]
    ]
    return np.concatenate([*pieces, [outline.segments[0].start]])


def widths(outline: Outline, samples: int = 9) -> Array:
    """Return for each segment the narrowest width of the film across it [m].

    From points along it straight in to the outline again.

    Valid: widths above a thousandth of the outline's length; nearer than that, an arc's polyline is
    its own neighbour.
    """
    loop = polyline(outline)
    start = loop[:-1]
    chord = np.diff(loop, axis=0)
    narrowest = []
    for s in outline.segments:
        where = point_at(s, (np.arange(samples) + 0.5) / samples)
        ahead = point_at(s, (np.arange(samples) + 0.6) / samples)
        along = ahead - where
        inward = np.stack([-along[:, 1], along[:, 0]], 1) / np.hypot(*along.T)[:, None]
        # where + t·inward = start + f·chord
        determinant = inward[:, None, 0] * -chord[:, 1] + inward[:, None, 1] * chord[:, 0]
        gap = start - where[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (gap[..., 1] * chord[:, 0] - gap[..., 0] * chord[:, 1]) / determinant
            f = (inward[:, None, 0] * gap[..., 1] - inward[:, None, 1] * gap[..., 0]) / determinant
        hit = (t > 1e-3 * outline.length) & (f >= 0) & (f <= 1)
        narrowest.append(np.min(t, where=hit, initial=np.inf))
    return np.array(narrowest)


def _on_arc(segment: Segment, points: Array) -> NDArray[np.bool_]:
    """Return which points (n, 2) an arc's centre sees through the arc."""
    centre = np.asarray(segment.centre)
    spoke = np.asarray(segment.start) - centre
    away = points - centre
    angle = np.arctan2(spoke[0] * away[:, 1] - spoke[1] * away[:, 0], away @ spoke) % (2 * np.pi)
    return np.asarray(angle <= turn(segment))
