"""Exact measures of outlines made of lines and arcs of circles and ellipses.

Area, box, inside or outside, distance, points to draw.
"""

import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femnl.core.outline import Outline, Segment

Array = NDArray[np.float64]
Coordinate = TypeVar("Coordinate", float, Array)

SAMPLES = 129  # points along an ellipse from which the nearest one to a point is looked for
NEWTON = 8  # steps from there


def turn(segment: Segment) -> float:
    """Return the angle [rad] that an arc walks about its centre; 0 for a line.

    In (0, 2π) counter-clockwise, in (−2π, 0) clockwise. Of an ellipse it is the eccentric angle,
    that of the circle which the ellipse is the image of.
    """
    if segment.centre is None:
        return 0.0
    ax, ay = _on_unit_circle(segment, *segment.start)
    bx, by = _on_unit_circle(segment, *segment.end)
    angle = math.atan2(ax * by - ay * bx, ax * bx + ay * by) % (2 * math.pi)
    return angle - 2 * math.pi if segment.clockwise else angle


def point_at(segment: Segment, fraction: ArrayLike) -> Array:
    """Return points (..., 2) [m] at fractions of a segment's length or turn, from 0 to 1."""
    part = np.asarray(fraction, float)[..., None]
    start = np.asarray(segment.start)
    if segment.centre is None:
        return np.asarray(start + part * (np.asarray(segment.end) - start))
    x, y = _on_unit_circle(segment, *segment.start)
    angle = part * turn(segment)
    circle = np.cos(angle) * (x, y) + np.sin(angle) * (-y, x)
    return np.asarray(np.asarray(segment.centre) + circle @ segment.frame.T)


def radius(segment: Segment) -> float:
    """Return the smallest radius of curvature of an arc [m], 0 for a line."""
    if segment.centre is None:
        return 0.0
    short, long = sorted(half_axes(segment))
    return short**2 / long


def half_axes(segment: Segment) -> tuple[float, float]:
    """Return the two half axes of an arc [m], equal for a circle, 0 for a line."""
    if segment.centre is None:
        return 0.0, 0.0
    return segment.semi_axes or 2 * (math.dist(segment.start, segment.centre),)


def area(outline: Outline) -> float:
    """Return the area inside an outline [m²], holes not subtracted.

    ½∮ x dy − y dx, exact on lines and arcs.
    """
    total = 0.0
    for s in outline.segments:
        x, y = s.start if s.centre is None else s.centre
        total += x * (s.end[1] - s.start[1]) - y * (s.end[0] - s.start[0])
        total += math.prod(half_axes(s)) * turn(s)
    return total / 2


def box(outline: Outline) -> tuple[float, float, float, float]:
    """Return the smallest upright box around an outline.

    x and y of its lower left, then of its upper right corner [m].
    """
    points = [np.array([s.start for s in outline.segments])]
    for s in outline.segments:
        if s.centre is not None:
            # M e/|e| with e = Mᵀx is where the image M of the unit circle reaches farthest in x
            reach = s.frame @ s.frame.T / np.linalg.norm(s.frame, axis=1)
            extremes = np.asarray(s.centre) + np.concatenate([reach.T, -reach.T])
            points.append(extremes[_on_arc(s, extremes)])
    every = np.concatenate(points)
    (x0, y0) = every.min(0)
    (x1, y1) = every.max(0)
    return float(x0), float(y0), float(x1), float(y1)


def contains(outline: Outline, points: Array) -> NDArray[np.bool_]:
    """Return which of the points (n, 2) [m] lie inside an outline, holes not subtracted.

    The winding number: every segment turns about a point by the angle of its chord, and an arc by
    2π more, or less where it runs clockwise, where the point lies between chord and arc.
    """
    turns = np.zeros(len(points))
    for s in outline.segments:
        a = np.asarray(s.start) - points
        b = np.asarray(s.end) - points
        # No −0, for which arctan2 would turn the other way than `side < 0` says
        side = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] + 0.0
        turns += np.arctan2(side, np.sum(a * b, axis=1)) / (2 * np.pi)
        if s.centre is not None:
            within = np.hypot(*_unit(s, points).T) < 1
            # A counter-clockwise arc bulges to the right of its chord.
            if s.clockwise:
                turns -= (side >= 0) & within
            else:
                turns += (side < 0) & within
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
        elif s.semi_axes is None:
            ends = np.minimum(np.hypot(*(points - start).T), np.hypot(*(points - s.end).T))
            radius = s.frame[0, 0]
            gaps = np.where(
                _on_arc(s, points), np.abs(np.hypot(*(points - s.centre).T) - radius), ends
            )
        else:
            gaps = _distance_from_ellipse(s, points)
        nearest = np.minimum(nearest, gaps)
    return nearest


