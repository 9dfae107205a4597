"""Free-run simulation of one oscillator under a sampled drive, fast enough to fit long records."""

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
# A stretch starts from rest so many decay times before its first sample that less than 1e-10 of its start is left.
MEMORY = 24.0
# Numbers that an array operation handles in the time of its overhead: so wide may the stretches run side by side.
WIDE = 500
SPLINE = 5
# What an oscillation that overflows on the way is taken for.
DIVERGED = 1e6


def stages(drive: Array, hold: Hold) -> Array:
    """Return the drive (STAGES, n) at the times inside each interval where the integrator asks for it.

    zero-order: u is constant from each sample to the next, as behind a digital-to-analogue converter. band-limited: u is the
    smooth signal through the samples, as where the drive was itself recorded through an anti-aliasing filter; quintic spline.
    """
    if hold == "zero-order":
        return np.broadcast_to(drive, (STAGES, len(drive)))
    time = np.arange(len(drive))
    spline = make_interp_spline(time, drive, k=SPLINE)
    return np.stack([spline(np.minimum(time + c, time[-1])) for c in C])


def free_run(coefficients: NDArray[np.inexact], drive: Array, interval: float) -> NDArray[np.inexact]:
    """Return the output (m, n) at the samples, from rest, for m oscillators under one drive at once.

    ÿ = c₀ (u + c₁) − c₂ (1 + c₃ y²) ẏ − c₄ y − c₅ y² − c₆ y³ − c₇ y⁵

    One step of the eighth-order Dormand–Prince method a sample; the record is cut into stretches that run side by side, each from
    rest, long enough before its own samples for its start to be forgotten.

    Args:
        coefficients: (8, m), or (7, m) without the last; complex ones carry a derivative on the imaginary part.
        drive: (STAGES, n) from `stages`.
        interval: between samples [s].
    Valid: ω₀ · interval below about 1, where a step errs by less than 1e-5 of the amplitude; positive damping, one stable rest state.
    """
    m, n = coefficients.shape[1], drive.shape[1]
    decay = np.maximum(coefficients[2].real, 1e-9) * interval / 2
    memory = int(min(np.ceil(MEMORY / np.min(decay)), n))
    count = max(1, round(np.sqrt(WIDE * n / (memory * m))))
    length = -(-n // count)
    padded = np.concatenate([np.zeros((STAGES, memory)), drive, np.zeros((STAGES, length * count - n))], axis=1)
    first = np.arange(count) * length
    state = np.zeros((2, m, count), dtype=coefficients.dtype)
    out = np.empty((m, count, length), dtype=coefficients.dtype)
    slopes = np.empty((STAGES, *state.shape), dtype=coefficients.dtype)
    flat, weights, ends = slopes.reshape(STAGES, -1), interval * A, interval * B
    gain, offset, damping, nonlinear, stiffness, quadratic, cubic, *fifth = coefficients[:, :, None]
    with np.errstate(over="ignore", invalid="ignore"):
        for step in range(memory + length):
            if step >= memory:
                out[:, :, step - memory] = state[0]
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
