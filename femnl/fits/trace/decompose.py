"""Time traces: harmonics with their noise floor at each drive frequency."""

import numpy as np
import xarray as xr
from scipy.fft import next_fast_len, rfft
from scipy.linalg import lstsq
from scipy.optimize import minimize_scalar

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.readout import Array, ComplexArray, HarmonicSpectrum
from femnl.fits.trace.colour import WHITE, Colour, beside_phase, noise_colour

MOST_HARMONICS = 21
PER_HARMONIC = 4
"""Harmonics that are sought, and samples of a record that each one needs."""
ILL_CONDITIONED = 1e5
"""Ratio of singular values beyond which a record is too short to tell the harmonics apart."""
FINE = 8
"""Points of the padded spectrum of a drive per line width of its record."""
ONE_TONE = 0.5
"""Share of the power of a drive that one sine may leave: harmonics of its own and noise, but no
second tone of equal strength.
"""
FEWEST_PERIODS = 3
SAMPLES_EACH = 10
"""Periods of a record, and samples for each number that is fitted to it, from which on the colour
of its noise can be told: fewer leave no noise between the harmonics.
"""
LEAST_LEFT = 0.25  # part of the noise that harmonics leave, however strong it is where they are
SILENT = 1e-6
"""Noise of a step, in that of most steps, below which it is that of rounding."""
EVEN_TIMES = 0.01
"""Relative difference of intervals between samples up to which they are equal."""


def refuse_undriven(traces: xr.Dataset) -> None:
    """Refuse traces of which a step does not say its frequency. Raises: MeasurementError."""
    if "drive_frequency" not in traces:
        return
    unknown = np.flatnonzero(~np.isfinite(traces["drive_frequency"].values))
    if len(unknown):
        raise MeasurementError(
            f"trace: step {unknown[0] + 1} has no drive_frequency; give it, or leave the step out"
        )


def drive_frequencies(traces: xr.Dataset) -> Array:
    """Return the frequency [Hz] of the drive at each step, as told or as recorded.

    Raises: MeasurementError where neither is there.
    """
    refuse_undriven(traces)
    if "drive_frequency" in traces:
        return np.asarray(traces["drive_frequency"].values, float)
    if "drive_voltage" in traces:
        time = traces["time"].values.astype(float)
        rows = traces["drive_voltage"].values
        still = [np.unique(row[np.isfinite(row)]).size < 2 for row in rows]
        if any(still):
            raise MeasurementError(
                f"trace: drive_voltage of step {still.index(True) + 1} does not change, so it has "
                "no frequency; give drive_frequency, or leave the step out"
            )
        return np.array([_drive_frequency(time, row) for row in rows])
    raise MeasurementError(
        "trace: neither drive_frequency nor drive_voltage is there; add the frequency [Hz] "
        "of each step"
    )


def drive_phases(traces: xr.Dataset, frequency: Array) -> Array:
    """Return the phase of the recorded drive at t = 0 (n_steps,), 0 where none was recorded.

    frequency (n_steps,) [Hz] of the drive.
    """
    if "drive_voltage" not in traces:
        return np.zeros(len(frequency))
    time = traces["time"].values.astype(float)
    return np.array(
        [
            np.angle(_harmonics(time, row, float(f), 1)[0][1])
            for row, f in zip(traces["drive_voltage"].values, frequency, strict=True)
        ]
    )


