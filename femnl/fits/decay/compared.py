"""What is compared of a decay: mean powers of blocks of points, and where laws are evaluated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from femnl.fits.decay.window import Window
from femnl.observe.decay.blocks import Blocks, in_blocks
from femnl.observe.decay.record import DB, PowerRecord

Array = NDArray[np.float64]
MOST_BLOCKS = 180
"""Blocks that a decay is compared in; its floor has as many as its length asks for."""
MOST_NODES = 32
"""Points of a block at which laws are evaluated: none changes much within a part of it so short."""
SHORTEST_FLOOR = 48
"""Points of a floor that show how large the noise is."""
FAINT = -3.0
"""ln S/N below which a datum counts as noise."""
SMOOTHED = 5
"""Blocks of the running median that tells the signal whatever its law."""
FEWEST_BLOCKS = 16
"""Blocks that a diagnosis needs."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Points of a decay (n,): time [s] from its begin, ln of the power; blocks of them.

    interval [s]: between points; floor: ln of the noise; averages of each power.
    """

    time: Array
    log_power: Array
    blocks: Blocks
    of_decay: NDArray[np.bool_]
    interval: float
    floor: float
    averages: float

    @property
    def middle(self) -> Array:
        """Logarithm of the mean power (n_blocks,)."""
        top = float(self.log_power.max())
        return top + np.log(self.blocks.mean(np.exp(self.log_power - top)))

    @property
    def smooth(self) -> Array:
        """Logarithm of the power (n_blocks,) that is expected, whatever the law of the signal."""
        # Noise alone fades far below its mean, often for several blocks. Where such a fade were the
        # expected power, a model below all data would cost less than one amid them.
        near = median_filter(self.middle, SMOOTHED, mode="nearest")
        return np.maximum(near, self.floor)

    @property
    def log_ratio(self) -> Array:
        """Logarithm of S/N (n_blocks,); a floor has no signal, however it fluctuates."""
        above = np.maximum(np.expm1(self.smooth - self.floor), np.exp(FAINT))
        return np.where(self.of_decay, np.log(above), FAINT)


def compared(record: PowerRecord, seen: Window) -> Compared:
    """Return the points that are compared, in blocks."""
    used = np.flatnonzero(seen.used)
    size = -(-int(np.count_nonzero(seen.decay)) // MOST_BLOCKS)
    number = (used - used[0]) // size
    # The floor begins a block of its own
    number = 2 * number + seen.floor[used]
    time = record.time[used] - record.time[used[0]]
    blocks = in_blocks(time, number, size * record.interval)
    log = record.power / DB
    likelihood = seen.found.likelihood
    floor = _floor(log[seen.floor], float(seen.found.values[2]) + seen.found.stretch.reference / DB)
    return Compared(
        time,
        log[used],
        blocks,
        seen.decay[used][blocks.first],
        record.interval,
        floor,
        likelihood.averages,
    )


def nodes(data: Compared) -> tuple[Array, Blocks]:
    """Return times (n,) [s] at which laws are evaluated, and their blocks: of long ones, some.

    They are the middles of equal parts of a block, so that means over both are the same but for
    the curvature within such a part.
    """
    blocks = data.blocks
    count = np.minimum(blocks.count, MOST_NODES)
    number = np.repeat(np.arange(len(count)), count.astype(int))
    first = np.flatnonzero(np.diff(number, prepend=-1))
    within = np.arange(len(number)) - first[number] + 0.5
    place = blocks.first[number] + (within * (blocks.count / count)[number]).astype(np.intp)
    return data.time[place], Blocks(first, count, blocks.time, blocks.width)


def _floor(late: Array, fitted: float) -> float:
    """Return ln of the noise: of what comes last (n,), where that is long, else as fitted."""
    if len(late) < SHORTEST_FLOOR:
        return fitted
    last = late[len(late) // 2 :]
    # The lower of both: a floor may begin with the end of the decay
    return min(fitted, float(last.max() + np.log(np.mean(np.exp(last - last.max())))))
