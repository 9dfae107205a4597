"""Narrow webs of film between holes, and between holes and the edge; holes that none is near to."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.device import Model
from femnl.core.memory import need_memory
from femnl.core.outline import CELL
from femnl.device.geometry import curves

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

PER_TURN = 72
"""Pieces of a round rim: 5° put the middle of a web between equal holes to 1e-3 of their radius."""
ACROSS = 1.5
"""Elements across a web: its stress falls off along it on a length of √(radius × width), which is
more than its width."""
STEP = 2.0
"""Sizes within this factor share one field of sizes: every place gets at least what it needs."""
NEIGHBOURS = 12
"""Pieces near one among which that of another rim is looked for: of its own rim, no more than
five lie within a width."""
PIECE_BYTES = 500
"""Of memory a piece, measured: its ends, its neighbours and how far they are."""
HALVINGS = 12
"""Of a piece of a rim, until it is shorter than the web beside it is wide."""


@dataclass(frozen=True)
class Pieces:
    """Straight pieces of every closed curve of a film: of the outline, holes and openings, in turn.

    Their starts and ends (n, 2) [m], and the number (n,) of the curve that each is a piece of.
    """

    starts: Array
    ends: Array
    loop: Index

    @property
    def lengths(self) -> Array:
        """How long they are (n,) [m]."""
        return np.asarray(np.linalg.norm(self.ends - self.starts, axis=1))

    @cached_property
    def middles(self) -> cKDTree:
        """Their middles, to look for the nearest."""
        return cKDTree((self.starts + self.ends) / 2)

    @cached_property
    def across(self) -> tuple[Array, Array]:
        """How far each is from the nearest of another curve, and the place (n, 2) in between [m].

        Infinite where none is among its neighbours.
        """
        middle = self.middles.data
        neighbours = min(NEIGHBOURS, len(middle))
        away, other = (np.asarray(a) for a in self.middles.query(middle, k=neighbours))
        away = np.where(self.loop[other] == self.loop[:, None], np.inf, away)
        nearest = np.argmin(away, axis=1)
        each = np.arange(len(middle))
        return away[each, nearest], (middle + middle[other[each, nearest]]) / 2

    def halved(self, which: Mask) -> "Pieces":
        """Return all, some of which (n,) are cut in two."""
        starts, ends, loop = self.starts[which], self.ends[which], self.loop[which]
        middle = (starts + ends) / 2
        return Pieces(
            np.concatenate([self.starts[~which], starts, middle]),
            np.concatenate([self.ends[~which], middle, ends]),
            np.concatenate([self.loop[~which], loop, loop]),
        )

    def alone(self, loops: Index, centres: Array, reach: Array) -> Mask:
        """Whether some of the curves (m,) have no other within a reach (m,) [m] of their centre."""
        within = self.middles.query_ball_point(centres, reach, return_length=True)
        return np.asarray(within == np.bincount(self.loop)[loops])


def narrow_webs(pieces: Pieces, widest: float) -> dict[float, Array]:
    """Return places (n, 2) [m] in the webs between two rims, by the size of elements there.

    A web is where two different closed curves, rims of holes or the edge, come closer to each
    other than `ACROSS` times the size of elements that is there in any case.

    Args:
        pieces: of all of these curves, no longer than half of that size.
        widest: that size [m].
    """
    for _ in range(HALVINGS):
        width, _ = pieces.across
        long = (pieces.lengths > width) & (width < ACROSS * widest + pieces.lengths)
        if not long.any():
            break
        pieces = pieces.halved(long)
    width, middle = pieces.across
    narrow = width < ACROSS * widest
    size = width[narrow] / ACROSS
    octave = np.floor(np.log(size) / np.log(STEP))
    return {
        float(STEP**k): _thinned(middle[narrow][octave == k], STEP**k) for k in np.unique(octave)
    }


def pieces_of(model: Model, longest: float) -> Pieces:
    """Return straight pieces, no longer than that [m], of every closed curve of a film."""
    angle = 2 * np.pi * np.arange(PER_TURN + 1) / PER_TURN
    circle = model.holes.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline = model.edge_outline
    lines = [] if outline.kind == CELL else [curves.polyline(outline, PER_TURN)]
    lines += [centre + circle for centre in model.holes.centres]
    lines += curves.polylines(model.openings, PER_TURN)
    starts = np.concatenate([line[:-1] for line in lines])
    ends = np.concatenate([line[1:] for line in lines])
    loop = np.repeat(np.arange(len(lines)), [len(line) - 1 for line in lines])
    number = np.ceil(np.linalg.norm(ends - starts, axis=1) / longest)
    need_memory(
        PIECE_BYTES * float(number.sum()),
        f"rims in {number.sum():.2g} pieces of {longest:.2g} m",
        "make the smallest openings larger or rounder, or lower the resolution",
    )
    number = number.astype(int)
    row = np.repeat(np.arange(len(starts)), number)
    part = np.arange(len(row)) - np.repeat(np.cumsum(number) - number, number)
    step = ((ends - starts) / number[:, None])[row]
    begin = starts[row] + part[:, None] * step
    return Pieces(begin, begin + step, loop[row])


def _thinned(points: Array, size: float) -> Array:
    """Return one of the points (n, 2) in each square of that size."""
    _, first = np.unique(np.floor(points / size), axis=0, return_index=True)
    return np.asarray(points[np.sort(first)])
