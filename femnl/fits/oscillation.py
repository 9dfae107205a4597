"""Free-run simulation of one oscillator under a sampled drive, fast enough to fit long records."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.interpolate import make_interp_spline

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Hold = Literal["zero-order", "band-limited"]

STAGES = DOP853.n_stages
A, B, C = DOP853.A[:STAGES, :STAGES], DOP853.B, DOP853.C[:STAGES]
# Decay times after which less than 1e-10 of what a record began with is left, where its forces are not unstable on the way.
SETTLED = 24.0
# A stretch starts from rest so many decay times before its first sample: more, as strong forces of third order remember for longer.
MEMORY = 1.5 * SETTLED
# Numbers that an array operation handles in the time of its overhead: so wide may the stretches run side by side.
WIDE = 500
# Degree of the drive's spline: of a band up to half the Nyquist frequency it misses 4e-8 of the rms, up to two thirds 1e-5 (5: 4e-4, 5e-3).
SPLINE = 13
# Samples at the record's ends over which the spline feels that the drive is not known further, down to those parts.
EDGE = 32
# Phase [rad] of the fastest swing by which one step may go on: it errs by less than 1e-5 of the amplitude.
REACH = 1.0
MOST = 8
# What an oscillation that overflows on the way is taken for.
DIVERGED = 1e6


@dataclass(frozen=True, eq=False)
class Drive:
    """Drive at the times where the integrator asks for it.

    held: (STAGES, n · steps) at the stages of each step; interval: between the n samples [s]; steps: from one sample to the next.
    """

    held: Array
    interval: float
    steps: int


def stages(drive: Array, interval: float, hold: Hold, steps: int = 1) -> Drive:
    """Return a drive (n,) of samples by interval [s] at the stages of so many steps a sample, see `steps_needed`.

    zero-order: u is constant from each sample to the next, as behind a digital-to-analogue converter. band-limited: u is the
    smooth signal through the samples, as where the drive was itself recorded through an anti-aliasing filter; spline of high degree.
    """
    if hold == "zero-order":
        return Drive(np.broadcast_to(np.repeat(drive, steps), (STAGES, len(drive) * steps)), interval, steps)
    time = np.arange(len(drive))
    spline = make_interp_spline(time, drive, k=SPLINE)
    begin = np.arange(len(drive) * steps) / steps
    return Drive(np.stack([spline(np.minimum(begin + c / steps, time[-1])) for c in C]), interval, steps)


def steps_needed(coefficients: NDArray[np.inexact], largest: float, interval: float) -> int:
    """Return how many steps from sample to sample follow the fastest swing of an oscillator (8,) or (7,) up to y = ±largest.

    At most MOST: what swings faster is not sampled.
    """
    _, _, _, _, stiffness, quadratic, cubic, *fifth = coefficients.real
    slopes = [stiffness + y * (2 * quadratic + y * (3 * cubic + 5 * y * y * sum(fifth))) for y in (-largest, 0.0, largest)]
    return int(np.clip(np.ceil(np.sqrt(max(*slopes, 0.0)) * interval / REACH), 1, MOST))


def predictable(n: int, decay: float) -> NDArray[np.bool_]:
    """Return which of n samples (n,) a free run from rest under a band-limited drive can predict of a record cut from a longer motion.

    Not those at its begin, where that motion has not died away (at most half of them), nor the last ones, where the drive's spline ends.

    Args:
        n: samples of the record.
        decay: amplitude's rate of decay γ/2 times the interval between samples.
    """
    found = np.ones(n, dtype=bool)
    found[: min(int(np.ceil(SETTLED / decay)), n // 2)] = False
    found[n - EDGE :] = False
    return found


def free_run(coefficients: NDArray[np.inexact], drive: Drive) -> NDArray[np.inexact]:
    """Return the output (m, n) at the samples, from rest, for m oscillators under one drive at once.

    ÿ = c₀ (u + c₁) − c₂ (1 + c₃ y²) ẏ − c₄ y − c₅ y² − c₆ y³ − c₇ y⁵

    Steps of the eighth-order Dormand–Prince method; the record is cut into stretches that run side by side, each from
    rest, long enough before its own samples for its start to be forgotten.

    Args:
        coefficients: (8, m), or (7, m) without the last; complex ones carry a derivative on the imaginary part.
        drive: from `stages`, with as many steps as the oscillators need.
    Valid: positive damping, one stable rest state.
    """
    m, n, repeat = coefficients.shape[1], drive.held.shape[1] // drive.steps, drive.steps
    decay = np.maximum(coefficients[2].real, 1e-9) * drive.interval / 2
    memory = int(min(np.ceil(MEMORY / np.min(decay)), n))
    count = max(1, round(np.sqrt(WIDE * n / (memory * m))))
    length = -(-n // count)
    padded = np.pad(drive.held, ((0, 0), (memory * repeat, (length * count - n) * repeat)))
    first = np.arange(count) * length * repeat
    state = np.zeros((2, m, count), dtype=coefficients.dtype)
    out = np.empty((m, count, length), dtype=coefficients.dtype)
    slopes = np.empty((STAGES, *state.shape), dtype=coefficients.dtype)
    flat, weights, ends = slopes.reshape(STAGES, -1), drive.interval / repeat * A, drive.interval / repeat * B
    gain, offset, damping, nonlinear, stiffness, quadratic, cubic, *fifth = coefficients[:, :, None]
    with np.errstate(over="ignore", invalid="ignore"):
        for step in range((memory + length) * repeat):
            if step >= memory * repeat and step % repeat == 0:
                out[:, :, step // repeat - memory] = state[0]
            now = padded[:, first + step]
            for i in range(STAGES):
                y, v = state if i == 0 else state + (weights[i, :i] @ flat[:i]).reshape(state.shape)
                slopes[i, 0] = v
                pull = damping * (1 + nonlinear * y * y) * v + y * (stiffness + y * (quadratic + y * cubic))
                for quintic in fifth:
                    pull = pull + quintic * y**5
                slopes[i, 1] = gain * (now[i] + offset) - pull
            state = state + (ends @ flat).reshape(state.shape)
    out = out.reshape(m, -1)[:, :n]
    return np.where(np.isfinite(out), out, DIVERGED)
