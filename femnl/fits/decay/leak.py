"""A decay over a tone that stays: a drive that leaks on, with which the decay beats.

The power is |a e^{−γτ/2} + b e^{i(2πΔτ + φ)}|² + N, a sum of 1, e^{−γτ}, e^{−γτ/2} cos 2πΔτ and
e^{−γτ/2} sin 2πΔτ. On a grid of γ and Δ that is linear, so that no start is needed: straight pieces
tell nothing of a decay whose beats are as long as itself.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d

from femnl.fits.decay.memory import block_means
from femnl.observe.decay.law import Array
from femnl.observe.decay.phases import THRESHOLDS, Line, Segmentation
from femnl.observe.decay.pieces import Piece
from femnl.observe.decay.record import DB, PowerRecord

MOST_BLOCKS = 160
"""Blocks that a record is averaged to."""
FEWEST_BLOCKS = 48
"""Blocks in which beats are told from bends."""
RATES = np.geomspace(2.0, 60.0, 24)
"""Rates γ that are tried, times the duration."""
RIDGE = 1e-12
"""Part of the sum of squares that keeps a least-squares problem definite."""
FEWEST_CYCLES = 1.5
CYCLE = 0.25
"""Periods of the beats over the record, at least, and steps of their number."""
BLOCKS_PER_CYCLE = 6
SMOOTHED = 5
"""Blocks over which a mean tells how large the power is."""
FAINTEST = 1e-300
"""Power in parts of the largest, and squares, that are divided by at least."""
LEFT = 0.1
"""Part of what a decay into a floor leaves that a leak may leave."""
VISIBLE = 0.05
"""Amplitude of the weaker tone, in parts of the stronger one, from which on beats are seen."""
BEATS = 2.0
"""Periods of visible beats that tell them from a bend."""
GONE = 0.02
"""Amplitude of a mode, in parts of the leak's, that is no longer looked at."""
MOST_FALLS = 3
SHORT = 0.03
"""Largest falls after which the decay may begin, and how long one lasts, in parts of a record."""
COARSE = 0.03
LATER = 2.0
"""What the steps of a grid may leave, and the factor by which a later begin must leave less than an
earlier one that leaves more.
"""


@dataclass(frozen=True)
class Leak:
    """A decay over a leak: rate γ [1/s], and in parts of the decay's begin the leak's amplitude.

    splitting [Hz]; phase [rad] of the leak at the begin; left: of squares, in parts of what a decay
    into a floor leaves; beats: how many periods are visible.
    """

    rate: float
    ratio: float
    splitting: float
    phase: float
    left: float
    beats: float

    @property
    def as_pair(self) -> tuple[float, float, float, float]:
        """Parameters of a pair, in SI: ratio, rate of the partner, splitting and phase."""
        return self.ratio, 0.0, self.splitting, self.phase

    @property
    def shows(self) -> bool:
        """Whether there is such a leak beyond doubt."""
        return self.left < LEFT and self.beats >= BEATS and 0 < self.ratio < 1


def over_a_leak(record: PowerRecord, fine: Segmentation) -> tuple[Segmentation, Leak] | None:
    """Return a record whose decay goes from the switch-off down into a leak, and that leak.

    None where nothing beats with it.
    """
    tried = [(first, _leak(record, first, fine.recorded)) for first in _begins(fine)]
    shown = [(first, leak) for first, leak in tried if leak is not None and leak.shows]
    if not shown:
        return None
    least = min(leak.left for _, leak in shown)
    first, leak = next(one for one in shown if one[1].left <= max(COARSE, LATER * least))
    return _whole(record, fine, first, leak), leak


def _begins(fine: Segmentation) -> list[int]:
    """Return the points at which a decay may begin: the record's first, or one after a fall."""
    places = {0, fine.pieces[fine.decay[0]].first}
    whole = fine.pieces[-1].end - fine.pieces[0].begin
    falls = []
    for before, after in pairwise(fine.pieces):
        # A drive goes in a step, or as fast as the filter lets it
        at_once = before.fall if before.duration < SHORT * whole else 0.0
        fall = at_once + before.low - after.high
        if fall > THRESHOLDS.wander:
            falls.append((fall, after.first))
    return sorted(places | {first for _, first in sorted(falls)[-MOST_FALLS:]})


