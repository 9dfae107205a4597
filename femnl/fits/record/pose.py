"""From a record in a file to its model: the oscillator with a cubic force that follows it."""

import hashlib
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import ParameterSpec
from femnl.core.errors import ConvergenceError, MeasurementError
from femnl.core.fit import Fit
from femnl.core.numbers import engineering
from femnl.core.readout import Array
from femnl.fits.least_squares import fit
from femnl.fits.record.oscillator import (
    LINEAR,
    begun,
    fit_oscillator,
    refuse_uneven,
    settled,
    simulate_oscillator,
)
from femnl.fits.record.start import ONE_FREQUENCY, equation_start, of_one_frequency
from femnl.io.measurement import noise_sd
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.observe.record.free_run import EDGE, Drive, free_run, stages, steps_needed
from femnl.observe.record.model import RecordModel

LEAST = 100
"""Samples that the linear oscillator is fitted to; where fewer have forgotten the begin, all are.
"""
MOST = 20_000
"""Samples that are compared; all are simulated."""
STEP = 1e-30
UNRELATED = 0.3
"""Part of the output's rms that is left where the base model has nothing to do with it."""
FOLLOWED = 1.2
"""Times σ that are left where the base model follows the record after all."""
HORIZONS = tuple(np.geomspace(first, 1, 15) for first in (0.03, 0.015, 0.06))
"""Parts of the record that the base model is fitted to one after the other: over a short time a
strong motion has fewer minima.

Other parts are gone through where one leaves more than noise.
"""


@dataclass(frozen=True)
class _Record:
    """Drive and output (n,) [V] of a record, sampled every `interval` [s] at the times (n,) [s]."""

    drive: Array
    output: Array
    time: Array
    interval: float


def pose(
    dataset: xr.Dataset,
    film: SimulatedFilm | None = None,
    checkpoint: Checkpoint | None = None,
) -> RecordModel:
    """Return the model of a record of drive and output, which needs no film.

    checkpoint: keeps the fits that follow the record.

    Raises: MeasurementError for more than one record, for an output that no oscillator with a cubic
    force follows, and for a chaotic motion; ConvergenceError for a tone that does not tell the
    oscillator.
    """
    record = _first_known(dataset)
    noise, note = noise_sd(dataset)
    late = settled(record.drive, record.output, 1 / record.interval)
    late = late if np.count_nonzero(late) >= LEAST else np.isfinite(record.output)
    linear = fit_oscillator(
        record.drive, record.output, 1 / record.interval, ("offset",), fitted=late
    )
    begin = begun(record.output, record.interval)
    terms, held = _nearest(record, linear, begin)
    model = _at_start(record, terms, held, begin, noise)
    left, start = _recalled(model, checkpoint)
    model = replace(model, start=start)
    _refuse_what_does_not_follow(model, left, record.drive)
    simulated = simulate_oscillator(linear, record.drive, 1 / record.interval)
    linearly = float(np.nanstd((simulated - record.output)[late]))
    notes = (
        f"trace: {note}",
        "trace: a free run from the drive alone; a linear oscillator that begins at rest "
        f"leaves {engineering(linearly, 'V')} rms, and the cubic term of the base model lowers "
        f"that to {engineering(float(left), 'V')}; volts of the output stand for metres",
        f"trace: {len(model.at)} of {len(record.output)} samples are compared; y and its speed at "
        "the first one are fitted",
    )
    return replace(model, notes=notes)


def _first_known(dataset: xr.Dataset) -> _Record:
    """Return the record from its first known sample on: earlier motion is not asked for."""
    if dataset.sizes["step"] != 1:
        raise MeasurementError(
            f"trace: {dataset.sizes['step']} records of drive and output; diagnose them one file "
            "each"
        )
    first = int(np.argmax(np.isfinite(dataset["voltage"].values[0])))
    known = dataset.isel(time=slice(first, None))
    time = known["time"].values
    refuse_uneven(time)
    return _Record(
        known["drive_voltage"].values[0],
        known["voltage"].values[0],
        time,
        float(np.median(np.diff(time))),
    )


