"""From a decay in a file to its model: what is compared, its noise, and where fits start."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.ndimage import median_filter

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import ParameterSpec
from femnl.core.errors import MeasurementError
from femnl.fits.decay.fluctuation import Fluctuating, fluctuation
from femnl.fits.decay.likelihood import FAINTEST_FLOOR
from femnl.fits.decay.window import Window, listed, window
from femnl.observe.decay.blocks import (
    Blocks,
    Wander,
    Whitening,
    drifting,
    in_blocks,
    normal_scale,
    part_of,
)
from femnl.observe.decay.model import DecayModel
from femnl.observe.decay.record import DB, PowerRecord, power_record
from femnl.observe.film import SimulatedFilm

Array = NDArray[np.float64]
MOST_BLOCKS = 180
"""Blocks that a decay is compared in; its floor has as many as its length asks for."""
MOST_NODES = 32
"""Points of a block at which laws are evaluated: none changes much within a part of it so short."""
FEWEST_BLOCKS = 16
"""Blocks that a diagnosis needs."""
SHORTEST_FLOOR = 48
"""Points of a floor that show how large the noise is."""
ACROSS = 4.0
"""Variance of ln p over that of the phase: noise along an amplitude moves ln p twice as much."""
STRONG = 20.0
"""Signal over noise from which on a phase can be followed from point to point."""
GAIN = 0.2
"""dB by which the gain of a readout drifts slowly: light, polarisation, and the working point.

Bends hide it in one record; repeats of a mode show it, whose rates differ by 3 %.
"""
SLOW = 1 / 6
"""Time within which that drift is smooth, in parts of the decay."""
CLEAR = 1.1
"""ln S/N from which on a decay tells its noise."""
FAINT = -3.0
"""ln S/N below which a datum counts as noise."""
SMOOTHED = 5
"""Blocks of the running median that tells the signal whatever its law."""
CURVATURE = 0.1
"""1/A0²: the unit of nonlinear damping, of which forty at most are told, ηA0²/4 = 10."""
FARTHEST = 50.0
"""Factor between the rate of the straight part and that of small motion, at most."""
OWN = 0.01
"""Part of the standard deviation of a block's noise that no neighbour shares, at least."""
REACH = 80.0
"""dB by which level and floor may be beside the data."""


@dataclass(frozen=True, eq=False)
class _Data:
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


def pose(
    dataset: xr.Dataset, film: SimulatedFilm | None = None, checkpoint: Checkpoint | None = None
) -> DecayModel:
    """Return the model of a decay, which needs no film.

    Raises: MeasurementError where nothing rings down, or too few points of it are left.
    """
    record = power_record(dataset)
    seen = window(record)
    data = _data(record, seen)
    if np.count_nonzero(data.of_decay) < FEWEST_BLOCKS:
        raise MeasurementError(
            f"decay: {np.count_nonzero(data.of_decay)} points from the switch-off to the floor; a "
            f"diagnosis needs at least {FEWEST_BLOCKS}: record faster"
        )
    share = 1 / (1 + np.exp(-data.log_ratio))
    # Between signal and noise, smooth bends are not smooth in ln p
    strong = (data.log_ratio > CLEAR) | ~data.of_decay
    scale = normal_scale(data.smooth, np.exp(data.log_ratio), np.zeros_like(share))
    values = data.smooth + scale.data(data.middle)
    power = Fluctuating(
        blocks=data.blocks,
        time=data.time,
        interval=data.interval,
        values=values,
        share=share,
        read_share=share,
        averages=data.averages,
        strong=strong,
        late=~data.of_decay,
    )
    noise, wander = fluctuation(power, checkpoint)
    whole = float(data.blocks.time[data.of_decay][-1])
    noise = noise + drifting(data.blocks, share, GAIN / DB, SLOW * whole)
    base, start = _base(record, seen, data)
    scales = _scales(seen, data)
    phase = _phase(dataset, seen, data, checkpoint)
    # A phase is followed from point to point
    time, blocks = _nodes(data) if phase is None else (data.time, data.blocks)
    if phase is not None:
        base += phase.base
        start = np.concatenate([start, phase.start])
        scales["phase"] = 1.0
        if record.frequency is not None:
            # Only the phase tells a drift of the frequency apart from all else
            scales["time"] = float(data.time[-1])
    return DecayModel(
        time=time,
        blocks_of_power=blocks,
        blocks_of_phase=_NONE if phase is None else phase.blocks,
        log_power=data.middle,
        phase=np.empty(0) if phase is None else phase.values,
        of_power=_whitening(noise),
        of_phase=Whitening(np.empty((0, 0))) if phase is None else phase.noise,
        scale=replace(scale, variance=np.diag(noise)),
        origin=float(record.time[seen.used][0]),
        frequency=record.frequency or 0.0,
        base=base,
        start=start,
        scales=scales,
        notes=_notes(record, seen, data, wander),
        left_out=listed(record, seen.interruptions),
    )


def _data(record: PowerRecord, seen: Window) -> _Data:
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
    return _Data(
        time,
        log[used],
        blocks,
        seen.decay[used][blocks.first],
        record.interval,
        floor,
        likelihood.averages,
    )


