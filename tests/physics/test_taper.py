"""Films of uneven thickness against closed forms in the plane and Ritz series out of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Legendre
from numpy.typing import NDArray
from scipy.linalg import eigh

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.core.outline import Holes
from femnl.device.mesh import has_symmetry, mesh
from femnl.device.mesh.symmetry import EIGHTH, HALF, QUARTER
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells
from femnl.mechanics.fem.stress import relaxed_stress
from femnl.mechanics.modes import solve_modes
from femnl.mechanics.prestress import solve_prestress
from femnl.pipeline import solve_modes as solve_device

Array = NDArray[np.float64]
Device = Callable[..., Model]

THICKNESS = 0.01
YOUNG = 1e11
STRESS = 1e9
DENSITY = 1000.0
POISSON = 0.3
INNER = 0.25
SQUARE = 'kind = "square"\nside = "2 m"'


def film(poisson: float = POISSON, more: str = "") -> str:
    return (
        f'thickness = "1 cm"\nyoung = "100 GPa"\npoisson = {poisson}\ndensity = "1000 '
        'kg/m^3"\nstress = "1 '
        f'GPa"\n{more}'
    )


def cone(device: Device) -> Model:
    """A ring whose thickness is proportional to the radius.

    1 cm at the clamped edge r = 1, 2.5 mm at the hole r = 1/4.
    """
    model = device('kind = "circle"\ndiameter = "2 m"', film=film(), model="bending = true")
    tapered = replace(model.film, taper=THICKNESS * (1 - INNER), taper_length=1 - INNER)
    return replace(model, holes=Holes(np.zeros((1, 2)), INNER), film=tapered)


def cone_stress(radius: Array) -> tuple[Array, Array]:
    """σᵣ and σ_θ of the cone.

    d(r h σᵣ)/dr = h σ_θ with h ∝ r is solved by u = −(1−ν)(σ₀/E) r + Σ A rᵖ, p² + p + ν − 1 = 0,
    with u(1) = 0 and σᵣ(inner) = 0.
    """
    powers = (-1 + np.array([1, -1]) * np.sqrt(5 - 4 * POISSON)) / 2
    modulus = YOUNG / (1 - POISSON**2)
    matrix = np.stack([np.ones(2), (powers + POISSON) * INNER ** (powers - 1)])
    amplitudes = np.linalg.solve(matrix, [(1 - POISSON) * STRESS / YOUNG, 0])
    shapes = radius[..., None] ** (powers - 1) * amplitudes
    return modulus * (shapes @ (powers + POISSON)), modulus * (shapes @ (1 + POISSON * powers))


def ritz(
    x: Array, weight: Array, held: Legendre, count: int, energy: Callable[..., Array], mass: Array
) -> Array:
    """ω² rising of ∫ energy over ∫ mass w², w the multiples of a polynomial.

    x (q,), weight (q,) of Gauss's rule.
    """
    shapes = [held * Legendre.basis(k, domain=held.domain) for k in range(count)]
    w, first, second = (np.array([s.deriv(d)(x) if d else s(x) for s in shapes]) for d in range(3))
    scale = 1 / np.abs(w).max(axis=1, keepdims=True)
    stiffness = energy(w * scale, first * scale, second * scale)
    return np.asarray(
        eigh(stiffness, (w * scale) @ ((w * scale) * mass * weight).T, eigvals_only=True)
    )


def gauss(low: float, high: float, n: int = 80) -> tuple[Array, Array]:
    x, weight = np.polynomial.legendre.leggauss(n)
    return (low + high) / 2 + x * (high - low) / 2, weight * (high - low) / 2


def test_a_ring_as_thick_as_its_radius_has_the_stress_of_powers_of_the_radius(
    device: Device,
) -> None:
    prestress = solve_prestress(mesh(cone(device), "auto", 2), 6)
    point = np.concatenate(
        [c.jet.point.reshape(-1, 2) for c in cells(Space(prestress.domain.mesh, 6), 8)]
    )
    xx, yy, xy = np.concatenate([s.reshape(-1, 3) for s in relaxed_stress(prestress, 8)]).T
    radial, hoop = cone_stress(np.hypot(*point.T))
    np.testing.assert_allclose((xx + yy) / 2, (radial + hoop) / 2, atol=4e-6 * STRESS)
    np.testing.assert_allclose(
        np.hypot((xx - yy) / 2, xy), np.abs(radial - hoop) / 2, atol=4e-6 * STRESS
    )


def test_a_ring_as_thick_as_its_radius_vibrates_as_its_radial_ritz_series(device: Device) -> None:
    r, weight = gauss(INNER, 1.0)
    h = THICKNESS * r
    radial, hoop = cone_stress(r)
    rigidity = YOUNG * h**3 / 12 / (1 - POISSON**2)

    def lowest(order: int) -> float:
        def energy(w: Array, first: Array, second: Array) -> Array:
            around = first / r - order**2 * w / r**2
            twist = order * (first / r - w / r**2)
            pairs = [
                (h * radial, first, first),
                (h * hoop * order**2 / r**2, w, w),
                (rigidity, second, second),
                (rigidity, around, around),
            ]
            pairs += [(2 * (1 - POISSON) * rigidity, twist, twist)]
            mixed = second @ (around * POISSON * rigidity * r * weight).T
            return sum((a @ (b * c * r * weight).T for c, a, b in pairs), mixed + mixed.T)

        clamped = Legendre.fromroots([1.0, 1.0], domain=[INNER, 1.0])
        return float(ritz(r, weight, clamped, 24, energy, DENSITY * h * r)[0])

    modes = solve_modes(solve_prestress(mesh(cone(device), "auto", 1.5), 6), 4, 6)
    np.testing.assert_allclose(
        (2 * np.pi * modes.frequency) ** 2, [lowest(order) for order in (0, 1, 1, 2)], rtol=1e-6
    )


STRIP = (
    'kind = "polygon"\nfree = [1, 3]\npoints = [["-1 m", "-0.1 m"], ["1 m", "-0.1 m"], ["1 '
    'm", "0.1 m"], ["-1 m", '
    '"0.1 m"]]'
)


def strip(device: Device, gradient: float) -> Modes:
    """A strip with free sides and ν = 0, which is a string and a beam.

    Slack across, between ends that let it be narrower.
    """
    model = device(
        STRIP, film=film(0.0, f'gradient = ["{gradient} m/m", "0 m/m"]'), model="bending = true"
    )
    return solve_modes(solve_prestress(mesh(model, "half", 2), 6, "sliding"), 4, 6)


def test_a_wedge_shaped_strip_is_a_string_of_even_tension_and_uneven_mass_and_rigidity(
    device: Device,
) -> None:
    x, weight = gauss(-1.0, 1.0)
    h = THICKNESS + 0.006 * x
    tension = 2 * STRESS / np.sum(weight / h)  # ∫ (N/h − σ₀)/E dx = 0

    def energy(w: Array, first: Array, second: Array) -> Array:
        return np.asarray(
            first @ (first * tension * weight).T + second @ (second * YOUNG * h**3 / 12 * weight).T
        )

    clamped = Legendre.fromroots([-1.0, -1.0, 1.0, 1.0], domain=[-1.0, 1.0])
    exact = ritz(x, weight, clamped, 40, energy, DENSITY * h)[:2]
    modes = strip(device, 0.006)
    even = modes.frequency[[parity == (1,) for parity in modes.parity]][:2]  # the others twist it
    np.testing.assert_allclose((2 * np.pi * even) ** 2, exact, rtol=1e-7)


def graded(device: Device, x: float, y: float = 0.0) -> Model:
    return device(
        SQUARE, film=film(more=f'gradient = ["{x} m/m", "{y} m/m"]'), model="bending = true"
    )


def test_a_gradient_acts_on_frequencies_in_second_order_and_splits_pairs(device: Device) -> None:
    even, weak, strong = (
        solve_modes(solve_prestress(mesh(graded(device, g), "half", 0.7), 5), 3, 5).frequency
        for g in (0, 5e-4, 1e-3)
    )
    np.testing.assert_allclose((strong - even) / (weak - even), 4, rtol=0.02)
    split = [np.ptp(f[1:]) / f[1] for f in (weak, strong)]
    assert split[1] / split[0] == pytest.approx(4, rel=0.02)
    assert split[1] > 1e-5


def test_a_gradient_keeps_only_the_mirror_along_it(device: Device) -> None:
    kept = {
        (1e-3, 0.0): {HALF},
        (0.0, 1e-3): set(),
        (1e-3, 1e-3): set(),
        (0.0, 0.0): {HALF, QUARTER, EIGHTH},
    }
    for gradient, wedges in kept.items():
        model = graded(device, *gradient)
        assert {w for w in (HALF, QUARTER, EIGHTH) if has_symmetry(model, w)} == wedges
    assert mesh(graded(device, 1e-3), resolution=0.3).copies == 2
    with pytest.raises(ParameterError, match="do not have it"):
        mesh(graded(device, 1e-3), "quarter")


@pytest.mark.parametrize(
    "gradient", [(2e-3, 0.0), pytest.param((0.0, -2e-3), marks=pytest.mark.slow), (1.2e-3, 1.6e-3)]
)
def test_where_a_gradient_points_changes_no_frequency_of_a_drum(
    device: Device, gradient: tuple[float, float]
) -> None:
    circle = device('kind = "circle"\ndiameter = "2 m"', film=film(), model="bending = true")
    model = replace(circle, film=replace(circle.film, gradient=gradient))
    along_x = replace(circle, film=replace(circle.film, gradient=(2e-3, 0.0)))
    # The two meshes err on their own. At a resolution of 0.7 they err by up to 4.3e-5, as degree 5
    # at a resolution of 2 tells. That falls as h⁶ of a plate's degree 4: to 5e-6 at a resolution
    # of 1.
    found, known = (
        solve_device(m, 4, s, cache=False) for m, s in ((model, "full"), (along_x, "half"))
    )
    gap = np.abs(found.frequency - known.frequency)
    assert np.all(gap <= found.frequency_error + known.frequency_error)
    assert np.all(gap < 1e-5 * known.frequency)
