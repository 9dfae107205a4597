"""Narrow webs of film between holes, and between holes and the edge."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.device import Model
from femnl.core.memory import need_memory
from femnl.core.outline import CELL
from femnl.device.geometry import curves

Array = NDArray[np.float64]
Index = NDArray[np.int64]

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


def narrow_webs(model: Model, widest: float) -> dict[float, Array]:
    """Return places (n, 2) [m] in the webs between two rims, by the size of elements there.

    A web is where two different closed curves, rims of holes or the edge, come closer to each
    other than `ACROSS` times the size of elements that is there in any case.

    Args: widest: that size [m].
    """
    starts, ends, loop = _pieces(model, widest / 2)
    for _ in range(HALVINGS):
        width, _ = _across(starts, ends, loop)
        length = np.linalg.norm(ends - starts, axis=1)
        long = (length > width) & (width < ACROSS * widest + length)
        if not long.any():
            break
        middle = (starts[long] + ends[long]) / 2
        starts = np.concatenate([starts[~long], starts[long], middle])
        ends = np.concatenate([ends[~long], middle, ends[long]])
        loop = np.concatenate([loop[~long], loop[long], loop[long]])
    width, middle = _across(starts, ends, loop)
    narrow = width < ACROSS * widest
    size = width[narrow] / ACROSS
    octave = np.floor(np.log(size) / np.log(STEP))
    return {
        float(STEP**k): _thinned(middle[narrow][octave == k], STEP**k) for k in np.unique(octave)
    }


def _across(starts: Array, ends: Array, loop: Index) -> tuple[Array, Array]:
    """How far each piece is from the nearest one of another loop, and the place in between.

    Infinite where none is among its neighbours.
    """
    middle = (starts + ends) / 2
    neighbours = min(NEIGHBOURS, len(middle))
    away, other = (np.asarray(a) for a in cKDTree(middle).query(middle, k=neighbours))
    away = np.where(loop[other] == loop[:, None], np.inf, away)
    nearest = np.argmin(away, axis=1)
    each = np.arange(len(middle))
    return away[each, nearest], (middle + middle[other[each, nearest]]) / 2


def _pieces(model: Model, longest: float) -> tuple[Array, Array, Index]:
    """Starts and ends (n, 2) [m] of straight pieces of every closed curve, and which it is."""
    angle = 2 * np.pi * np.arange(PER_TURN + 1) / PER_TURN
    circle = model.holes.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline = model.edge_outline
    lines = [] if outline.kind == CELL else [curves.polyline(outline, PER_TURN)]
    lines += [centre + circle for centre in model.holes.centres]
    lines += [curves.polyline(opening, PER_TURN) for opening in model.openings]
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
    return begin, begin + step, loop[row]


def _thinned(points: Array, size: float) -> Array:
    """Return one of the points (n, 2) in each square of that size."""
    _, first = np.unique(np.floor(points / size), axis=0, return_index=True)
    return np.asarray(points[np.sort(first)])
