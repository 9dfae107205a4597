"""Statistics of the power of a signal with noise behind an analyser's filter.

Behind the filter, signal and noise add as complex amplitudes, a + n, n complex normal with mean
power N. The power p = |a + n|², averaged over M independent values, follows a noncentral χ² with 2M
degrees of freedom. M = 1 is Rice's distribution of the amplitude, and with no signal Rayleigh's.

The noise is that of the floor and a part that grows with the signal, N = N₀ + κ|a|²: the working
point of the interferometer, the light and the filter's detuning fluctuate in proportion to it.
Powers here are in one unit, and y = ln p is what is compared.
Source: Rice, Bell System Technical Journal 24, 46 (1945).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e, i1e, ive

Array = NDArray[np.float64]
FAR = 50.0
"""Argument of I_v from which TERMS terms of its expansion are exact to 1e-14, or 2v² if more."""
TERMS = 14
"""Of Hankel's expansion: at x = 2v² the k-th is 4^{-k}/k! of the first."""


def log_density(y: Array, signal: Array, noise: Array, averages: float) -> tuple[Array, ...]:
    """Return ln f(y) and its derivatives by signal and by noise, each (n,).

    f(y) = x e^{−M(p + S)/N} (p/S)^{(M−1)/2} I_{M−1}(x), x = 2M√(pS)/N, up to p = e^y and factors.

    Args:
        y: ln of the measured power (n,).
        signal: power S of the signal (n,), positive.
        noise: mean power N of the noise (n,), positive.
        averages: M ≥ 1.
    """
    m = averages
    power = np.exp(y)
    x = 2 * m * np.sqrt(power * signal) / noise
    log_bessel, ratio = _bessel(m - 1, x)
    away = m * (np.sqrt(power) - np.sqrt(signal)) ** 2 / noise
    value = np.log(m / noise) + y + 0.5 * (m - 1) * (y - np.log(signal)) - away + log_bessel
    by_signal = -m / noise + ratio * x / (2 * signal)
    by_noise = -m / noise + m * (power + signal) / noise**2 - ratio * x / noise
    return value, np.asarray(by_signal), np.asarray(by_noise)


def _bessel(order: float, x: Array) -> tuple[Array, Array]:
    """Return ln(e^{−x} I_v(x)) and I_{v+1}(x)/I_v(x), (n,)."""
    value = np.empty_like(x)
    ratio = np.empty_like(x)
    far = x > max(FAR, 2 * (order + 1) ** 2)
    near = x[~far]
    # The library takes a hundred times as long for an order that is a variable
    low, high = (i0e(near), i1e(near)) if order == 0 else (ive(order, near), ive(order + 1, near))
    bessel = np.maximum(low, np.finfo(float).tiny)
    value[~far] = np.log(bessel)
    ratio[~far] = high / bessel
    large = x[far]
    sums = _expansion(order, large)
    value[far] = np.log(sums) - 0.5 * np.log(2 * np.pi * large)
    ratio[far] = _expansion(order + 1, large) / sums
    return value, ratio


def _expansion(order: float, x: Array) -> Array:
    """Return √(2πx) e^{−x} I_v(x) for large x, (n,).

    Source: DLMF 10.40.1.
    """
    inverse = 1 / (8 * x)
    found = np.ones_like(x)
    # By Horner's rule, from the last term on
    for k in range(TERMS, 0, -1):
        found = 1 - (4 * order**2 - (2 * k - 1) ** 2) / k * inverse * found
    return found


def normal_score(y: Array, signal: Array, noise: Array, averages: float) -> Array:
    """Return what is normal with unit variance where y = ln p follows the distribution, (n,).

    The cube root of a noncentral χ² is nearly normal.
    Source: Abdel-Aty, Biometrika 41, 538 (1954).
    """
    degrees = 2 * averages
    shift = 2 * averages * signal / noise
    ratio = (2 * averages * np.exp(y) / noise) / (degrees + shift)
    variance = 2 * (degrees + 2 * shift) / (9 * (degrees + shift) ** 2)
    return np.asarray((np.cbrt(ratio) - (1 - variance)) / np.sqrt(variance))
