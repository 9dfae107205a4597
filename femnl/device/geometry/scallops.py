"""The outline of a film freed by an isotropic etch.

The boundary of the union of equal discs around all holes.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Segment
from femnl.device.geometry.naming import name, place

Array = NDArray[np.float64]

SLIVER = 1e-9
"""Arcs shorter than this [rad] are rounding where three circles meet in a point."""
MOST_PAIRS = 20_000_000
"""More overlapping discs than this would not fit into memory."""


def union_of_discs(holes: Holes, radius: float) -> tuple[Segment, ...]:
    """Return the boundary of the union of discs, exact arcs that meet in cusps, counter-clockwise.

    A neighbour at distance d < 2R covers the directions within arccos(d/2R) of its own on a disc's
    rim; what no neighbour covers is boundary.

    Args:
        holes: centres of the discs.
        radius: R [m].

    Raises:
        GeometryError: discs that do not hang together, or that leave pillars between them.
    """
    from scipy.spatial import cKDTree

    centres = holes.centres
    tree = cKDTree(holes.centres)
    if tree.count_neighbors(tree, 2 * radius) > MOST_PAIRS:
        raise GeometryError(
            f"[outline] etch_radius = {radius * 1e6:.4g} um reaches over too many holes; lower "
            "it or take fewer holes"
        )
    pairs = tree.query_pairs(2 * radius * (1 - SLIVER), output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    _refuse_pieces(holes, pairs, radius)
    if len(centres) == 1:
        return _full_circle(centres[0], radius)
    discs, first, last = _open_arcs(centres, pairs, radius)
    starts = centres[discs] + radius * np.stack([np.cos(first), np.sin(first)], axis=1)
    ends = centres[discs] + radius * np.stack([np.cos(last), np.sin(last)], axis=1)
    follower = _followers(starts, ends, radius)
    loops = list(_loops(follower))
    if len(loops) > 1:
        outer = max(loops, key=lambda loop: np.ptp(starts[loop], axis=0).max())
        pillar = starts[next(loop for loop in loops if loop is not outer)].mean(axis=0)
        raise GeometryError(
            f"[outline] etch_radius = {radius * 1e6:.4g} um leaves pillars under the film "
            f"({len(loops) - 1}), one at {place(pillar)}; raise etch_radius or lower pitch"
        )
    points = [(float(x), float(y)) for x, y in starts]
    middles = [(float(x), float(y)) for x, y in centres[discs]]
    return tuple(Segment(points[k], points[follower[k]], middles[k]) for k in loops[0])


def _open_arcs(
    centres: Array, pairs: NDArray[np.intp], radius: float
) -> tuple[NDArray[np.intp], Array, Array]:
    """Return the uncovered arcs: disc, start and end angle of each, start < end < start + 2π."""
    disc = pairs[:, 0]
    step = centres[pairs[:, 1]] - centres[pairs[:, 0]]
    half = np.arccos(np.hypot(*step.T) / (2 * radius))
    begin = (np.arctan2(step[:, 1], step[:, 0]) - half) % (2 * np.pi)
    # Two turns of covered intervals, disc after disc on one line: gaps that end in the second turn
    # have seen all neighbours.
    disc = np.tile(disc, 2)
    begin = np.concatenate([begin, begin + 2 * np.pi])
    half = np.tile(half, 2)
    order = np.lexsort([begin, disc])
    end = (begin + 2 * half)[order]
    begin = begin[order]
    disc = disc[order]
    line = 8 * np.pi * disc
    reach = np.maximum.accumulate(end + line) - line
    gap = np.flatnonzero(
        (disc[1:] == disc[:-1]) & (begin[1:] >= 2 * np.pi) & (begin[1:] - reach[:-1] > SLIVER)
    )
    return disc[gap], reach[gap], begin[gap + 1]


def _followers(starts: Array, ends: Array, radius: float) -> NDArray[np.intp]:
    """Return for every arc the one that starts where it ends."""
    from scipy.spatial import cKDTree

    gaps, follower = (np.asarray(found) for found in cKDTree(starts).query(ends))
    if np.any(gaps > 1e-6 * radius) or len(np.unique(follower)) < len(follower):
        raise GeometryError(
            f"[outline] etch_radius = {radius * 1e6:.6g} um: circles meet in a point there, and "
            "the film's edge is not a curve; change etch_radius by a nanometre"
        )
    return np.asarray(follower, dtype=np.intp)


def _loops(follower: NDArray[np.intp]) -> Iterator[list[int]]:
    """Follow the arcs around; each closed loop once."""
    seen = np.zeros(len(follower), dtype=bool)
    for first in range(len(follower)):
        loop = []
        arc = first
        while not seen[arc]:
            seen[arc] = True
            loop.append(arc)
            arc = int(follower[arc])
        if loop:
            yield loop


def _refuse_pieces(holes: Holes, pairs: NDArray[np.intp], radius: float) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    number = len(holes.centres)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(number, number))
    pieces, piece = connected_components(graph, directed=False)
    if pieces > 1:
        lone = int(np.flatnonzero(piece != piece[0])[0])
        raise GeometryError(
            f"[outline] etch_radius = {radius * 1e6:.4g} um leaves the film in {pieces} pieces: "
            f"{name(holes, 0)} and {name(holes, lone)} are not joined; raise etch_radius above "
            "half the pitch"
        )


def _full_circle(centre: Array, radius: float) -> tuple[Segment, ...]:
    x = float(centre[0])
    y = float(centre[1])
    right = (x + radius, y)
    left = (x - radius, y)
    return Segment(right, left, (x, y)), Segment(left, right, (x, y))