def _at_start(
    record: _Record, terms: Array, held: Drive, begin: Array, noise: float
) -> RecordModel:
    """Return the model whose start are the terms that follow the first part of the record."""
    mass, damping, stiffness, offset, cubic = terms
    frequency = np.sqrt(stiffness / mass) / (2 * np.pi)
    width = damping / mass / (2 * np.pi)
    alpha = cubic / stiffness
    usable = np.isfinite(record.output)
    # The spline of the drive ends there.
    usable[:EDGE] = False
    usable[len(usable) - EDGE :] = False
    at = np.flatnonzero(usable)[:: -(-np.count_nonzero(usable) // MOST)]
    output = np.asarray(record.output[at], float)
    largest = float(np.abs(output).max())
    softest, stiffest = sorted((stiffness / 5, 5 * stiffness))
    swing = float(np.ptp(record.drive))
    speed = 4 * np.pi * frequency * largest
    bend = 5 / largest**2
    return RecordModel(
        drive=held,
        time=record.time,
        at=at,
        output=output,
        noise=noise,
        base=(
            ParameterSpec("frequency", "Hz", frequency / 2, 2 * frequency),
            ParameterSpec("linewidth", "Hz", width / 10, 10 * width),
            ParameterSpec("stiffness", "V/V", softest, stiffest),
            ParameterSpec("offset", "V", -swing, swing),
            ParameterSpec("begin", "V", -2 * largest, 2 * largest),
            ParameterSpec("begin_speed", "V/s", -speed, speed),
            ParameterSpec("alpha", "V^-2", -bend - abs(alpha), bend + abs(alpha)),
        ),
        start=np.array([frequency, width, stiffness, offset, *begin, alpha]),
        scales={
            "slope": 1 / largest,
            "curvature": largest**-2,
            "curvature_square": largest**-4,
        },
    )


def _nearest(record: _Record, linear: Fit, begin: Array) -> tuple[Array, Drive]:
    """Return the terms that follow the record's first part best, and the drive in steps.

    Mass, damping, stiffness, offset and cubic term.
    """
    output = record.output
    names = (*LINEAR, "offset", "cubic")
    first = slice(EDGE, max(int(HORIZONS[0][0] * len(output)), 3 * EDGE))
    found = []
    for values in (
        equation_start(names, record.drive, output, record.interval),
        np.array([linear[name] if name != "cubic" else 0.0 for name in names]),
    ):
        mass, damping, stiffness, offset, cubic = values
        # Noise turns the equation round where the forces are weak
        if damping / mass > 0 and stiffness / mass > 0:
            terms = np.array(
                [1 / mass, offset, damping / mass, 0, stiffness / mass, 0, cubic / mass, 0]
            )
            steps = steps_needed(terms, float(np.nanmax(np.abs(output))), record.interval)
            held = stages(record.drive, record.interval, "band-limited", steps)
            left = free_run(terms[:, None], held, begin[:, None])[0] - output
            found.append((float(np.nansum(left[first] ** 2)), values, held))
    _, values, held = min(found, key=lambda one: one[0])
    return values, held


def _recalled(model: RecordModel, checkpoint: Checkpoint | None) -> tuple[float, Array]:
    """Return what the checkpoint keeps of `_followed`, or find it.

    Each process of a diagnosis poses the record, and so does one that goes on after an
    interruption: forty fits would take their slopes again.
    """
    if checkpoint is None:
        return _followed(model, checkpoint)

    def find() -> tuple[Array, Array]:
        left, vector = _followed(model, checkpoint)
        return vector, np.array([left])

    digest = hashlib.sha256(repr(model.base).encode())
    for part in (model.start, model.at, model.output, model.drive.held, np.array(model.noise)):
        digest.update(np.ascontiguousarray(part).tobytes())
    vector, left = checkpoint.recall(f"following the record {digest.hexdigest()}", find)
    return float(left[0]), vector


def _followed(model: RecordModel, checkpoint: Checkpoint | None) -> tuple[float, Array]:
    """Return what the base model leaves [V rms], and its vector.

    It follows the record over longer and longer parts.
    """
    extended = ExtendedModel(model)
    found = []
    for parts in HORIZONS:
        vector = model.start
        for part in parts:
            used = np.arange(len(model.at)) < len(model.at) * part
            vector = fit(extended, vector, used, checkpoint=checkpoint).vector
        left = model.noise * float(np.std(extended.residuals(vector)))
        found.append((left, vector))
        if left <= FOLLOWED * model.noise:
            break
    return min(found, key=lambda one: one[0])


def _refuse_what_does_not_follow(model: RecordModel, left: float, drive: Array) -> None:
    """Refuse an output that is none of the drive's, a chaotic one, and what a tone does not tell.

    Many oscillators have the same amplitude and phase at one frequency: where the one that is found
    leaves more than noise, it may be the wrong one as well as a cause.

    Args:
        model: that starts at the base model.
        left: what the base model leaves [V rms].
        drive: (n,) [V] of the record.
    """
    if left > FOLLOWED * model.noise and of_one_frequency(drive):
        raise ConvergenceError(ONE_FREQUENCY)
    moved = float(np.std(model.output))
    if left > UNRELATED * moved:
        raise MeasurementError(
            f"trace: no oscillator with a cubic force follows the output: of {moved:.3g} V "
            f"rms {left:.3g} V are left; check that drive and output belong together and run "
            "at the same time, or give a record of a weaker drive"
        )
    base, _ = ExtendedModel(model).split(model.start)
    # The derivative by the begin: in a chaotic motion it grows, and a model that is a little wrong
    # follows that nowhere.
    grown = float(np.abs(model.run(base, (), (), 1j * STEP).imag).max()) / STEP
    if left > FOLLOWED * model.noise and grown * left > float(np.abs(model.output).max()):
        raise MeasurementError(
            "trace: with the forces that come closest the motion is chaotic: changes of its "
            f"begin grow {grown:.2g} times, and the {left:.2g} V that are left to more than "
            "the motion; give a record of a weaker drive"
        )
