"""Free decay of one mode with amplitude-dependent frequency and damping, in closed form."""

import numpy as np
from numpy.typing import ArrayLike

from femnl.core.resonator import Complex, Resonator

# Below this z the closed forms lose digits to cancellation; their series to z³ are then exact to
# 1e-13.
SMALL = 1e-3


def ring_down(resonator: Resonator, amplitude: complex, time: ArrayLike) -> Complex:
    """Return the complex amplitude A(t) [m] of a free decay, u(t) = Re A(t).

    X = |A|² falls as X₀ e^{−γt} / (1 + z s), s = 1 − e^{−γt}, z = ηX₀/4; the phase runs as
    √(ω₀² − γ²/4) t + ω₀ ∫ (⅜ α X + 5/16 α₅ X²) dt, with α lowered by (10/9)κ₂².

    Args:
        resonator: the mode; its force-free equation is used.
        amplitude: A(0) [m].
        time: (n,) [s], from 0.
    Valid: first-order averaging: relative errors of order α X₀, κ₂√X₀ (a constant offset and a
    second harmonic) and ηX₀/Q.
    Source: Nayfeh and Mook, Nonlinear Oscillations (1979), section 3.3.
    """
    t = np.asarray(time, dtype=float)
    gamma = resonator.damping
    omega = resonator.omega
    square = abs(amplitude) ** 2
    z = resonator.nonlinear_damping * square / 4
    s = -np.expm1(-gamma * t)
    magnitude = np.abs(amplitude) * np.exp(-gamma * t / 2) / np.sqrt(1 + z * s)
    if abs(z) < SMALL:
        first = s - z * s**2 / 2 + z**2 * s**3 / 3 - z**3 * s**4 / 4
        second = (
            s
            - (1 + 2 * z) * s**2 / 2
            + (2 * z + 3 * z**2) * s**3 / 3
            - (3 * z**2 + 4 * z**3) * s**4 / 4
            + z**3 * s**5 * 4 / 5
        )
    else:
        first = np.log1p(z * s) / z
        second = ((1 + z) * s / (1 + z * s) - first) / z
    shift = (
        0.375 * resonator.effective_alpha * square * first
        + 0.3125 * resonator.quintic * square**2 * second
    )
    phase = np.sqrt(omega**2 - gamma**2 / 4) * t + omega / gamma * shift + np.angle(amplitude)
    return np.asarray(magnitude * np.exp(1j * phase))
