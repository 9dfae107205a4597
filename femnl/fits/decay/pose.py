"""From a decay in a file to its model: what is compared, its noise, and where fits start."""

from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import ParameterSpec
from femnl.core.errors import MeasurementError
from femnl.fits.decay.compared import FEWEST_BLOCKS, Compared, compared, nodes
from femnl.fits.decay.fluctuation import Fluctuating, fluctuation, whitening
from femnl.fits.decay.interruptions import listed
from femnl.fits.decay.likelihood import FAINTEST_FLOOR
from femnl.fits.decay.phase import phase_of
from femnl.fits.decay.window import Window, window
from femnl.observe.decay.blocks import (
    Blocks,
    Wander,
    Whitening,
    drifting,
    normal_scale,
)
from femnl.observe.decay.law import log_signal
from femnl.observe.decay.model import DecayModel
from femnl.observe.decay.record import DB, PowerRecord, power_record
from femnl.observe.film import SimulatedFilm

Array = NDArray[np.float64]
GAIN = 0.2
"""dB by which the gain of a readout drifts slowly: light, polarisation, and the working point.

Bends hide it in one record; repeats of a mode show it, whose rates differ by 3 %.
"""
SLOW = 1 / 6
"""Time within which that drift is smooth, in parts of the decay."""
CLEAR = 1.1
"""ln S/N from which on a decay tells its noise."""
CURVATURE = 0.1
"""1/A0²: the unit of nonlinear damping, of which forty at most are told, ηA0²/4 = 10."""
FARTHEST = 50.0
"""Factor between the rate of the straight part and that of small motion, at most."""
REACH = 80.0
"""dB by which level and floor may be beside the data."""


NO_BLOCKS = Blocks(np.empty(0, np.intp), np.empty(0), np.empty(0), 1.0)


def pose(
    dataset: xr.Dataset, film: SimulatedFilm | None = None, checkpoint: Checkpoint | None = None
) -> DecayModel:
    """Return the model of a decay, which needs no film.

    Raises: MeasurementError where nothing rings down, or too few points of it are left.
    """
    record = power_record(dataset)
    seen = window(record)
    data = compared(record, seen)
    if np.count_nonzero(data.of_decay) < FEWEST_BLOCKS:
        raise MeasurementError(
            f"decay: {np.count_nonzero(data.of_decay)} points from the switch-off to the floor; a "
            f"diagnosis needs at least {FEWEST_BLOCKS}: record faster"
        )
    share = 1 / (1 + np.exp(-data.log_ratio))
    # Between signal and noise, smooth bends are not smooth in ln p
    strong = (data.log_ratio > CLEAR) | ~data.of_decay
    scale = normal_scale(data.smooth, np.exp(data.log_ratio), np.zeros_like(share))
    values = data.smooth + scale.data(data.middle) - _beating(record, seen, data)
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
    phase = phase_of(record, seen, data, checkpoint)
    # A phase is followed from point to point
    time, blocks = nodes(data) if phase is None else (data.time, data.blocks)
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
        blocks_of_phase=NO_BLOCKS if phase is None else phase.blocks,
        log_power=data.middle,
        phase=np.empty(0) if phase is None else phase.values,
        of_power=whitening(noise),
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


def _beating(record: PowerRecord, seen: Window, data: Compared) -> Array:
    """Return ln of the power (n_blocks,) as fitted where it beats, else 0: deep beats are no noise.

    Beats of another part of the record say nothing.
    """
    if "pair" not in seen.found.likelihood.terms:
        return np.zeros(len(data.middle))
    values = seen.found.named
    time = record.time[seen.used] - seen.found.stretch.begin
    power = np.exp(log_signal(values, time).real) + np.exp(values["floor"])
    return np.asarray(np.log(data.blocks.mean(power)))


def _base(
    record: PowerRecord, seen: Window, data: Compared
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


def _scales(seen: Window, data: Compared) -> dict[str, float]:
    """Return the numbers that ranges of parameters count in."""
    duration = float(data.blocks.time[data.of_decay][-1])
    rate = float(seen.found.values[1] * seen.found.likelihood.units[1])
    return {
        "curvature": CURVATURE,
        "per_time": 1 / duration,
        "per_time_square": 1 / duration**2,
        "rate": max(rate, 1e-3 / duration),
    }


def _notes(record: PowerRecord, seen: Window, data: Compared, wander: Wander) -> tuple[str, ...]:
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
