"""The phase of a decay, where it was recorded and the signal is strong."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import ParameterSpec
from femnl.fits.decay.compared import FEWEST_BLOCKS, Compared
from femnl.fits.decay.fluctuation import Fluctuating, fluctuation, whitening
from femnl.fits.decay.stretch import Found
from femnl.fits.decay.window import PHASED, Window
from femnl.observe.decay.blocks import Blocks, Whitening, part_of
from femnl.observe.decay.law import turned_by_pair
from femnl.observe.decay.record import DB, PowerRecord, turning

Array = NDArray[np.float64]
ACROSS = 4.0
"""Variance of ln p over that of the phase: noise along an amplitude moves ln p twice as much."""


@dataclass(frozen=True, eq=False)
class Phase:
    """The phase of a decay: blocks of its first points, means (n,) [rad], noise, parameters."""

    blocks: Blocks
    values: Array
    noise: Whitening
    base: tuple[ParameterSpec, ...]
    start: Array


def phase_of(
    record: PowerRecord,
    seen: Window,
    data: Compared,
    checkpoint: Checkpoint | None,
) -> Phase | None:
    """Return the phase as long as the signal is strong, None where none was recorded."""
    if record.phase is None:
        return None
    weak = np.flatnonzero((data.log_ratio < PHASED / DB) | ~data.of_decay)
    count = int(weak[0]) if len(weak) else len(data.blocks.time)
    if count < FEWEST_BLOCKS:
        return None
    chosen = np.arange(len(data.blocks.time)) < count
    blocks = part_of(data.blocks, chosen)
    points = int(blocks.first[-1] + blocks.count[-1])
    used = np.flatnonzero(seen.used)[:points]
    time = record.time[used]
    rate, beside = turning(record.phase[used], time)
    values = blocks.mean(rate * (time - time[0]) + beside)
    # Of the noise behind the filter, half is across the amplitude
    share = 1 / (1 + np.exp(-data.log_ratio[chosen]))
    fluctuating = Fluctuating(
        blocks=blocks,
        time=data.time[:points],
        interval=data.interval,
        values=values - _beating(seen.found, time, blocks, values),
        share=share,
        read_share=np.ones(count),
        averages=ACROSS,
        strong=np.ones(count, dtype=bool),
        late=np.zeros(count, dtype=bool),
    )
    matrix, _ = fluctuation(fluctuating, checkpoint)
    slope, begin = np.polyfit(blocks.time, values, 1)
    highest = 0.5 / data.interval
    base = (
        ParameterSpec("phase", "rad", begin - 10 * np.pi, begin + 10 * np.pi),
        ParameterSpec("detuning", "Hz", -highest, highest),
    )
    noise = whitening(matrix)
    return Phase(blocks, values, noise, base, np.array([begin, slope / (2 * np.pi)]))


def _beating(found: Found, time: Array, blocks: Blocks, values: Array) -> Array:
    """Return what a pair turns of the phase (n,) [rad] where it beats, else 0: it is no noise.

    The power does not tell which of both turns faster; what leaves less beside a line does.
    """
    if "pair" not in found.likelihood.terms:
        return np.zeros(len(values))
    turned = blocks.mean(turned_by_pair(found.named, time - found.stretch.begin))
    line = np.stack([np.ones(len(values)), blocks.time], axis=1)

    def left(sign: float) -> float:
        away = values - sign * turned
        return float(np.sum((away - line @ np.linalg.lstsq(line, away, rcond=None)[0]) ** 2))

    return np.asarray(min((1.0, -1.0), key=left) * turned)
