"""The power of a motion that rings down, as a law of time.

One mode decays as S = S₀ e^{−γτ}, where τ counts from the begin of the decay. Every further term
multiplies it and is 1 at its zero:

nonlinear damping γ(1 + ηA²/4): 1/(1 + d(1 − e^{−γτ})), d = ηA₀²/4;
a second mode in the filter: |1 + r e^{(γ − γ₂)τ/2 + i(2πΔτ + φ)}|² / |1 + r e^{iφ}|²;
a frequency that leaves a Gaussian filter at an even pace: e^{−(τ/T)²}, tuned at the begin.
"""

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[np.inexact]
Term = Literal["damping", "pair", "exit"]
"""What may multiply a straight decay."""
PARAMETERS: Mapping[Term, tuple[str, ...]] = {
    "damping": ("damping_ratio",),
    "pair": ("partner", "partner_rate", "splitting", "partner_phase"),
    "exit": ("exit_rate",),
}
"""Parameters that a term brings."""
UNITS: Mapping[str, str] = {
    "level": "dB",
    "decay_rate": "1/s",
    "floor": "dB",
    "wander": "dB",
    "damping_ratio": "",
    "partner": "",
    "partner_rate": "1/s",
    "splitting": "Hz",
    "partner_phase": "rad",
    "exit_rate": "1/s²",
}
"""Units of all parameters."""


def log_signal(values: Mapping[str, complex], time: Array) -> Numbers:
    """Return ln S (n,) at times τ (n,) [s] from the begin of the decay.

    Args: values: `level` ln S₀ and `decay_rate` γ [1/s]; where a term acts, also `damping_ratio` d,
    `exit_rate` 1/T² [1/s²], or `partner` r, `partner_rate` γ₂ [1/s], `splitting` Δ [Hz] and
    `partner_phase` φ [rad]. Complex numbers carry derivatives.
    """
    rate = values["decay_rate"]
    found = values["level"] - rate * time
    if "damping_ratio" in values:
        found = found - np.log(1 - values["damping_ratio"] * np.expm1(-rate * time))
    if "exit_rate" in values:
        found = found - values["exit_rate"] * time**2
    if "partner" in values:
        found = found + _beat(values, time)
    return np.asarray(found)


def turned_by_pair(values: Mapping[str, float], time: Array) -> Array:
    """Return the phase [rad] (n,) by which a second mode turns the sum of both, without jumps."""
    size, angle = _partner(values, time)
    return np.asarray(np.unwrap(np.angle(1 + size * np.exp(1j * angle))))


def _partner(values: Mapping[str, complex], time: Array) -> tuple[Numbers, Numbers]:
    """Return amplitude and phase [rad] (n,) of a second mode, seen from the first one."""
    size = values["partner"] * np.exp((values["decay_rate"] - values["partner_rate"]) * time / 2)
    angle = 2 * np.pi * values["splitting"] * time + values["partner_phase"]
    return np.asarray(size), np.asarray(angle)


def _beat(values: Mapping[str, complex], time: Array) -> Numbers:
    """Return the logarithm of what a second mode does to the power, 0 at the begin."""
    ratio = values["partner"]
    phase = values["partner_phase"]
    size, angle = _partner(values, time)
    # |1 + s e^{iα}|² written without |·|, which has no complex derivative.
    beat = 1 + 2 * size * np.cos(angle) + size**2
    return np.asarray(np.log(beat) - np.log(1 + 2 * ratio * np.cos(phase) + ratio**2))
