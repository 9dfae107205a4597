"""Change points of a record: the straight pieces that its power in dB is made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
MOST_BLOCKS = 400
"""Blocks that a record is averaged to before change points are sought."""
FEWEST_BLOCKS = 4
"""Blocks of the shortest piece: fewer would show no spread of their own."""
PARAMETERS_PER_PIECE = 4
"""A piece has a place, a level, a slope and a spread."""
RESOLUTION = 0.05
"""dB: a smaller spread tells pieces apart by wobbles that no analyser reproduces."""


@dataclass(frozen=True)
class Piece:
    """One straight piece of a record.

    first, stop: its points are first … stop − 1; begin, end: times of its first and last point [s];
    high, low: power of the line there [dB], in this order; spread: rms about the line [dB];
    count: blocks that it was found from.
    """

    first: int
    stop: int
    begin: float
    end: float
    high: float
    low: float
    spread: float
    count: int

    @property
    def duration(self) -> float:
        """Time from the first to the last point [s]."""
        return self.end - self.begin

    @property
    def fall(self) -> float:
        """Power at the begin over that at the end [dB]."""
        return self.high - self.low

    @property
    def slope(self) -> float:
        """Change of power with time [dB/s]."""
        return -self.fall / self.duration

    @property
    def middle(self) -> float:
        """Power in the middle [dB]."""
        return 0.5 * (self.high + self.low)


def pieces(time: Array, power: Array, resolution: float = RESOLUTION) -> tuple[Piece, ...]:
    """Cut a record (n,) [s], [dB] into the straight pieces that explain it best.

    The pieces minimise Σ n ln(σ² + σ₀²) + PARAMETERS_PER_PIECE · ln n a piece, the Bayesian
    information criterion of lines with noise of an own size each. Spreads in a record differ by a
    factor of 1000 between a strong decay and the floor, so that one common spread would see only
    the floor.
    resolution σ₀ [dB]: a coarse one sees beats as scatter about one line.
    Source: Jackson et al., IEEE Signal Processing Letters 12, 105 (2005) (the recursion).
    """
    size = -(-len(time) // MOST_BLOCKS)
    count = len(time) // size
    used = slice(0, count * size)
    middle = time[used].reshape(count, size).mean(axis=1)
    level = power[used].reshape(count, size).mean(axis=1)
    cuts = _cuts(middle, level, resolution)
    found = []
    for start, stop in pairwise(cuts):
        part = slice(start, stop)
        slope, centre = np.polyfit(middle[part] - middle[start], level[part], 1)
        line = centre + slope * (middle[part] - middle[start])
        last = len(time) if stop == count else stop * size
        found.append(
            Piece(
                first=start * size,
                stop=last,
                begin=float(time[start * size]),
                end=float(time[last - 1]),
                high=float(centre + slope * (time[start * size] - middle[start])),
                low=float(centre + slope * (time[last - 1] - middle[start])),
                spread=float(np.sqrt(np.mean((level[part] - line) ** 2))),
                count=stop - start,
            )
        )
    return tuple(found)


def _cuts(time: Array, level: Array, resolution: float) -> list[int]:
    """Return where pieces begin, and the number of blocks: optimal partitioning."""
    n = len(level)
    x = (time - time[0]) / (time[-1] - time[0])
    y = level - level.mean()
    # Sums of 1, x, y, x², xy, y² up to each block give the squares about any line.
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (np.ones(n), x, y, x * x, x * y, y * y)]
    penalty = PARAMETERS_PER_PIECE * np.log(n)
    best = np.full(n + 1, np.inf)
    best[0] = 0.0
    previous = np.zeros(n + 1, dtype=np.intp)
    for stop in range(FEWEST_BLOCKS, n + 1):
        starts = np.arange(stop - FEWEST_BLOCKS + 1)
        m, sx, sy, sxx, sxy, syy = (total[stop] - total[starts] for total in sums)
        covariance = sxy - sx * sy / m
        squares = syy - sy**2 / m - covariance**2 / (sxx - sx**2 / m)
        cost = best[starts] + m * np.log(np.maximum(squares, 0.0) / m + resolution**2) + penalty
        previous[stop] = np.argmin(cost)
        best[stop] = cost[previous[stop]]
    cuts = [n]
    while cuts[-1] > 0:
        cuts.append(int(previous[cuts[-1]]))
    return cuts[::-1]


def points(chosen: Sequence[Piece]) -> Index:
    """Return the points of pieces, in their order."""
    return np.concatenate([np.arange(piece.first, piece.stop) for piece in chosen])
