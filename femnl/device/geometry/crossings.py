"""Closed curves that cross or touch themselves, and the way round they are walked."""

from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from femnl.core.errors import GeometryError
from femnl.core.outline import Outline, Segment
from femnl.device.geometry import curves
from femnl.device.geometry.naming import place

Array = NDArray[np.float64]


def counter_clockwise(segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
    """Return the segments walked the way round that encloses an area, from the same point."""
    if curves.area(Outline("", segments, None, 0.0)) > 0:
        return segments
    return tuple(
        replace(s, start=s.end, end=s.start, clockwise=s.centre is not None and not s.clockwise)
        for s in segments[::-1]
    )


def refuse_curved_crossings(segments: tuple[Segment, ...], remedy: str) -> None:
    """Refuse arcs that meet another edge away from their ends, as far as 2° of an arc show."""
    pieces = [
        curves.point_at(s, np.linspace(0, 1, 2 + int(abs(curves.turn(s)) / np.radians(2))))
        for s in segments
    ]
    starts = np.concatenate([p[:-1] for p in pieces])
    ends = np.concatenate([p[1:] for p in pieces])
    first = _first_meeting(starts, ends, 1e-12 * np.ptp(starts, axis=0).max() ** 2)
    if first is not None:
        raise GeometryError(
            "[outline] its edges cross or touch near "
            f"{place(np.round(starts[first[0]], 9))}; {remedy}"
        )


def refuse_crossings(corners: Array, straight: NDArray[np.bool_]) -> None:
    """Refuse a polygon with edges of no length, or straight ones that meet away from corners.

    Args: straight (n,): which edges are no arcs; where there are arcs, their chords may cross.
    """
    number = len(corners)
    extent = np.ptp(corners, axis=0).max()
    ends = np.roll(corners, -1, axis=0)
    short = np.flatnonzero(np.hypot(*(ends - corners).T) <= 1e-9 * extent)
    if len(short):
        k = int(short[0])
        hint = (
            "the outline closes by itself, leave the last point out"
            if k == number - 1
            else "leave one of them out"
        )
        raise GeometryError(
            f"[outline] points {k + 1} and {(k + 1) % number + 1} coincide: {hint}",
            (float(corners[k][0]), float(corners[k][1])),
        )
    for k in np.flatnonzero(straight & np.roll(straight, -1)).tolist():
        chord = ends[k] - corners[k]
        # The neighbour on either side shares a corner, and must only not fold back onto this edge.
        after = ends[(k + 1) % number] - ends[k]
        if chord @ after < 0 and abs(_cross(chord, after)) <= 1e-9 * np.hypot(*chord) * np.hypot(
            *after
        ):
            raise GeometryError(
                f"[outline] points: edge {(k + 1) % number + 1} folds back onto edge {k + 1}; "
                "give the corners in order",
                (float(ends[k][0]), float(ends[k][1])),
            )
    first = _first_meeting(corners, ends, 1e-12 * extent**2) if straight.all() else None
    if first is not None:
        k, other = first
        raise GeometryError(
            f"[outline] points: edges {k + 1} and {other + 1} cross or touch; give the corners in "
            "order",
            (float(corners[k][0]), float(corners[k][1])),
        )


def _first_meeting(starts: Array, ends: Array, tolerance: float) -> tuple[int, int] | None:
    """Return the first two edges of a closed curve that meet and are no neighbours, if any do.

    Args: starts, ends: of its straight edges (n, 2). tolerance: see `_meet`.
    """
    edges = shapely.linestrings(np.stack([starts, ends], axis=1))
    one, other = shapely.STRtree(edges).query(edges)  # whose boxes meet
    apart = (other - one > 1) & (other - one < len(starts) - 1)
    one, other = one[apart], other[apart]
    meets = _meet(starts[one], ends[one], starts[other], ends[other], tolerance)
    pairs = sorted(zip(one[meets].tolist(), other[meets].tolist(), strict=True))
    return pairs[0] if pairs else None


def _meet(a: Array, b: Array, c: Array, d: Array, tolerance: float) -> NDArray[np.bool_]:
    """Return which of the segments a–b (n, 2) cross or touch c–d, where their boxes meet.

    Twice the areas below `tolerance` count as 0.
    """
    sides = [_cross(b - a, c - a), _cross(b - a, d - a), _cross(d - c, a - c), _cross(d - c, b - c)]
    c_side, d_side, a_side, b_side = (
        np.where(np.abs(s) <= tolerance, 0, np.sign(s)) for s in sides
    )
    return np.asarray((c_side * d_side <= 0) & (a_side * b_side <= 0))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
