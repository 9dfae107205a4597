"""A fringe as fits see it.

Scaled so that its first overtone is one cosine (c₁ = 1), and the harmonics it makes with their
derivatives.

V_C and θ then mean the same for a sine and for a stack: V_n = V_C e^{inφ} Σ_k 2Re(c_k iⁿ e^{ikθ})
J_n(kqa) for motion a cos(ωt + φ).
"""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from femnl.core.errors import ParameterError
from femnl.core.readout import Array, ComplexArray, FourierSeries

Orders = np.ndarray[tuple[int], np.dtype[np.int64]]

OVERTONE = "overtone_{k}_{part}"
"""Names of the free parts of an overtone of the fringe, relative to its fundamental; part is `real`
or `imag`.
"""
FAINT = 1e-7
"""Overtones of the fringe below this part of the first change nothing that can be measured and are
left out.
"""
NODES = 64
"""Nodes a radian of z at which the harmonics are tabulated: the interpolation errs by less than
1e-7 of V_C.
"""


def cosine(wavelength: float) -> FourierSeries:
    """Return cos(4πu/λ) for λ [m]."""
    return FourierSeries(wavelength / 2, np.array([0, 1], complex))


def unit_fringe(series: FourierSeries) -> FourierSeries:
    """Return the fringe without offset and faint overtones, scaled and shifted to c₁ = 1."""
    first = series.coefficients[1] if len(series.coefficients) > 1 else 0.0
    if first == 0:
        raise ParameterError(
            f"the fringe does not change with displacement at its period {series.period:g} m; "
            "give one that does"
        )
    k = np.arange(len(series.coefficients))
    unit = np.where(k == 0, 0, series.coefficients / abs(first) * np.exp(-1j * k * np.angle(first)))
    return FourierSeries(series.period, unit[: np.flatnonzero(abs(unit) > FAINT)[-1] + 1])


def overtone_weights(series: FourierSeries, harmonic: Orders, theta: Array) -> tuple[Array, Array]:
    """Return 2Re(c_k iⁿ e^{ikθ}) and its derivative by θ.

    Both have the shape (*theta.shape, n_harmonics, n_overtones).
    """
    k = np.arange(1, len(series.coefficients))
    turned = (
        series.coefficients[1:] * 1j ** harmonic[:, None] * np.exp(1j * k * theta[..., None, None])
    )
    return 2 * turned.real, -2 * k * turned.imag


def real_part(
    series: FourierSeries, harmonic: Orders, displacement: Array, values: dict[str, float]
) -> dict[str, Array]:
    """Return g_n(a) = V_n e^{−inφ}/V_C as `motion`, and its derivatives.

    The derivatives are by a [m], by θ and by the free overtones.

    g_n = (2/N) Σ_j f(qa cos ψ_j + θ) cos nψ_j at ψ_j = π(j + ½)/N, which is exact once 2N exceeds
    the content of v(t) (the sum over Bessel functions of `readout` is the same to rounding and far
    slower). All points share g_n(a), so it is computed with its slope at close nodes and
    interpolated to fourth order.
    """
    q = 2 * np.pi / series.period
    fringe, free = _free_overtones(series, values)
    k = np.arange(len(fringe))
    n_nodes = 64 + int(NODES * q * np.ptp(displacement))
    few = n_nodes >= displacement.size or q * np.ptp(displacement) < 1e-6
    nodes = displacement if few else np.linspace(displacement.min(), displacement.max(), n_nodes)
    n_samples = 16 + int(harmonic.max() + k[-1] * q * np.abs(nodes).max()) // 2
    psi = np.pi * (np.arange(n_samples) + 0.5) / n_samples
    turn = np.exp(1j * (q * nodes[:, None] * np.cos(psi) + values["fringe_phase"]))
    project = 2 / n_samples * np.cos(psi[:, None] * harmonic)
    along = q * np.cos(psi[:, None]) * project
    f, by_phase, twice = (
        np.polynomial.polynomial.polyval(turn, (1j * k) ** m * fringe).real for m in range(3)
    )
    samples = {"motion": (f, by_phase), "fringe_phase": (by_phase, twice)}
    samples |= {
        name: ((unit * turn**j).real, (1j * j * unit * turn**j).real)
        for name, (j, unit) in free.items()
    }
    value = np.stack([sample @ project for sample, _ in samples.values()], axis=-1)
    slope = np.stack([sample @ along for _, sample in samples.values()], axis=-1)
    if not few:
        spline = CubicHermiteSpline(nodes, value, slope)
        value = spline(displacement)
        slope = spline(displacement, 1)
    return dict(zip(samples, value.T, strict=True)) | {"by_displacement": slope.T[0]}


def _free_overtones(
    series: FourierSeries, values: dict[str, float]
) -> tuple[ComplexArray, dict[str, tuple[int, complex]]]:
    """Return the coefficients of the fringe with its free overtones added.

    The second result is the order and the unit (1 or i) of each free parameter.
    """
    free = {
        name: (int(name.split("_")[1]), 1j if name.endswith("imag") else 1 + 0j)
        for name in values
        if name.startswith("overtone_")
    }
    fringe = np.zeros(max([len(series.coefficients), *(k + 1 for k, _ in free.values())]), complex)
    fringe[: len(series.coefficients)] = series.coefficients
    for name, (k, unit) in free.items():
        fringe[k] += unit * values[name]
    return fringe, free
