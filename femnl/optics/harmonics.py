"""Harmonics of the drive that a nonlinear readout v = f(u) makes of a sinusoidal motion.

u(t) = u₀ + U cos(ωt + φ).

v(t) = Σ_n Re(V_n e^{inωt}), so |V_n| = 2|v_n| and V_0 = v_0. A negative U means motion in
antiphase.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import jv

from femnl.core.comparison import Curve, Curves, Images
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.readout import Array, ComplexArray, FourierSeries, HarmonicMap, PeriodicFringe

Fringe = Callable[[Array], Array]

MOST_SAMPLES = 2**16
"""Samples of one period of the motion beyond which the FFT gives up."""


def harmonics(
    fringe: Fringe,
    harmonic: ArrayLike,
    amplitude: ArrayLike,
    phase: ArrayLike = 0.0,
    rest: ArrayLike = 0.0,
) -> ComplexArray:
    """Return the amplitudes V_n of the harmonics of v = f(u₀ + U cos(ωt + φ)).

    A fringe that knows its Fourier series is summed over Bessel functions, any other goes through
    an FFT of one period.

    Args:
        fringe: f, u [m] → v [V].
        harmonic: orders n ≥ 0, shape (n_harmonics,).
        amplitude: U [m], any shape; negative in antiphase.
        phase: φ [rad], broadcast with amplitude.
        rest: u₀ [m], the static displacement, broadcast with amplitude.

    Returns:
        Complex V_n [V], shape (n_harmonics, *broadcast shape of amplitude, phase and rest).

    Raises:
        ConvergenceError: an f too rough for 65 536 samples a period.

    Source: Sommer et al. 2025, supplement S7.
    """
    if isinstance(fringe, PeriodicFringe):
        return harmonics_by_bessel(fringe.fourier, harmonic, amplitude, phase, rest)
    return harmonics_by_fft(fringe, harmonic, amplitude, phase, rest)


def harmonics_by_bessel(
    series: FourierSeries,
    harmonic: ArrayLike,
    amplitude: ArrayLike,
    phase: ArrayLike = 0.0,
    rest: ArrayLike = 0.0,
) -> ComplexArray:
    """Return V_n of a periodic f from the Jacobi–Anger expansion.

    V_n = 2 e^{inφ} Σ_k Re(c_k iⁿ e^{ikqu₀}) J_n(kqU), with q = 2π/Λ = 4π/λ; V_0 without the 2. For
    one cosine this is 2V_C {sin θ, cos θ} J_n(z) (−1)^⌈n/2⌉ e^{inφ}, z = 4πU/λ.

    Args, Returns: as in `harmonics`.
    Source: Sommer et al. 2025, supplement S7, Eq. (vnmodel), extended to overtones of the fringe.
    """
    orders = _orders(harmonic)
    U, phi, u0 = np.broadcast_arrays(
        *(np.asarray(value, float) for value in (amplitude, phase, rest))
    )
    n = orders.reshape(-1, *(1,) * U.ndim)
    q = 2 * np.pi / series.period
    values = np.where(n == 0, series.coefficients[0].real, 0.0) + np.zeros_like(U)
    for k, coefficient in enumerate(series.coefficients[1:], start=1):
        weight = (coefficient * _QUARTER_TURNS[n % 4] * np.exp(1j * k * q * u0)).real
        values = values + np.where(n == 0, 1.0, 2.0) * weight * jv(n, k * q * U)
    return np.asarray(values * np.exp(1j * n * phi))


def harmonics_by_fft(
    fringe: Fringe,
    harmonic: ArrayLike,
    amplitude: ArrayLike,
    phase: ArrayLike = 0.0,
    rest: ArrayLike = 0.0,
    tolerance: float = 1e-12,
) -> ComplexArray:
    """Return V_n of any f from the FFT of one period of v(t), its samples doubled until V_n rests.

    Args, Returns: as in `harmonics`; tolerance: change of any V_n at the last doubling, relative to
    the largest.

    Raises:
        ConvergenceError: not at rest with 65 536 samples; a kink in f (saturation) wants a larger
        tolerance.
    """
    orders = _orders(harmonic)
    U, phi, u0 = np.broadcast_arrays(
        *(np.asarray(value, float) for value in (amplitude, phase, rest))
    )
    turns = np.exp(1j * orders.reshape(-1, *(1,) * U.ndim) * phi)
    before: ComplexArray | None = None
    n_samples = max(32, 2 ** int(np.ceil(np.log2(4 * (orders.max() + 1)))))
    while n_samples <= MOST_SAMPLES:
        cosine = np.cos(2 * np.pi * np.arange(n_samples) / n_samples)
        spectrum = np.fft.rfft(fringe(u0[..., None] + U[..., None] * cosine), axis=-1) / n_samples
        # The motion is even in time about ωt = −φ, so that v_n e^{−inφ} is real.
        now = np.moveaxis(spectrum.real[..., orders], -1, 0) * np.where(orders == 0, 1, 2).reshape(
            -1, *(1,) * U.ndim
        )
        if before is not None and np.abs(now - before).max(initial=0.0) <= tolerance * np.abs(
            spectrum
        ).max(initial=0.0):
            return np.asarray(now * turns)
        before = now
        n_samples = 2 * n_samples
    raise ConvergenceError(
        f"harmonics of f(u) still move by more than {tolerance:g} with {MOST_SAMPLES} samples a "
        "period: raise the tolerance or smooth f"
    )


def harmonic_map(
    fringe: Fringe,
    harmonic: ArrayLike,
    shape: ArrayLike,
    amplitude: float,
    *,
    x: ArrayLike,
    y: ArrayLike,
    wavelength: float,
    phase: float = 0.0,
    rest: ArrayLike = 0.0,
) -> HarmonicMap:
    """Return the maps V_n(x, y) of a membrane that moves as U ξ(x, y) cos(ωt + φ).

    Args:
        fringe: f, u [m] → v [V].
        harmonic: orders n ≥ 1, shape (n_harmonics,).
        shape: ξ, (n_y, n_x), max|ξ| = 1.
        amplitude: U [m] where |ξ| = 1.
        x: coordinates [m], (n_x,).
        y: coordinates [m], (n_y,).
        wavelength: λ [m] of the laser, recorded in the map.
        phase: φ [rad].
        rest: static displacement [m], scalar or (n_y, n_x).

    Returns:
        The harmonic map, without noise.
    """
    x, y, xi = (np.asarray(value, float) for value in (x, y, shape))
    if xi.shape != (y.size, x.size):
        raise ParameterError(
            f"the shape has {xi.shape} points where y and x have ({y.size}, {x.size}): evaluate "
            "it on the same grid"
        )
    return HarmonicMap(
        x,
        y,
        _orders(harmonic),
        harmonics(fringe, harmonic, amplitude * xi, phase, rest),
        wavelength,
    )


def trace(
    fringe: Fringe,
    time: ArrayLike,
    frequency: float,
    amplitude: ArrayLike,
    phase: ArrayLike = 0.0,
    rest: ArrayLike = 0.0,
) -> Array:
    """Return the voltage v(t) = f(u₀ + U cos(2πft + φ)).

    Args:
        fringe: f, u [m] → v [V].
        time: t [s], shape (n_time,).
        frequency: drive frequency f [Hz].
        amplitude: U [m], broadcast with phase and rest.
        phase: φ [rad].
        rest: u₀ [m].

    Returns:
        v [V], shape (*broadcast shape, n_time).
    """
    t = 2 * np.pi * frequency * np.asarray(time, float)
    U, phi, u0 = (np.asarray(value, float)[..., None] for value in (amplitude, phase, rest))
    return fringe(u0 + U * np.cos(t + phi))


_QUARTER_TURNS = np.array([1, 1j, -1, -1j])


def _orders(harmonic: ArrayLike) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return the orders as a flat integer array; refuse negative or fractional ones."""
    orders = np.atleast_1d(np.asarray(harmonic))
    if (
        orders.ndim != 1
        or orders.size == 0
        or np.any(orders < 0)
        or np.any(orders != np.round(orders))
    ):
        raise ParameterError(f"harmonic = {harmonic!r} is not a list of whole numbers 0, 1, 2, …")
    return orders.astype(np.int64)


