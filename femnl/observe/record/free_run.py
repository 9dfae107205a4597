"""Free-run simulation of one oscillator under a sampled drive, fast enough to fit long records."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.interpolate import make_interp_spline

from femnl.core.compiled import compiled
from femnl.core.errors import MeasurementError

Array = NDArray[np.float64]
Numbers = NDArray[np.inexact]
Hold = Literal["zero-order", "band-limited"]

STAGES = DOP853.n_stages
A = DOP853.A[:STAGES, :STAGES]
B = DOP853.B
C = DOP853.C[:STAGES]
# Decay times after which less than 1e-10 of what a record began with is left, where its forces are
# not unstable on the way.
SETTLED = 24.0
# Degree of the drive's spline: of a band up to half the Nyquist frequency it misses 4e-8 of the
# rms, up to two thirds 1e-5 (5: 4e-4, 5e-3).
SPLINE = 13
# Samples at the record's ends over which the spline feels that the drive is not known further, down
# to those parts.
EDGE = 32
# Phase [rad] of the fastest swing by which one step may go on: it errs by less than 1e-6 of the
# amplitude. By 1e-5, as at 1 rad, would not do: strong motions multiply it.
REACH = 0.7
MOST = 8
# Steps of Newton's method to the rest state.
NEWTON = 8
# What an oscillation that overflows on the way is taken for.
DIVERGED = 1e60


@dataclass(frozen=True, eq=False)
class Drive:
    """The drive at the times where the integrator asks for it.

    held (n · steps, STAGES): its values at the stages of each step; interval: time between the n
    samples [s]; steps: number of steps from one sample to the next.
    """

    held: Array
    interval: float
    steps: int


def stages(drive: Array, interval: float, hold: Hold, steps: int = 1) -> Drive:
    """Return a drive (n,) of samples by interval [s] at the stages of so many steps.

    Steps from one sample to the next, see `steps_needed`.

    zero-order: u is constant from each sample to the next, as behind a digital-to-analogue
    converter. band-limited: u is the smooth signal through the samples, as where the drive was
    itself recorded through an anti-aliasing filter; spline of high degree.
    Raises: MeasurementError for gaps, or fewer samples than the spline needs.
    """
    missing = np.count_nonzero(~np.isfinite(drive))
    if missing:
        raise MeasurementError(
            f"drive: {missing} of {len(drive)} samples are missing; give it without gaps, each "
            "acts on all that follows"
        )
    if hold == "zero-order":
        return Drive(np.repeat(drive, STAGES * steps).reshape(-1, STAGES), interval, steps)
    if len(drive) <= SPLINE:
        raise MeasurementError(
            f"drive: {len(drive)} samples; a band-limited drive needs more than {SPLINE}"
        )
    time = np.arange(len(drive))
    spline = make_interp_spline(time, drive, k=SPLINE)
    begin = np.arange(len(drive) * steps) / steps
    return Drive(
        np.stack([spline(np.minimum(begin + c / steps, time[-1])) for c in C], axis=1),
        interval,
        steps,
    )


def steps_needed(coefficients: Numbers, largest: float, interval: float) -> int:
    """Return how many steps from sample to sample follow the fastest swing of an oscillator.

    The swing is that of small motion about any y up to ±`largest`. The count is at most MOST: what
    swings faster is not sampled.

    Args: coefficients (8,) or (7,): as of `free_run`.
    """
    _, _, _, _, stiffness, quadratic, cubic, *fifth = coefficients.real
    slopes = [
        stiffness + y * (2 * quadratic + y * (3 * cubic + 5 * y * y * sum(fifth)))
        for y in (-largest, 0.0, largest)
    ]
    return int(np.clip(np.ceil(np.sqrt(max(*slopes, 0.0)) * interval / REACH), 1, MOST))


def predictable(n: int, decay: float) -> NDArray[np.bool_]:
    """Return which of n samples (n,) a free run from rest can predict.

    Under a band-limited drive, of a record cut from a longer motion.

    Not those at its begin, where that motion has not died away (at most half of them), nor the last
    ones, where the drive's spline ends.

    Args:
        n: samples of the record.
        decay: amplitude's rate of decay γ/2 times the interval between samples, positive.
    """
    found = np.ones(n, dtype=bool)
    found[: min(int(np.ceil(SETTLED / decay)), n // 2)] = False
    found[n - EDGE :] = False
    return found


def free_run(coefficients: Numbers, drive: Drive, begin: Numbers | None = None) -> Numbers:
    """Return the output (m, n) at the samples for m oscillators under one drive.

    ÿ = c₀ (u + c₁) − c₂ (1 + c₃ y²) ẏ − c₄ y − c₅ y² − c₆ y³ − c₇ y⁵

    Steps of the eighth-order Dormand–Prince method, compiled at the first call.

    Args:
        coefficients: (8, m), or (7, m) without the last; complex ones carry a derivative on the
            imaginary part.
        drive: from `stages`, with as many steps as the oscillators need.
        begin: y and ẏ (2, m) at the first sample; at rest unless given, where the forces hold the
            offset, c₀ c₁ = c₄ y + c₅ y² + ….
    Valid: positive damping, one stable rest state.
    """
    terms = np.zeros((8, coefficients.shape[1]), dtype=coefficients.dtype)
    terms[: len(coefficients)] = coefficients
    h = drive.interval / drive.steps
    out: Numbers = compiled(_steps)(
        terms, _rest(terms) if begin is None else begin, drive.held, h * A, h * B, drive.steps
    )
    out[~(np.abs(out) < DIVERGED)] = DIVERGED
    return out


def _rest(terms: Numbers) -> Numbers:
    """Return y and ẏ (2, m) at rest."""
    gain, offset, _, _, stiffness, quadratic, cubic, quintic = terms
    y = gain * offset / stiffness
    for _ in range(NEWTON):
        left = gain * offset - y * (stiffness + y * (quadratic + y * (cubic + y * y * quintic)))
        y = y + left / (stiffness + y * (2 * quadratic + y * (3 * cubic + 5 * y * y * quintic)))
    return np.stack([y, np.zeros_like(y)])


def _steps(
    coefficients: Numbers, begin: Numbers, held: Array, a: Array, b: Array, repeat: int
) -> Numbers:
    """Return the outputs (m, n); a, b: the method's tables times the step.

    repeat: steps from sample to sample.
    """
    m = coefficients.shape[1]
    n = len(held) // repeat
    n_stages = len(b)
    out = np.empty((m, n), dtype=coefficients.dtype)
    y_slope = np.empty(n_stages, dtype=coefficients.dtype)
    v_slope = np.empty(n_stages, dtype=coefficients.dtype)
    for k in range(m):
        gain, offset, damping, nonlinear, stiffness, quadratic, cubic, quintic = coefficients[:, k]
        y = begin[0, k]
        v = begin[1, k]
        for step in range(n * repeat):
            if step % repeat == 0:
                out[k, step // repeat] = y
            for i in range(n_stages):
                x = y
                w = v
                for j in range(i):
                    x += a[i, j] * y_slope[j]
                    w += a[i, j] * v_slope[j]
                y_slope[i] = w
                pull = x * (stiffness + x * (quadratic + x * (cubic + x * x * quintic)))
                v_slope[i] = (
                    gain * (held[step, i] + offset) - damping * (1 + nonlinear * x * x) * w - pull
                )
            for i in range(n_stages):
                y += b[i] * y_slope[i]
                v += b[i] * v_slope[i]
    return out
