"""Where the fit of an oscillator starts: least squares on its equation, and a linear recursion."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from femnl.core.errors import ConvergenceError, MeasurementError
from femnl.observe.record.free_run import Array

# Width of the Gaussian by which the equation is smoothed, and where it is cut off, in samples:
# below a seventh of the sampling rate it leaves more than two thirds, and of noise near half that
# rate a thousandth.
SMOOTH = 1.2
REACH = 10
# Bins of a spectrum on either side of a tone that Hann's window fills, and the part of the power
# that they hold of one.
WIDTH = 3
PURE = 0.999
ONE_FREQUENCY = (
    "drive: it has one frequency, which does not tell mass, damping and stiffness apart; record a "
    "sweep or noise, or the responses at several frequencies"
)


def equation_start(
    names: Sequence[str],
    u: Array,
    y: Array,
    interval: float,
    chosen: NDArray[np.bool_] | None = None,
) -> Array:
    """Return the parameters that fulfil the equation best, smoothed by a Gaussian.

    Its derivatives take the place of the output's.

    So noise is not differentiated, but it biases what it is multiplied with, and this serves as a
    start alone: under strong forces of third order the error of a free run has many minima, and the
    linear oscillator lies behind a barrier.
    """
    time = np.arange(len(y))
    known = np.isfinite(y)
    chosen = known if chosen is None else chosen
    whole = np.interp(time, time[known], y[known])

    def smooth(values: Array, order: int = 0) -> Array:
        return np.asarray(
            gaussian_filter1d(values, SMOOTH, order=order, truncate=REACH / SMOOTH)[inside]
            / interval**order
        )

    inside = chosen & (time >= REACH) & (time < len(y) - REACH)
    cube = whole**3
    columns = {
        "mass": smooth(whole, 2),
        "damping": smooth(whole, 1),
        "stiffness": smooth(whole),
        "offset": -np.ones(np.count_nonzero(inside)),
        "cubic": smooth(cube),
        "quadratic": smooth(whole**2),
        "nonlinear_damping": smooth(cube, 1) / 3,
    }
    values = np.asarray(
        np.linalg.lstsq(np.column_stack([columns[name] for name in names]), smooth(u), rcond=None)[
            0
        ],
        dtype=float,
    )
    if "nonlinear_damping" in names:
        values[names.index("nonlinear_damping")] /= values[1]
    return values


def linear_start(u: Array, y: Array, interval: float) -> Array:
    """Return mass, damping and stiffness from a linear recursion that is fitted to the samples.

    The recursion is y₂ = a₁ y₁ + a₂ y₀ + b₂ u₂ + b₁ u₁ + b₀ u₀ + const.
    """
    if np.ptp(u) == 0:
        raise MeasurementError(
            f"drive: {u[0] + 0.0:g} all along; give the record of a drive that moves the oscillator"
        )
    columns = np.column_stack([y[1:-1], y[:-2], u[2:], u[1:-1], u[:-2], np.ones(len(y) - 2)])
    a1, a2, *b, _ = np.linalg.lstsq(columns, y[2:], rcond=None)[0]
    root = complex(np.roots([1.0, -a1, -a2])[0])
    rest = 1 - a1 - a2
    if root.imag == 0 or abs(root) >= 1:
        if of_one_frequency(u):
            raise ConvergenceError(ONE_FREQUENCY)
        raise ConvergenceError(
            f"output: its linear recursion, with the root {root:.4g}, does not ring; fit another "
            "part of the record"
        )
    pole = np.log(root) / interval
    gain = sum(b) / rest
    return np.asarray(np.array([1.0, -2 * pole.real, abs(pole) ** 2]) / (gain * abs(pole) ** 2))


def of_one_frequency(u: Array) -> bool:
    """Whether a drive is constant or a single tone, as wide as its window makes it."""
    power = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(len(u)))) ** 2
    peak = int(power.argmax())
    return bool(power[max(peak - WIDTH, 0) : peak + WIDTH + 1].sum() >= PURE * power.sum())