def signal_phase(volts: ComplexArray) -> float:
    """Return phase ψ, in (−π/2, π/2], for which Re(V e^{−iψ}) holds most of Σ|V|²: ψ = ½ arg ΣV².

    Args: complex amplitudes V [V], any shape; NaN is left out. Returns: ψ [rad]; with the sign of V
    kept as it is stored.
    """
    known = volts[np.isfinite(volts)]
    return float(0.5 * np.angle(np.sum(known**2))) if known.size else 0.0


def along_line(images: Images) -> Curves:
    """Turn harmonics over a grid of a single row or column into curves.

    The curve of a harmonic is the quadrature that holds its signal, see `signal_phase`.

    Args: images with n_x = 1 or n_y = 1. Returns: a curve [V] for each harmonic against x or y, the
    data's sd, the models' predictions.
    """
    name, along = ("x", images.x) if images.y.size == 1 else ("y", images.y)
    curves = []
    for n, data, models in zip(
        images.harmonic, images.data, np.moveaxis(images.predictions, 1, 0), strict=True
    ):
        turn = np.exp(-1j * signal_phase(data))
        predicted = (models * turn).real.reshape(len(images.models), -1)
        curves.append(
            Curve(
                f"{n}f",
                along,
                (data * turn).real.ravel(),
                np.full(along.shape, images.noise),
                predicted,
            )
        )
    return Curves(images.title, name, "m", "signal", "V", images.models, tuple(curves))
