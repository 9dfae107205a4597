"""Dissipation dilution against circular plates, which are exact, and the formula for squares."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ive, ivp, jn_zeros, jv, jvp

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.mechanics.modes.dilution import bending_share, dilution
from femnl.pipeline import solve_modes

Device = Callable[..., Model]
POISSON = 0.23


def film(layer: float) -> str:
    """A film with √(σ/ρ) = 1000 m/s and ℓ = `layer` [m]: E = 12 (1 − ν²) σ (ℓ/h)²."""
    young = 12 * (1 - POISSON**2) * 1e9 * (layer / 1e-6) ** 2
    return (
        f'thickness = "1 um"\nyoung = "{young:.15g} Pa"\npoisson = {POISSON}\ndensity = "1000 '
        'kg/m^3"\nstress = "1 GPa"'
    )


def circular_plate(order: int, layer: float) -> float:
    """(ωR/c)² of the lowest clamped mode with `order` nodal diameters, ℓ in units of R.

    w = J_n(αr)/J_n(α) − I_n(βr)/I_n(β) with β² = α² + 1/ℓ² solves ℓ²∇⁴w − ∇²w = ω²w; the slope
    vanishes at the edge.
    """

    def slope(alpha: float) -> float:
        beta = np.sqrt(alpha**2 + layer**-2)
        ratio = (
            ivp(order, beta) / (ive(order, beta) * np.exp(beta))
            if beta < 600
            else 1 - 1 / (2 * beta)
        )
        return float(alpha * jvp(order, alpha) - beta * ratio * jv(order, alpha))

    membrane = float(jn_zeros(order, 1)[0])
    alpha = brentq(slope, 0.9 * membrane, membrane * (1 + 4 * layer), xtol=1e-15, rtol=1e-15)
    return float(alpha**2 + layer**2 * alpha**4)


def exact_share(order: int, layer: float) -> float:
    """∂ ln ω²/∂ ln ℓ² of the clamped circular plate, by a difference of fourth order."""
    step = 1e-2
    values = [np.log(circular_plate(order, layer * np.exp(k * step))) for k in (-2, -1, 1, 2)]
    return float(np.dot([1, -8, 8, -1], values) / (12 * step) / 2)


def drum(device: Device, layer: float, degree: int) -> Modes:
    model = device(
        'kind = "circle"\ndiameter = "200 um"', film=film(layer * 1e-4), model="bending = true"
    )
    return solve_modes(model, 4, cache=False, degree=degree)


@pytest.mark.parametrize("layer", [0.1, 0.01])
def test_bending_holds_the_part_of_energy_that_the_circular_plate_says(
    layer: float, device: Device
) -> None:
    exact = np.array([exact_share(order, layer) for order in (0, 1, 1, 2)])
    np.testing.assert_allclose(bending_share(drum(device, layer, 6)), exact, rtol=1e-7)
    factor, error = dilution(drum(device, layer, 4))
    assert np.all(np.abs(factor - 1 / exact) < error)
    assert np.all(error < 0.02 * factor)


def test_the_square_membrane_follows_the_published_formula_and_the_next_order_of_a_stiff_string(
    device: Device,
) -> None:
    # A clamped string has f = f₀ [1 + 2ε + (4 + n²π²/2) ε²], ε = ℓ/L (Fletcher, J. Acoust. Soc. Am.
    # 36, 203 (1964)), so that ∂ ln f²/∂ ln ℓ² = 2ε + (n²π² + 4) ε²: the formula of Yu, Purdy and
    # Regal leaves 4ε² out.
    layer = 0.004
    square_numbers = np.array([2, 5, 5, 8])
    model = device(
        'kind = "square"\nside = "100 um"', film=film(layer * 1e-4), model="bending = true"
    )
    share = bending_share(solve_modes(model, 4, cache=False, degree=5))
    edge = 2 * layer
    published = edge + edge**2 * np.pi**2 * square_numbers / 4
    np.testing.assert_allclose((share - published) / layer**2, 4, atol=40 * layer)
    np.testing.assert_allclose(share, published, rtol=2.1 * layer)


def test_a_film_without_bending_is_refused(device: Device) -> None:
    model = device('kind = "circle"\ndiameter = "200 um"')
    with pytest.raises(ParameterError, match="set bending = true"):
        dilution(solve_modes(model, 1, resolution=0.5, cache=False))
