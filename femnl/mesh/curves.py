"""Segments of an outline as curves: points, tangents and distances; corners that make the deflection singular."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.types.device import Outline, Segment

Array = NDArray[np.float64]

CORNER_ERROR = 1e-8  # energy left unresolved at a singular corner, relative to that around it


def point_on(segment: Segment, fraction: float) -> Array:
    """Return the point (2,) [m] at a fraction 0 … 1 of the way along a segment."""
    start, end = np.array(segment.start), np.array(segment.end)
    if segment.centre is None:
        return np.asarray(start + fraction * (end - start))
    centre = np.array(segment.centre)
    first, turn = arc_angles(segment)
    angle = first + fraction * turn
    return np.asarray(centre + np.linalg.norm(start - centre) * np.array([np.cos(angle), np.sin(angle)]))


def arc_angles(segment: Segment) -> tuple[float, float]:
    """Start angle and the angle walked counter-clockwise, of an arc."""
    (x0, y0), (x1, y1), (cx, cy) = segment.start, segment.end, segment.centre or (0.0, 0.0)
    first = np.arctan2(y0 - cy, x0 - cx)
    return first, (np.arctan2(y1 - cy, x1 - cx) - first) % (2 * np.pi) or 2 * np.pi


def distance_from(segment: Segment, where: Array) -> Array:
    """Distance of points (n, 2) from a segment of the outline."""
    start, end = np.array(segment.start), np.array(segment.end)
    if segment.centre is None:
        along = np.clip((where - start) @ (end - start) / np.sum((end - start) ** 2), 0, 1)
        return np.asarray(np.linalg.norm(where - start - along[:, None] * (end - start), axis=1))
    offset = where - segment.centre
    first, turn = arc_angles(segment)
    radius = np.linalg.norm(start - segment.centre)
    angle = (np.arctan2(offset[:, 1], offset[:, 0]) - first) % (2 * np.pi)
    on_arc = np.abs(np.linalg.norm(offset, axis=1) - radius)
    ends = np.minimum(np.linalg.norm(where - start, axis=1), np.linalg.norm(where - end, axis=1))
    return np.asarray(np.where(angle <= turn, on_arc, ends))


def singular_corners(outline: Outline, resolution: float) -> Iterator[tuple[Array, float]]:
    """Corners wider than 90° and the element size there.

    Near a corner of inner angle β the deflection goes as r^(π/β), so that elements of size s leave an energy s^(2π/β).
    """
    for before, after in zip(outline.segments[-1:] + outline.segments[:-1], outline.segments, strict=True):
        incoming, outgoing = tangent_at(before, 1.0), tangent_at(after, 0.0)
        turn = np.arctan2(incoming[0] * outgoing[1] - incoming[1] * outgoing[0], incoming @ outgoing)
        angle = np.pi - turn
        if angle > np.pi / 2 + 1e-6 and abs(turn) > 1e-6:
            side = np.linalg.norm(np.subtract(after.end, after.start))
            yield np.array(after.start), float(side * (CORNER_ERROR / resolution**8) ** (angle / (2 * np.pi)))


def tangent_at(segment: Segment, fraction: float) -> Array:
    """Return a vector (2,) along a segment at a fraction 0 … 1 of the way, of any length."""
    if segment.centre is None:
        return np.subtract(segment.end, segment.start)
    x, y = point_on(segment, fraction) - segment.centre
    return np.array([-y, x])