def _nodes(data: _Data) -> tuple[Array, Blocks]:
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


def _base(
    record: PowerRecord, seen: Window, data: _Data
) -> tuple[tuple[ParameterSpec, ...], Array]:
    """Return level and floor [dB] and the rate [1/s] with their ranges, and where they start."""
    found = seen.found
    rate = float(found.values[1] * found.likelihood.units[1])
    rate = max(rate, 1e-3 / float(data.time[-1]))
    late = found.stretch.begin - float(record.time[seen.used][0])
    level = found.stretch.reference + DB * (float(found.values[0]) + rate * late)
    low = float(DB * data.log_power.min()) - REACH
    high = float(DB * data.log_power.max()) + REACH
    specs = (
        ParameterSpec("level", "dB", low, high),
        ParameterSpec("decay_rate", "1/s", rate / FARTHEST, FARTHEST * rate),
        ParameterSpec("floor", "dB", low, high),
    )
    start = np.array([level, rate, DB * data.floor])
    return specs, np.clip(start, [s.low for s in specs], [s.high for s in specs])


def _scales(seen: Window, data: _Data) -> dict[str, float]:
    """Return the numbers that ranges of parameters count in."""
    duration = float(data.blocks.time[data.of_decay][-1])
    rate = float(seen.found.values[1] * seen.found.likelihood.units[1])
    return {
        "curvature": CURVATURE,
        "per_time": 1 / duration,
        "per_time_square": 1 / duration**2,
        "rate": max(rate, 1e-3 / duration),
    }


@dataclass(frozen=True, eq=False)
class _Phase:
    """The phase of a decay: blocks of its first points, means (n,) [rad], noise, parameters."""

    blocks: Blocks
    values: Array
    noise: Whitening
    base: tuple[ParameterSpec, ...]
    start: Array


_NONE = Blocks(np.empty(0, np.intp), np.empty(0), np.empty(0), 1.0)


def _whitening(noise: Array) -> Whitening:
    """Return what whitens noise of a covariance (n, n).

    Of a readout that wanders much more than it scatters, the covariance, which is known to a part
    in a million, may be indefinite; each block gets a scatter of its own as well.
    """
    own = np.diag(np.diag(noise)) * OWN**2
    return Whitening(cholesky(noise + own, lower=True))


def _phase(
    dataset: xr.Dataset, seen: Window, data: _Data, checkpoint: Checkpoint | None
) -> _Phase | None:
    """Return the phase as long as the signal is strong, None where none was recorded."""
    if "real" not in dataset or "imag" not in dataset:
        return None
    weak = np.flatnonzero((data.log_ratio < np.log(STRONG)) | ~data.of_decay)
    count = int(weak[0]) if len(weak) else len(data.blocks.time)
    if count < FEWEST_BLOCKS:
        return None
    chosen = np.arange(len(data.blocks.time)) < count
    blocks = part_of(data.blocks, chosen)
    points = int(blocks.first[-1] + blocks.count[-1])
    known = np.isfinite(dataset["real"].values) & (np.hypot(dataset["real"], dataset["imag"]) > 0)
    volts = (dataset["real"].values + 1j * dataset["imag"].values)[np.asarray(known)]
    angle = np.unwrap(np.angle(volts[seen.used][:points]))
    values = blocks.mean(angle)
    # Of the noise behind the filter, half is across the amplitude
    share = 1 / (1 + np.exp(-data.log_ratio[chosen]))
    turning = Fluctuating(
        blocks=blocks,
        time=data.time[:points],
        interval=data.interval,
        values=values,
        share=share,
        read_share=np.ones(count),
        averages=ACROSS,
        strong=np.ones(count, dtype=bool),
        late=np.zeros(count, dtype=bool),
    )
    matrix, _ = fluctuation(turning, checkpoint)
    slope, begin = np.polyfit(blocks.time, values, 1)
    highest = 0.5 / data.interval
    base = (
        ParameterSpec("phase", "rad", begin - 10 * np.pi, begin + 10 * np.pi),
        ParameterSpec("detuning", "Hz", -highest, highest),
    )
    noise = _whitening(matrix)
    return _Phase(blocks, values, noise, base, np.array([begin, slope / (2 * np.pi)]))


def _notes(record: PowerRecord, seen: Window, data: _Data, wander: Wander) -> tuple[str, ...]:
    """Say what is compared, and of which noise."""
    time = record.time[seen.used]
    notes = [
        f"decay: compared from {time[0]:.4g} to {time[-1]:.4g} s, in {len(data.blocks.time)} "
        "blocks",
        f"decay: the readout's noise is {DB * wander.white:.2g} dB a point and wanders by "
        f"{DB * wander.size:.2g} dB within {wander.memory:.2g} s, beside smooth bends",
    ]
    if seen.found.values[2] <= FAINTEST_FLOOR + 1e-6:
        notes.append("decay: the record ends before the decay reaches a floor")
    if len(seen.interruptions):
        lost = sum(one.stop - one.first for one in seen.interruptions)
        notes.append(f"decay: {lost} points are left out where the decay is interrupted")
    return tuple(notes)
