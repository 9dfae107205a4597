"""Displacement in metres without a ruler.

The wavelength is the ruler, and the harmonics say how far the motion runs along it.
"""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from femnl.core.errors import ParameterError
from femnl.core.fit import MapFit
from femnl.core.readout import Array, PeriodicFringe
from femnl.observe.map.forward import flatten
from femnl.optics.unit_fringe import real_part

REACH = 1.5
"""Displacements are sought up to this multiple of the fitted amplitude."""
STEP = 0.02
"""Step of the search in z, in rad."""


def taylor_amplitude(harmonics: ArrayLike, wavelength: float) -> tuple[Array, Array]:
    """Return the amplitude of one spot from a fringe expanded to fourth order.

    Once from V₃/V₁ and once from V₄/V₂.

    With f⁽³⁾ = −q²f⁽¹⁾ and f⁽⁴⁾ = −q²f⁽²⁾ of a sine, q = 4π/λ and z = qU, the expansion gives
    −V₃/V₁ = (z²/24)/(1 − z²/8) and −V₄/V₂ = (z²/48)/(1 − z²/12) after the phases nφ are taken off,
    so that z² = 24s/(1 + 3s) or 48s/(1 + 4s).

    Args:
        harmonics: complex V₁ … V₄, shape (4, …).
        wavelength: λ [m].

    Returns:
        U [m] from the odd and from the even harmonics, shape (…); NaN where the ratio has no real
        solution.

    Valid: z well below 1 and a sinusoidal fringe: 3 % low at z = 1, meaningless beyond z = 2.
    Source: the method of Dolleman et al., arXiv:1711.06056, as described by
    Sommer et al. 2025, supplement S7.
    """
    V = np.asarray(harmonics, complex)
    if V.shape[0] != 4:
        raise ParameterError(
            f"harmonics has {V.shape[0]} rows, but the method takes the first four"
        )
    turn = np.conj(V[0] / np.abs(V[0])) ** 2
    found = []
    for ratio, a, b in ((V[2] / V[0], 24, 3), (V[3] / V[1], 48, 4)):
        s = -(ratio * turn).real
        square = a * s / (1 + b * s)
        found.append(np.sqrt(np.where(square > 0, square, np.nan)) * wavelength / (4 * np.pi))
    return found[0], found[1]


def displacement(
    data: xr.Dataset, fit: MapFit, fringe: PeriodicFringe | None = None
) -> tuple[Array, Array]:
    """Return the displacement at every point of a map from its harmonics, without the mode shape.

    a(x, y) minimises Σ_n |V_n − V_C e^{inφ} g_n(a)|², with V_C, θ, φ and the form of the fringe
    from a fit of the map.

    Args:
        data: Dataset of kind `map`, the one that was fitted.
        fit: its fit.
        fringe: the fringe that was fitted; one cosine where it was None.

    Returns:
        a [m], negative in antiphase, and its standard deviation [m] from the noise, both (n_y,
        n_x); NaN where nothing was measured.

    Valid: |a| up to 1.5 times the fitted amplitude; noise below the difference between neighbouring
    fringes, else a may be off by about one of them.
    """
    points = flatten("", data, fringe)
    values = {name: parameter.value for name, parameter in fit.fit.parameters.items()}
    largest = REACH * abs(values["amplitude"])
    trial = np.linspace(-largest, largest, 2 * int(np.ceil(points.wavenumber * largest / STEP)) + 1)
    n = points.harmonic[:, None]
    still = np.where(
        points.present, points.values * np.exp(-1j * n * values["motion_phase"]), 0
    ).real

    parts = real_part(points.series, points.harmonic, trial, values)
    model = values["contrast"] * parts["motion"]
    misfit = points.present.T @ model**2 - 2 * still.T @ model
    a = trial[np.argmin(misfit, axis=1)]
    for _ in range(4):
        parts = real_part(points.series, points.harmonic, a, values)
        steep = np.where(points.present, values["contrast"] * parts["by_displacement"], 0)
        left = np.where(points.present, still - values["contrast"] * parts["motion"], 0)
        norm = np.maximum(np.sum(steep**2, axis=0), np.finfo(float).tiny)
        a = a + np.clip(
            np.sum(steep * left, axis=0) / norm, -(trial[1] - trial[0]), trial[1] - trial[0]
        )
    images = []
    for flat in (a, points.noise / np.sqrt(norm)):
        whole = np.full(points.pixels[1], np.nan)
        whole.ravel()[points.pixels[0]] = flat
        images.append(whole)
    return images[0], images[1]