def most_harmonics(traces: xr.Dataset) -> int:
    """Return how many harmonics, of MOST_HARMONICS, rate and length of the records allow.

    Raises: MeasurementError where that is none, and as `drive_frequencies`.
    """
    samples = np.isfinite(traces["voltage"].values).sum(axis=1)
    fewest = int(samples.min())
    if fewest == 0:
        raise MeasurementError(
            f"trace: step {int(np.argmin(samples)) + 1} has no sample; leave it out"
        )
    interval = float(np.median(np.diff(traces["time"].values)))
    fastest = float(drive_frequencies(traces).max())
    within = int(np.ceil(0.5 / (fastest * interval))) - 1
    found = min(MOST_HARMONICS, fewest // PER_HARMONIC, within)
    if found < 1:
        raise MeasurementError(
            f"trace: {fewest} samples at {1 / interval:g} Hz show no harmonic of {fastest:g} Hz; "
            "sample faster or record longer"
        )
    return found


def decompose(traces: xr.Dataset, n_harmonics: int = MOST_HARMONICS) -> HarmonicSpectrum:
    """Decompose recorded traces into harmonics of the drive by least squares.

    v(t) = V_0 + Σ_n Re(V_n e^{2πinft}) with n to `n_harmonics`. The record need not hold a whole
    number of periods, and missing samples are left out. Where the drive itself was recorded, phases
    count from it: V_n e^{−inφ_d}; else from t = 0.

    Args:
        traces: Dataset of kind `trace`; without `drive_frequency` it is found from `drive_voltage`.
        n_harmonics: highest harmonic.

    Returns:
        The harmonics of each step; noise_sd from what the harmonics leave, values_sd from it, with
        the colour that the noise of all steps shows (`noise_colour`) where records are long. A step
        in which nothing scatters, as of a detector that was off, has the noise of the others.

    Raises:
        ParameterError: harmonics beyond half the sampling rate, or more unknowns than samples.
        MeasurementError: a record too short to tell the harmonics apart.

    Valid: noise of one colour in all steps, white in short records; a steady state meanwhile.
    Source: Sommer et al. 2025, supplement S7, decomposition of the time traces.
    """
    frequency = drive_frequencies(traces)
    time = traces["time"].values.astype(float)
    voltage = traces["voltage"].values
    phase = drive_phases(traces, frequency)
    orders = np.arange(n_harmonics + 1)
    values = np.zeros((n_harmonics + 1, len(voltage)), complex)
    sd = np.zeros((n_harmonics + 1, len(voltage)))
    noise = np.zeros(len(voltage))
    left = np.full(voltage.shape, np.nan)
    for i, (row, f) in enumerate(zip(voltage, frequency, strict=True)):
        used = np.isfinite(row)
        values[:, i], sd[:, i], noise[i], left[i, used] = _harmonics(
            time, row, float(f), n_harmonics
        )
        values[:, i] *= np.exp(-1j * orders * phase[i])
    colour = _colour(time, frequency, left, n_harmonics)
    interval = float(np.median(np.diff(time)))
    power = colour.relative_power(np.outer(orders, frequency * interval))
    # Harmonics and mean took more of noise that is strong at their frequencies than of white noise
    known = np.isfinite(left).sum(axis=1) - (2 * n_harmonics + 1)
    more = power[0] - 1 + 2 * np.sum(power[1:] - 1, axis=0)
    larger = np.sqrt(known / np.maximum(known - more, LEAST_LEFT * known))
    noise *= larger
    sd *= larger * np.sqrt(power)
    silent = noise < SILENT * np.median(noise)
    if silent.any():
        sd[:, silent] = np.median(sd[:, ~silent], axis=1)[:, None]
        noise[silent] = np.median(noise[~silent])
    return HarmonicSpectrum(
        frequency, orders, values, sd, noise, colour.correlation_length, colour.independent
    )


def _colour(time: Array, frequency: Array, left: Array, n_harmonics: int) -> Colour:
    """Return the colour of noise of which the harmonics leave (n_steps, n_samples) [V]."""
    intervals = np.diff(time)
    samples = np.isfinite(left).sum(axis=1)
    if (
        np.ptp(intervals) > EVEN_TIMES * np.median(intervals)
        or np.any(np.ptp(time) * frequency < FEWEST_PERIODS)
        or np.any(samples < SAMPLES_EACH * (2 * n_harmonics + 1))
    ):
        return WHITE
    cycles = float(np.median(frequency) * np.median(intervals))
    found = noise_colour(left, cycles * np.arange(1.0, n_harmonics + 1))
    if found is not None:
        return found
    # The lines may be of harmonics beyond the last
    noise = left.copy()
    for row, f in zip(noise, frequency, strict=True):
        order = np.argsort(f * time % 1.0, kind="stable")
        row[:] = beside_phase(row, order[np.isfinite(row[order])], np.mean)
    return noise_colour(noise) or WHITE


def _harmonics(
    time: Array, voltage: Array, frequency: float, n_harmonics: int
) -> tuple[ComplexArray, Array, float, Array]:
    """Return V_n, their standard deviations, the noise per sample, and what is left of a record.

    The noise is white, and what is left (n_used,) is of the samples that are there.
    """
    used = np.isfinite(voltage)
    t = time[used]
    v = voltage[used]
    n_unknown = 2 * n_harmonics + 1
    if t.size <= n_unknown:
        raise ParameterError(
            f"{t.size} samples cannot give {n_harmonics} harmonics: ask for fewer, or record longer"
        )
    interval = float(np.median(np.diff(time)))
    if 2 * n_harmonics * frequency * interval >= 1:
        highest = int(np.ceil(0.5 / (frequency * interval))) - 1
        raise ParameterError(
            f"harmonic {n_harmonics} of {frequency:g} Hz lies beyond half the sampling rate "
            f"{1 / interval:g} Hz: ask for {highest} at most"
        )
    columns = design(t, frequency, n_harmonics)
    solution, _, _, singular = lstsq(columns, v)
    if singular[0] > ILL_CONDITIONED * singular[-1]:
        periods = np.ptp(t) * frequency
        raise MeasurementError(
            f"a record of {periods:.2g} periods at {frequency:g} Hz cannot tell {n_harmonics} "
            "harmonics apart: record longer"
        )
    left = v - columns @ solution
    noise = float(np.sqrt(np.sum(left**2) / (t.size - n_unknown)))
    sd = noise * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    cosine = slice(1, n_harmonics + 1)
    sine = slice(n_harmonics + 1, None)
    values = np.concatenate([solution[:1], solution[cosine] + 1j * solution[sine]])
    even = np.sqrt((sd[cosine] ** 2 + sd[sine] ** 2) / 2)
    return values, np.concatenate([sd[:1], even]), noise, left


def design(time: Array, frequency: float, n_harmonics: int) -> Array:
    """Return the columns 1, cos nωt and −sin nωt of a record (n_samples, 2 n_harmonics + 1)."""
    turns = 2 * np.pi * frequency * np.outer(time, np.arange(1, n_harmonics + 1))
    return np.column_stack([np.ones(time.size), np.cos(turns), -np.sin(turns)])


def _drive_frequency(time: Array, drive: Array) -> float:
    """Return the frequency [Hz] of the recorded drive.

    The peak of its spectrum, then the least misfit of one sine.
    """
    used = np.isfinite(drive)
    t = time[used]
    v = drive[used] - np.mean(drive[used])
    interval = float(np.median(np.diff(time)))
    whole = np.where(used, drive - np.mean(drive[used]), 0.0)
    n_padded = next_fast_len(FINE * time.size, real=True)
    power = np.abs(rfft(whole * np.hanning(time.size), n_padded))
    step = 1 / (n_padded * interval)

    def misfit(f: float) -> float:
        design = np.column_stack(
            [np.ones(t.size), np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t)]
        )
        return float(np.sum((v - design @ lstsq(design, v)[0]) ** 2))

    peak = float(np.argmax(power) * step)
    found = minimize_scalar(
        misfit,
        bounds=(peak - FINE * step / 2, peak + FINE * step / 2),
        method="bounded",
        options={"xatol": 1e-9 * peak},
    )
    left = float(found.fun / np.sum(v**2))
    if left > ONE_TONE:
        raise MeasurementError(
            f"drive_voltage: the best sine, at {found.x:.6g} Hz, leaves {left:.0%} of its power, "
            "so it has no harmonics; "
            "fit an oscillator (--as oscillator), or add the drive_frequency of each step"
        )
    return float(found.x)
