"""Corners of an outline that make the deflection singular."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.geometry import curves
from femnl.types.device import Outline, Segment

Array = NDArray[np.float64]

CORNER_ERROR = 1e-8  # energy left unresolved at a singular corner, relative to that around it


def singular_corners(outline: Outline, resolution: float) -> Iterator[tuple[Array, float]]:
    """Yield corners wider than 90° and the element size [m] there.

    Near a corner of inner angle β the deflection goes as r^(π/β), so that elements of size s leave an energy s^(2π/β).
    """
    for before, after in zip(outline.segments[-1:] + outline.segments[:-1], outline.segments, strict=True):
        incoming, outgoing = _tangent(before, 1.0), _tangent(after, 0.0)
        turn = np.arctan2(incoming[0] * outgoing[1] - incoming[1] * outgoing[0], incoming @ outgoing)
        angle = np.pi - turn
        if angle > np.pi / 2 + 1e-6 and abs(turn) > 1e-6:
            side = np.linalg.norm(np.subtract(after.end, after.start))
            yield np.array(after.start), float(side * (CORNER_ERROR / resolution**8) ** (angle / (2 * np.pi)))


def _tangent(segment: Segment, fraction: float) -> Array:
    """A vector along a segment at a fraction of its length, of any length."""
    if segment.centre is None:
        return np.subtract(segment.end, segment.start)
    x, y = curves.point_at(segment, fraction) - segment.centre
    return np.array([-y, x])
