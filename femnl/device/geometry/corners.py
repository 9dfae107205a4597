"""Rounded corners and arcs in the outlines of polygons."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femnl.core.errors import GeometryError
from femnl.core.outline import Segment
from femnl.device.geometry.naming import place

Array = NDArray[np.float64]

STRAIGHT = 1e-6  # rad, up to which two edges meet without a corner


def loop(corners: Array, clamped: ArrayLike = True) -> tuple[Segment, ...]:
    """Return the closed polygon through corners (n, 2)."""
    points = [(float(x), float(y)) for x, y in corners]
    held = np.broadcast_to(clamped, len(points))
    return tuple(
        Segment(a, b, None, bool(c))
        for a, b, c in zip(points, points[1:] + points[:1], held, strict=True)
    )


def arc_through(start: Array, middle: Array, end: Array, clamped: bool) -> Segment:
    """Return the circular arc from start to end through a third point (2,) [m].

    Its centre is that of the circle through all three: (c − a)·(m − a) = |m − a|²/2 and the same
    of the end.

    Raises:
        GeometryError: three points on one line.
    """
    to_middle = middle - start
    to_end = end - start
    area = to_middle[0] * to_end[1] - to_middle[1] * to_end[0]
    if abs(area) <= STRAIGHT * np.hypot(*to_middle) * np.hypot(*to_end):
        raise GeometryError(
            "lies on the line from corner to corner, or at one of them; leave the arc out or move "
            "the point aside"
        )
    halves = np.array([to_middle @ to_middle, to_end @ to_end]) / 2
    centre = start + np.linalg.solve(np.stack([to_middle, to_end]), halves)
    return Segment(_pair(start), _pair(end), _pair(centre), clamped, clockwise=bool(area < 0))


def rounded(segments: tuple[Segment, ...], radii: Array, names: list[str]) -> tuple[Segment, ...]:
    """Return an outline with an arc in the place of every corner whose radius is above 0.

    The arc touches both edges at r·tan(|turn|/2) from a corner where the outline turns by `turn`.

    Args:
        segments: closed and consecutive.
        radii: r [m] of the corner at which each segment starts, (n,).
        names: what messages call these corners.

    Raises:
        GeometryError: a corner between curves, or edges held unlike, or arcs longer than an edge.
    """
    count = len(segments)
    cuts = np.zeros(count)
    arcs: list[Segment | None] = [None] * count
    for k in np.flatnonzero(radii > 0):
        before = segments[k - 1]
        after = segments[k]
        place = f"[outline] fillet = {radii[k] * 1e6:.4g} um at {names[k]}"
        if before.centre is not None or after.centre is not None:
            raise GeometryError(f"{place}: one of its edges is an arc; give this corner no fillet")
        if before.clamped != after.clamped:
            raise GeometryError(
                f"{place}: one of its edges is clamped and the other free; give this corner no "
                "fillet"
            )
        incoming = _unit(before)
        outgoing = _unit(after)
        turn = np.arctan2(
            incoming[0] * outgoing[1] - incoming[1] * outgoing[0], incoming @ outgoing
        )
        if abs(turn) <= STRAIGHT:
            raise GeometryError(f"{place}: there is no corner; give this one no fillet")
        cuts[k] = radii[k] * np.tan(abs(turn) / 2)
        corner = np.asarray(after.start)
        start = corner - cuts[k] * incoming
        inward = np.sign(turn) * np.array([-incoming[1], incoming[0]])
        arcs[k] = Segment(
            _pair(start),
            _pair(corner + cuts[k] * outgoing),
            _pair(start + radii[k] * inward),
            after.clamped,
            clockwise=bool(turn < 0),
        )
    return _joined(segments, cuts, arcs, names)


def fillet_where_straight(segments: tuple[Segment, ...], radius: float) -> tuple[Segment, ...]:
    """Return an outline with an arc at every corner between straight edges that are held alike."""
    radii = np.zeros(len(segments))
    for k, after in enumerate(segments):
        before = segments[k - 1]
        straight = before.centre is None and after.centre is None
        if straight and before.clamped == after.clamped:
            radii[k] = radius
    names = [f"corner {place(np.array(s.start))}" for s in segments]
    return rounded(segments, radii, names)


def _joined(
    segments: tuple[Segment, ...], cuts: Array, arcs: list[Segment | None], names: list[str]
) -> tuple[Segment, ...]:
    """Shorten the edges by what the arcs at both ends take, and put the arcs between them."""
    found = []
    for k, segment in enumerate(segments):
        following = (k + 1) % len(segments)
        arc = arcs[k]
        after = arcs[following]
        if arc is not None:
            found.append(arc)
        length = float(np.hypot(*np.subtract(segment.end, segment.start)))
        left = length - cuts[k] - cuts[following]
        if left < -STRAIGHT * length:
            raise GeometryError(
                f"[outline] fillet at {names[k]} and {names[following]}: the arcs take "
                f"{(length - left) * 1e6:.4g} um of an edge of {length * 1e6:.4g} um; lower fillet"
            )
        # Arcs that take all of an edge meet in its middle
        if left <= STRAIGHT * length and segment.centre is None:
            if arc is not None and after is not None:
                found[-1] = replace(arc, end=after.start)
            continue
        start = segment.start if arc is None else arc.end
        end = segment.end if after is None else after.start
        found.append(replace(segment, start=start, end=end))
    return tuple(found)


def _unit(segment: Segment) -> Array:
    chord = np.subtract(segment.end, segment.start)
    return np.asarray(chord / np.hypot(*chord))


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