def _leak(record: PowerRecord, first: int, stop: int) -> Leak | None:
    """Return the leak that leaves the least of a record's points first … stop − 1.

    None where they are few, or where nothing falls.
    """
    size = max(-(-(stop - first) // MOST_BLOCKS), 1)
    if stop - first < FEWEST_BLOCKS * size:
        return None
    log_power = record.power[first:stop] / DB
    mean = block_means(np.exp(log_power - log_power.max()), size)
    time = block_means(record.time[first:stop] - record.time[first], size)
    best = _best_on_grid(time, mean)
    if best is None:
        return None
    duration = float(time[-1])
    _, own, cosine, sine = best.numbers
    ratio = float(np.hypot(cosine, sine) / (2 * own))
    mode = np.exp(-best.fall * time / (2 * duration))
    seen = np.minimum(ratio / mode, mode / ratio) > VISIBLE
    return Leak(
        rate=best.fall / duration,
        ratio=ratio,
        splitting=best.cycles / duration,
        phase=float(np.arctan2(-sine, cosine)),
        left=best.left,
        beats=best.cycles * float(np.mean(seen)),
    )


@dataclass(frozen=True)
class _OnGrid:
    """The rate and the splitting of a grid, both times the duration, that leave the least.

    numbers (4,): of 1, e^{−γτ}, and e^{−γτ/2} times cosine and sine. left: of squares, in parts of
    what the best rate leaves with the first two alone.
    """

    fall: float
    cycles: float
    numbers: Array
    left: float


def _best_on_grid(time: Array, mean: Array) -> _OnGrid | None:
    """Return the best rate and splitting for powers (n,) at times (n,) [s], None where none falls.

    Each power counts by its part of those around it: the noise grows with the power.
    """
    weight = 1 / np.maximum(uniform_filter1d(mean, SMOOTHED, mode="nearest"), FAINTEST)
    cycles = np.arange(FEWEST_CYCLES, len(mean) / BLOCKS_PER_CYCLE, CYCLE)
    turn = 2 * np.pi * np.outer(cycles, time / time[-1])
    least = np.inf
    floor = np.inf
    best = None
    for fall in RATES:
        mode = np.exp(-fall * time / (2 * time[-1]))
        plain = [np.ones_like(turn), np.broadcast_to(mode**2, turn.shape)]
        columns = np.stack([*plain, mode * np.cos(turn), mode * np.sin(turn)], axis=2)
        floor = min(floor, float(_least_squares(columns[:1, :, :2], mean, weight)[0][0]))
        squares, numbers = _least_squares(columns, mean, weight)
        squares = np.where(np.all(numbers[:, :2] > 0, axis=1), squares, np.inf)
        k = int(np.argmin(squares))
        if squares[k] < least:
            least = float(squares[k])
            best = (float(fall), float(cycles[k]), numbers[k])
    return None if best is None else _OnGrid(*best, left=least / max(floor, FAINTEST))


def _least_squares(columns: Array, mean: Array, weight: Array) -> tuple[Array, Array]:
    """Return what m sums of k columns leave of weighted squares, (m,), and their numbers (m, k).

    Args: columns (m, n, k); mean, weight (n,).
    """
    weighed = columns * weight[:, None]
    data = mean * weight
    across = np.swapaxes(weighed, 1, 2) @ weighed
    beside = np.swapaxes(weighed, 1, 2) @ data
    # Of columns that are nearly one, whatever is left out of them
    own = np.trace(across, axis1=1, axis2=2)[:, None, None]
    across = across + RIDGE * own * np.eye(columns.shape[2])
    numbers = np.linalg.solve(across, beside[..., None])[..., 0]
    left = data - (weighed @ numbers[..., None])[..., 0]
    return np.sum(left**2, axis=1), numbers


def _whole(record: PowerRecord, fine: Segmentation, first: int, leak: Leak) -> Segmentation:
    """Return a segmentation whose decay is all points from the first on, until the mode is gone."""
    before = [piece for piece in fine.pieces if piece.stop <= first]
    gone = record.time[first] - 2 * np.log(GONE * leak.ratio) / leak.rate
    stop = min(int(np.searchsorted(record.time, gone)), fine.recorded)
    time = record.time[[first, stop - 1]]
    top = float(record.power[first])
    slope = -DB * leak.rate
    low = top + slope * float(time[1] - time[0])
    own = Piece(first, stop, float(time[0]), float(time[1]), top, low, 0.0, stop - first)
    # A grid knows the slope to its own steps alone
    line = Line(float(time[0]), top, slope, abs(slope))
    return Segmentation((*before, own), line, (len(before),), (), fine.recorded)