def off_ellipse(frame: Array, unit: Array) -> Array:
    """Return how far points lie outside of an ellipse (n,) [m], negative within, to first order.

    (ρ − 1) / |∇ρ| with ρ = 1 on the ellipse, right to a part of the distance over the radius of
    curvature.

    Args: frame (2, 2) [m]: takes the unit circle to the ellipse. unit (n, 2): the points where the
    ellipse is the unit circle.
    """
    size = np.linalg.norm(unit, axis=1)
    slope = np.linalg.norm(unit @ np.linalg.inv(frame), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((size - 1) * size / slope)


def gaps_from_ellipse(segment: Segment, points: Array) -> Array:
    """Return the distances (n,) [m] of points (n, 2) [m] beside an elliptical arc, to first order.

    They are infinite for points that the centre does not see through the arc.
    """
    gaps = np.abs(off_ellipse(segment.frame, _unit(segment, points)))
    return np.where(_on_arc(segment, points), gaps, np.inf)


def polyline(outline: Outline, per_turn: int = 180) -> Array:
    """Return points (n, 2) [m] along an outline, closed: the last is the first.

    Arcs are cut into `per_turn` pieces a full turn.
    """
    pieces = [
        point_at(s, np.arange(n) / n)
        for s in outline.segments
        for n in [max(1, round(abs(turn(s)) / (2 * np.pi) * per_turn))]
    ]
    return np.concatenate([*pieces, [outline.segments[0].start]])


def polylines(outlines: Sequence[Outline], per_turn: int = 180) -> list[Array]:
    """Return points (n, 2) [m] along each of many outlines, as `polyline` does along one.

    Circles are walked together, since films have thousands.
    """
    found: dict[int, Array] = {}
    circles = [k for k, outline in enumerate(outlines) if _is_circle(outline)]
    if circles:
        firsts = [outlines[k].segments[0] for k in circles]
        start = np.array([s.start for s in firsts])
        centre = np.array([s.centre for s in firsts])
        sense = np.array([-1 if s.clockwise else 1 for s in firsts])
        angle = 2 * np.pi / per_turn * np.arange(per_turn)
        turns = np.array([[*np.cos(angle), 1.0], [*np.sin(angle), 0.0]]).T
        spoke = start - centre
        across = sense[:, None] * np.stack([-spoke[:, 1], spoke[:, 0]], axis=1)
        around = turns @ np.stack([spoke, across], axis=1)
        around += centre[:, None]
        found = dict(zip(circles, around, strict=True))
    return [found[k] if k in found else polyline(rim, per_turn) for k, rim in enumerate(outlines)]


def _is_circle(outline: Outline) -> bool:
    """Whether a closed curve is one circle, however many arcs of it there are."""
    centre = outline.segments[0].centre
    return centre is not None and all(
        s.centre == centre and s.semi_axes is None for s in outline.segments
    )


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


def _unit(segment: Segment, points: Array) -> Array:
    """Return points (..., 2) where an arc's circle or ellipse becomes the unit circle."""
    return np.stack(_on_unit_circle(segment, points[..., 0], points[..., 1]), axis=-1)


def _on_unit_circle(
    segment: Segment, x: Coordinate, y: Coordinate
) -> tuple[Coordinate, Coordinate]:
    """Return where points (x, y) [m] come where an arc's circle or ellipse becomes the unit circle.

    Written out, as layouts of ten thousand openings ask for it a million times.
    """
    if segment.centre is None:
        raise ValueError("a line has no circle")
    dx = x - segment.centre[0]
    dy = y - segment.centre[1]
    if segment.semi_axes is None:
        size = math.dist(segment.start, segment.centre)
        return dx / size, dy / size
    a, b = segment.semi_axes
    c = math.cos(segment.angle)
    s = math.sin(segment.angle)
    return (c * dx + s * dy) / a, (c * dy - s * dx) / b


def _on_arc(segment: Segment, points: Array) -> NDArray[np.bool_]:
    """Return which points (n, 2) an arc's centre sees through the arc."""
    spoke = _unit(segment, np.asarray(segment.start))
    away = _unit(segment, points)
    angle = np.arctan2(spoke[0] * away[:, 1] - spoke[1] * away[:, 0], away @ spoke)
    sense = -1 if segment.clockwise else 1
    return np.asarray((sense * angle) % (2 * np.pi) <= abs(turn(segment)))


def _distance_from_ellipse(segment: Segment, points: Array) -> Array:
    """Return the distances (n,) [m] of points (n, 2) from an elliptical arc.

    The nearest of SAMPLES points along it, improved by Newton's method for (p(t) − q)·p'(t) = 0.
    """
    stops = point_at(segment, np.linspace(0, 1, SAMPLES))
    squared = np.sum((points[:, None] - stops) ** 2, axis=2)
    part = np.argmin(squared, axis=1) / (SAMPLES - 1)
    spoke = _unit(segment, np.asarray(segment.start))
    across = np.array([-spoke[1], spoke[0]])
    angle = turn(segment)
    for _ in range(NEWTON):
        c = np.cos(part * angle)[:, None]
        s = np.sin(part * angle)[:, None]
        outward = (c * spoke + s * across) @ segment.frame.T
        along = (c * across - s * spoke) @ segment.frame.T
        gap = outward + np.asarray(segment.centre) - points
        bend = np.sum(along**2, axis=1) - np.sum(gap * outward, axis=1)
        # Far inside the ellipse the distance has a largest value nearby, which is not wanted
        bend = np.where(bend > 0, bend, np.sum(along**2, axis=1))
        part = np.clip(part - np.sum(gap * along, axis=1) / bend / angle, 0, 1)
    found = np.hypot(*(point_at(segment, part) - points).T)
    return np.asarray(np.minimum(found, np.sqrt(squared.min(axis=1))))
