"""Harmonics of a fringe at many points at once, where each point has its own amplitude and its own phase of the fringe."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import jv, jvp

from femnl.types.readout import Array, ComplexArray
from femnl.types.scene import Fringe, Motion

Orders = NDArray[np.int64]

NODES = 32
"""Nodes a unit of z at which Bessel functions are tabulated; the interpolation errs by less than 1e-8."""
FAINT = 1e-6
"""Overtones of the fringe below this part of the first change no map that can be measured."""
PHASES = 4096
"""Phases at which the largest value of a fringe is sought: of a cosine it is good to 3e-7."""


def harmonics(motion: Motion, fringe: Fringe, harmonic: Orders) -> ComplexArray:
    """Return V_n/V_C at every point, (n_harmonics, n_points), v(t) = Σ_n Re(V_n e^{inωt}).

    A sinusoidal motion under a fringe without limits is summed over Bessel functions, any other sampled over a period.
    """
    q = 4 * np.pi / fringe.wavelength
    kept = np.flatnonzero(np.abs(fringe.coefficients) > FAINT * np.abs(fringe.coefficients[1:]).max())
    orders = kept[kept > 0]
    if len(motion.displacement) == 1 and np.isinf(fringe.limit):
        return _by_bessel(motion, fringe.coefficients[orders], orders, q, harmonic)
    return _by_sampling(motion, fringe, orders, q, harmonic)


def _by_bessel(motion: Motion, coefficients: ComplexArray, orders: Orders, q: float, harmonic: Orders) -> ComplexArray:
    amplitude, theta = np.abs(motion.displacement[0]), motion.theta if np.ptp(motion.theta) else motion.theta[:1]
    quarter = 2 * np.array([1, 1j, -1, -1j])[harmonic % 4][:, None]
    real = np.zeros((len(harmonic), len(amplitude)))
    for k, c in zip(orders, coefficients, strict=True):
        real += (quarter * c * np.exp(1j * k * theta)).real * _bessel(harmonic, k * q * amplitude)
    return np.asarray(real * np.exp(1j * harmonic[:, None] * np.angle(motion.displacement[0])))


def _bessel(harmonic: Orders, argument: Array) -> Array:
    """Return J_n(z), (n_harmonics, n_points), from a table by cubic Hermite interpolation."""
    value, slope = _table(tuple(harmonic.tolist()), int(np.ceil(argument.max() / 32 + 1e-9)) * 32)
    place = argument * NODES
    left = place.astype(np.int64)
    s = place - left
    rest = 1 - s
    low = value[:, left] * (1 + 2 * s) + slope[:, left] * s
    high = value[:, left + 1] * (3 - 2 * s) - slope[:, left + 1] * rest
    return np.asarray(low * rest**2 + high * s**2)


@lru_cache(maxsize=16)
def _table(harmonic: tuple[int, ...], longest: int) -> tuple[Array, Array]:
    """Return J_n and its change over one step of the table, (n_harmonics, n_nodes), up to z = longest."""
    z, n = np.arange(longest * NODES + 2) / NODES, np.array(harmonic)[:, None]
    return jv(n, z), jvp(n, z) / NODES


def _largest(series: ComplexArray) -> float:
    """Return the largest |Re Σ_k c_k e^{ikφ}| over all φ."""
    return float(np.abs(np.fft.irfft(np.append(0, series[1:]), PHASES)).max() * PHASES / 2)


def _by_sampling(motion: Motion, fringe: Fringe, orders: Orders, q: float, harmonic: Orders) -> ComplexArray:
    reach = q * np.sum(np.abs(motion.displacement) * np.arange(1, len(motion.displacement) + 1)[:, None], axis=0).max()
    sharp = 1 if np.isinf(fringe.limit) else 4  # a clipped signal has many harmonics that would be folded back
    n_samples = sharp * (32 + 2 * int(harmonic.max() + orders.max() * reach))
    tau = 2 * np.pi * np.arange(n_samples) / n_samples
    u = sum(np.outer(np.cos(m * tau), part.real) - np.outer(np.sin(m * tau), part.imag) for m, part in enumerate(motion.displacement, 1))
    turn = np.exp(1j * (q * u + motion.theta))
    series = np.zeros(orders.max() + 1, complex)
    series[orders] = fringe.coefficients[orders]
    v = np.polynomial.polynomial.polyval(turn, series).real
    if np.isfinite(fringe.limit):
        top = fringe.limit * _largest(series)
        v = np.clip(v, -top, top)
    return np.asarray(2 / n_samples * np.exp(-1j * np.outer(harmonic, tau)) @ v)
