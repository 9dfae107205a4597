"""Holes that overlap, touch or leave the film."""

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry import curves
from femnl.device.geometry.naming import name

Array = NDArray[np.float64]

TOUCHING = 1e-9
"""A web of film narrower than this part of the hole's radius is rounding: the rims touch."""


def refuse_overlap(holes: Holes) -> None:
    """Refuse holes that overlap or touch each other.

    Raises:
        GeometryError: naming the first such pair.
    """
    if len(holes.centres) < 2:
        return
    from scipy.spatial import cKDTree

    gaps, nearest = (
        np.asarray(found) for found in cKDTree(holes.centres).query(holes.centres, k=2)
    )
    close = np.flatnonzero(gaps[:, 1] <= 2 * holes.radius * (1 + TOUCHING))
    if len(close):
        first = int(close[0])
        gap = gaps[close[0], 1]
        # Of coincident holes the nearest neighbour may be listed first.
        second = int(nearest[first, 1] if nearest[first, 1] != first else nearest[first, 0])
        verb = "overlap" if gap < 2 * holes.radius * (1 - TOUCHING) else "touch"
        raise GeometryError(
            f"[holes] {name(holes, first)} and {name(holes, second)} {verb}: their centres are "
            f"{gap * 1e6:.4g} um apart and their radius is {holes.radius * 1e6:.4g} um; move them "
            "apart or lower radius",
            _point(holes.centres[first]),
        )


def refuse_outside(holes: Holes, outline: Outline) -> None:
    """Refuse holes that lie outside the outline, cut it or touch it.

    Raises:
        GeometryError: naming the first such hole and counting the others.
    """
    if not len(holes.centres):
        return
    gaps = curves.distance(outline, holes.centres) * np.where(
        curves.contains(outline, holes.centres), 1, -1
    )
    bad = np.flatnonzero(gaps <= holes.radius * (1 + TOUCHING))
    if not len(bad):
        return
    depth = gaps[bad[0]] / holes.radius
    verb = (
        "lies outside" if depth <= TOUCHING - 1 else "cuts" if depth < 1 - TOUCHING else "touches"
    )
    others = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
    raise GeometryError(
        f"[holes] {name(holes, int(bad[0]))} of radius {holes.radius * 1e6:.4g} um {verb} the "
        f"outline{others}; use fewer holes, move them, lower radius or enlarge the outline",
        _point(holes.centres[bad[0]]),
    )


def _point(centre: Array) -> tuple[float, float]:
    return float(centre[0]), float(centre[1])
