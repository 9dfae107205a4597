"""Fit mass, damping and nonlinear stiffness of an oscillator to drive and motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import leastsq

from femnl.core.errors import ConvergenceError, MeasurementError, ParameterError
from femnl.core.fit import Fit, Parameter
from femnl.fits.covariance import STEP, derived, natural_units
from femnl.fits.held import Held, hold_fixed
from femnl.fits.record.start import (
    ONE_FREQUENCY,
    equation_start,
    linear_start,
    of_one_frequency,
)
from femnl.observe.record.free_run import (
    EDGE,
    Array,
    Drive,
    Hold,
    Numbers,
    free_run,
    predictable,
    stages,
    steps_needed,
)

LINEAR = ("mass", "damping", "stiffness")
TERMS = ("offset", "cubic", "quadratic", "nonlinear_damping")
CLOSE = 1e-7
MAX_CALLS = 40
# Part of a drive's rms below which it is over, and only disturbs.
OVER = 0.01
# Samples through which the motion at the begin is found.
FIRST = 6


@dataclass(frozen=True)
class _Record:
    """The drive, the output at the chosen samples, and which of its samples (n,) these are."""

    drive: Drive
    output: Array
    chosen: NDArray[np.bool_]


def fit_oscillator(
    drive: ArrayLike,
    output: ArrayLike,
    sampling_rate: float,
    terms: Sequence[str] = TERMS,
    *,
    hold: Hold = "band-limited",
    fitted: slice | NDArray[np.bool_] = slice(None),
    start: Fit | None = None,
    fixed: Mapping[str, float] | None = None,
) -> Fit:
    """Fit an oscillator by the error of its free run.

    The free run is given only the drive, never the measured output.

    m ÿ + c (1 + η y²) ẏ + k y + k₂ y² + k₃ y³ = u + u₀

    Args:
        drive: u (n,), in its own unit, from a state of rest.
        output: y (n,), in its own unit; NaN is left out.
        sampling_rate: [Hz].
        terms: which of `offset` u₀, `quadratic` k₂, `cubic` k₃, `nonlinear_damping` η to fit beside
            m, c and k; the rest is 0.
        hold: how u runs between samples, see `stages`.
        fitted: the samples that are compared; all are simulated. The last EDGE of a band-limited
            record never are, see `predictable`.
        start: a fit of the same record with fewer terms, where there is one; otherwise the linear
            oscillator is fitted first.
        fixed: values by parameter name, in units of drive and output, which are held.

    Returns:
        mass, damping, stiffness and the terms in units of drive and output; derived frequency [Hz],
        quality_factor, and alpha = k₃/k. The scatter of what is left is taken for white noise, so
        the standard deviations hold as far as it is.

    Raises:
        MeasurementError: records of different or too small length, a drive with gaps or constant.
        ParameterError: an unknown term, or a name in `fixed` that is no parameter.
        ConvergenceError: the record shows no damped oscillation to start from, or the fit ends at
            one that does not come to rest, or lies beyond half the sampling rate.
    Valid: at least about eight samples a period; one stable rest state.
    Source: the benchmark of Wigren and Schoukens (2013), Three free data sets for development and
        benchmarking in nonlinear system identification, European Control Conference.
    """
    u = np.asarray(drive, dtype=float)
    y = np.asarray(output, dtype=float)
    unknown = [term for term in terms if term not in TERMS]
    if unknown:
        raise ParameterError(f"terms: {unknown[0]!r} is unknown; give some of {', '.join(TERMS)}")
    chosen = np.zeros(len(y), dtype=bool)
    chosen[fitted] = True
    if hold == "band-limited":
        chosen[-EDGE:] = False
    if u.shape != y.shape or u.ndim != 1 or np.count_nonzero(chosen & np.isfinite(y)) < 100:
        raise MeasurementError(
            f"drive {u.shape} and output {y.shape}: give two records of equal length, with at "
            "least 100 samples fitted"
        )
    chosen &= np.isfinite(y)
    interval = 1 / sampling_rate
    names = [*LINEAR, *(term for term in TERMS if term in terms)]
    record = _Record(stages(u, interval, hold), y[chosen], chosen)
    held = hold_fixed(names, fixed, "this oscillator")
    if start is None:
        first = Held(LINEAR, held.values[: len(LINEAR)])
        linear = first.values
        if first.free.any():
            linear = _descend(first, linear_start(u[chosen], y[chosen], interval), record)
        known = dict(zip(LINEAR, linear, strict=True))
    else:
        known = {name: start[name] for name in names if name in start.parameters}
    starts = [np.array([known.get(name, 0.0) for name in names])]
    if len(names) > len(LINEAR):
        starts.append(equation_start(names, u, y, interval, chosen))
        record = replace(
            record, drive=stages(u, interval, hold, _steps(names, starts[-1], y[chosen], interval))
        )
    ends = [_descend(held, values, record) for values in starts]
    values = min(ends, key=lambda end: float(np.sum(_left(names, end, record) ** 2)))
    damping, stiffness = values[1:3] / values[0]
    if not (damping > 0 and 0 < stiffness < (np.pi / interval) ** 2):
        if of_one_frequency(u[chosen]):
            raise ConvergenceError(ONE_FREQUENCY)
        raise ConvergenceError(
            f"output: of mass 1, the oscillator that comes closest has damping {damping:.3g}/s "
            f"and stiffness {stiffness:.3g}/s²: it does not come to rest, or is faster than half "
            "the sampling rate; fit another part of the record, or other terms"
        )
    residual, slopes = _misfit(names, values, record)
    noise = float(np.std(residual))
    found, blind = held.covariance(slopes / noise, natural_units(slopes, record.output))
    parameters = {
        name: Parameter(name, float(v), float(s), "")
        for name, v, s in zip(names, values, np.sqrt(np.diag(found)), strict=True)
    }
    parameters |= _derived(values, found, names)
    notes = (
        f"root mean square of what is left: {noise:.4g} in the unit of the output, taken for "
        "white noise",
        *held.notes,
        *blind,
    )
    n_free = int(np.count_nonzero(held.free))
    return Fit(held.ordered(parameters), held.inner(found), 1.0, len(residual), n_free, notes)


def simulate_oscillator(
    fit: Fit, drive: ArrayLike, sampling_rate: float, *, hold: Hold = "band-limited"
) -> Array:
    """Return the free run (n,) of a fitted oscillator under a drive (n,), from rest.

    `predictable` tells which samples a free run can predict.

    Args:
        fit: from `fit_oscillator`.
        drive: u (n,).
        sampling_rate: [Hz].
        hold: how u runs between samples.
    Raises: MeasurementError for a drive with gaps, or a band-limited one too short for its spline.
    """
    names = [name for name in (*LINEAR, *TERMS) if name in fit.parameters]
    values = np.array([fit[name] for name in names])
    u = np.asarray(drive, dtype=float)
    interval = 1 / sampling_rate
    run = np.zeros(len(u))
    steps = 0
    needed = 1
    while needed > steps:
        steps = needed
        run = free_run(_coefficients(names, values[:, None]), stages(u, interval, hold, steps))[0]
        needed = _steps(names, values, run, interval)
    return np.asarray(run)


def refuse_uneven(time: Array) -> None:
    """Refuse the times (n,) [s] of a record that are no even clock to half a sample.

    Motion is followed from sample to sample, and rows that a file leaves out shift what comes next.
    """
    step = float(np.median(np.diff(time)))
    clock = np.linspace(time[0], time[-1], len(time))
    if np.max(np.abs(time - clock)) > step / 2:
        raise MeasurementError(
            f"trace: samples are not even in time, but mostly {step:.6g} s apart; keep missing "
            "ones as rows with NaN"
        )


def settled(drive: Array, output: Array, sampling_rate: float) -> NDArray[np.bool_]:
    """Return which samples (n,) are known and can be predicted by a free run.

    The linear part of the oscillator decides; see `predictable`. All known ones count where the
    drive is over before the motion has settled, as after a burst: the others tell no stiffness.
    """
    known = np.isfinite(output) & np.isfinite(drive)
    mass, damping, _ = linear_start(drive[known], output[known], 1 / sampling_rate)
    late = known & predictable(len(output), damping / mass / (2 * sampling_rate))
    over = late.any() and np.std(drive[late]) < OVER * np.std(drive[known])
    return known if over else late


def begun(output: Array, interval: float) -> Array:
    """Return y and ẏ (2,) at the first sample of an output (n,).

    They are read from a polynomial through the first known samples.
    """
    first = np.flatnonzero(np.isfinite(output))[:FIRST]
    return np.asarray(
        np.polynomial.polynomial.polyfit(interval * first, output[first], FIRST - 1)[:2]
    )


def _steps(names: Sequence[str], values: Array, output: Array, interval: float) -> int:
    """Return the steps that a motion as large as the output needs from sample to sample."""
    return steps_needed(
        _coefficients(names, values[:, None])[:, 0], float(np.abs(output).max()), interval
    )


def _coefficients(names: Sequence[str], values: Numbers) -> Numbers:
    """Turn parameters (k, m) into the coefficients (7, m) of `free_run`."""
    by_name = dict(zip(names, values, strict=True))
    zero = np.zeros_like(values[0])
    mass, damping, stiffness = (by_name[name] for name in LINEAR)
    offset, cubic, quadratic, eta = (by_name.get(name, zero) for name in TERMS)
    return np.stack(
        [1 / mass, offset, damping / mass, eta, stiffness / mass, quadratic / mass, cubic / mass]
    )


def _misfit(names: Sequence[str], values: Array, record: _Record) -> tuple[Array, Array]:
    """Return what the free run leaves of the fitted samples (n,), and its derivatives (n, k).

    The derivatives are taken by complex steps.
    """
    steps = STEP * np.where(values != 0, np.abs(values), 1.0)
    shifted = values[:, None] + 1j * np.diag(steps)
    run = free_run(_coefficients(names, shifted), record.drive)[:, record.chosen]
    return np.asarray(run[0].real - record.output), np.asarray((run.imag / steps[:, None]).T)


def _left(names: Sequence[str], values: Array, record: _Record) -> Array:
    """Return what the free run leaves of the fitted samples (n,)."""
    run = free_run(_coefficients(names, values[:, None]), record.drive)
    return np.asarray(run[0, record.chosen] - record.output)


def _descend(held: Held, values: Array, record: _Record) -> Array:
    """Minimise the squared free-run error over what is free."""

    def residual(trial: Array) -> Array:
        return _left(held.names, held.whole(trial), record)

    def slopes(trial: Array) -> Array:
        return _misfit(held.names, held.whole(trial), record)[1][:, held.free]

    best, *_ = leastsq(
        residual,
        values[held.free],
        Dfun=slopes,
        full_output=True,
        ftol=CLOSE,
        xtol=CLOSE,
        gtol=CLOSE,
        maxfev=MAX_CALLS,
    )
    return held.whole(np.asarray(best))


def _derived(values: Array, found: Array, names: Sequence[str]) -> dict[str, Parameter]:
    """Return frequency, quality factor and α."""

    def derive(p: Numbers) -> dict[str, tuple[complex, str]]:
        mass, damping, stiffness = p[:3]
        turn = np.sqrt(stiffness / mass)
        out = {
            "frequency": (turn / (2 * np.pi), "Hz"),
            "quality_factor": (turn * mass / damping, ""),
        }
        return out | (
            {"alpha": (p[names.index("cubic")] / stiffness, "")} if "cubic" in names else {}
        )

    return derived(derive, values, found)
