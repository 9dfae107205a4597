"""Annuli, ellipses and round plates against Bessel and Mathieu functions, and radial Ritz."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import iv, jv, mathieu_modcem1, mathieu_modsem1, yv

from femnl.core.device import Model
from femnl.device import geometry
from femnl.device.mesh import mesh
from femnl.mechanics.modes import solve_modes as modes_of_degree
from femnl.mechanics.nonlinearity import solve_nonlinearity as solve_nonlinearity_of
from femnl.mechanics.prestress import solve_prestress
from femnl.pipeline import solve_modes, solve_nonlinearity
from tests.physics.error_battery import stiff

Array = NDArray[np.float64]

COUNT = 6
POISSON = 0.3
FILM = 'thickness = "1 um"\nyoung = "250 GPa"\npoisson = 0.3\ndensity = "1 kg/m^3"\nstress = "1 Pa"'
CIRCLE = 'kind = "circle"\ndiameter = "2 m"'
MIDDLE = '[holes]\nlattice = "list"\ncentres = [["0 m", "0 m"]]\n'


def film(outline: str, holes: str = "") -> Model:
    return geometry.parse(
        f'name = "film"\n[outline]\n{outline}\n{holes}\n[film]\n{FILM}\n[model]\nbending = false'
    )


def roots(values: Array, grid: Array) -> NDArray[np.int64]:
    return np.flatnonzero(values[1:] * values[:-1] < 0)


def zero(function: Callable[[Array], Array], low: float, high: float) -> float:
    return float(brentq(lambda k: float(function(np.asarray(k))), low, high, xtol=1e-13))


def held_annulus(inner: float) -> Array:
    """Return f [Hz] at 1 m/s of the annulus held at both radii: Bessel's cross products."""
    grid = np.linspace(0.2, 80, 4000)
    found: list[float] = []
    for m in range(8):

        def cross(k: Array, m: int = m) -> Array:
            return np.asarray(jv(m, k) * yv(m, k * inner) - jv(m, k * inner) * yv(m, k))

        at = grid[grid > 0.3 * m]
        for i in roots(cross(at), at):
            found += [zero(cross, at[i], at[i + 1])] * (1 if m == 0 else 2)
    return np.sort(found)[:COUNT] / (2 * np.pi)


def ellipse(ratio: float) -> Array:
    """Return f [Hz] at 1 m/s of an ellipse of semi-axes 1 and `ratio`: Mathieu functions."""
    focus = np.sqrt(1 - ratio**2)
    edge = np.arctanh(ratio)
    grid = np.linspace(0.8, 14, 400)
    found = []
    for function, first in ((mathieu_modcem1, 0), (mathieu_modsem1, 1)):
        for m in range(first, 6):

            def radial(k: Array, m: int = m, function: Any = function) -> Array:
                return np.asarray(function(m, (k * focus / 2) ** 2, edge)[0])

            at = roots(radial(grid), grid)
            found += [zero(radial, grid[i], grid[i + 1]) for i in at]
    return np.sort(found)[:COUNT] / (2 * np.pi)


def free_annulus(inner: float, size: int = 50) -> Array:
    """Return f [Hz] of the annulus whose hole is free, at σ₀/ρ = 1, by radial Legendre–Ritz.

    Lamé's stress σ_r, σ_θ = A ∓ B/r² with u(1) = 0 and σ_r(inner) = 0.
    """
    x, weight = legendre.leggauss(160)
    half = (1 - inner) / 2
    r = inner + half * (x + 1)
    dr = weight * half
    pull = 1 / (1 / (1 - POISSON) + 1 / ((1 + POISSON) * inner**2))
    even = 1 - pull / (1 - POISSON)
    uneven = pull / (1 + POISSON)
    basis = [legendre.Legendre.basis(k) * legendre.Legendre([-1, 1]) for k in range(size)]
    value = np.array([b(x) for b in basis])
    slope = np.array([b.deriv()(x) for b in basis]) / half
    mass = (value * r * dr) @ value.T
    scale = 1 / np.sqrt(np.diag(mass))
    found: list[float] = []
    for m in range(8):
        stiffness = (slope * (even - uneven / r**2) * r * dr) @ slope.T
        stiffness += m**2 * (value * (even + uneven / r**2) / r * dr) @ value.T
        squares = eigh(stiffness * np.outer(scale, scale), mass * np.outer(scale, scale))[0][:3]
        found += list(np.repeat(np.sqrt(squares), 1 if m == 0 else 2))
    return np.sort(found)[:COUNT] / (2 * np.pi)


def hardening(poisson: float) -> float:
    """α h² of the clamped round plate without tension, by Ritz for the radial displacement."""
    k = brentq(lambda k: jv(0, k) * iv(1, k) + iv(0, k) * jv(1, k), 3, 3.5, xtol=1e-15)
    x, weight = legendre.leggauss(100)
    r = (x + 1) / 2
    dr = weight / 2
    share = jv(0, k) / iv(0, k)
    shape = (jv(0, k * r) - share * iv(0, k * r)) / (1 - share)
    slope = k * (-jv(1, k * r) - share * iv(1, k * r)) / (1 - share)
    value = np.array([r ** (1 + n) - r ** (2 + n) for n in range(16)])
    strain = np.array([(1 + n) * r**n - (2 + n) * r ** (1 + n) for n in range(16)])
    mixed = poisson * (strain * dr) @ value.T
    matrix = (strain * r * dr) @ strain.T + (value / r * dr) @ value.T + mixed + mixed.T
    load = -((strain * r * dr) @ slope**2 + poisson * (value * dr) @ slope**2) / 2
    moved = np.linalg.lstsq(matrix, load, rcond=None)[0]
    radial = moved @ strain + slope**2 / 2
    hoop = moved @ value / r
    energy = np.sum((radial**2 + hoop**2 + 2 * poisson * radial * hoop) * r * dr) / 2
    return float(4 * energy / (k**4 / 12 * np.sum(shape**2 * r * dr)))


@pytest.mark.parametrize("inner", [0.02, 0.1, 0.35, 0.6, 0.8])
def test_an_annulus_on_a_post_rings_within_its_error_bars(inner: float) -> None:
    model = film(CIRCLE, f'{MIDDLE}radius = "{inner} m"\nclamped = true')
    modes = solve_modes(model, COUNT, cache=False)
    error = np.abs(modes.frequency - held_annulus(inner))
    assert np.all(error <= modes.frequency_error)
    assert np.all(error < 2e-6 * modes.frequency)


@pytest.mark.parametrize("resolution", [0.6, 1.0])
@pytest.mark.parametrize("inner", [0.05, 0.25, 0.4, 0.6, 0.8])
def test_an_annulus_with_a_free_hole_rings_within_its_error_bars(
    inner: float, resolution: float
) -> None:
    modes = solve_modes(
        film(CIRCLE, f'{MIDDLE}radius = "{inner} m"'), COUNT, resolution=resolution, cache=False
    )
    exact = free_annulus(inner)
    assert np.all(np.abs(modes.frequency - exact) <= modes.frequency_error)
    ratio = exact / exact[0]
    assert np.all(np.abs(modes.ratio - ratio)[1:] <= modes.ratio_error[1:])


@pytest.mark.parametrize("inner", [0.003, 0.011, 0.645, 0.865])
def test_small_holes_and_narrow_annuli_ring_within_their_bars_in_coarse_meshes(
    inner: float,
) -> None:
    for resolution in (0.6, 0.8):
        model = film(CIRCLE, f'{MIDDLE}radius = "{inner} m"')
        modes = solve_modes(model, 4, resolution=resolution, cache=False)
        exact = free_annulus(inner)[:4]
        assert np.all(np.abs(modes.frequency - exact) <= modes.frequency_error)
        error = np.abs(modes.ratio - exact / exact[0])
        assert np.all(error[1:] <= modes.ratio_error[1:])
        assert np.all(modes.frequency_error < 1e-5 * modes.frequency)


def test_no_element_beside_a_small_hole_spans_many_of_its_radii() -> None:
    # Seen from the middle, an element that spans distances a to b resolves fields that fade as a
    # power of the distance as b/a allows.
    model = film(CIRCLE, f'{MIDDLE}radius = "0.005 m"')
    for resolution in (0.6, 1.0):
        triangles = mesh(model, resolution=resolution).mesh
        distance = np.hypot(*triangles.p[:, triangles.t])
        assert np.max(distance.max(axis=0) / distance.min(axis=0)) < 5


@pytest.mark.parametrize("degree", [4, 6])
@pytest.mark.parametrize("ratio", [0.95, 0.8, 0.5])
def test_an_ellipse_rings_within_its_error_bars(ratio: float, degree: int) -> None:
    model = film(f'kind = "ellipse"\nwidth = "2 m"\nheight = "{2 * ratio} m"')
    modes = solve_modes(model, COUNT, cache=False, degree=degree)
    error = np.abs(modes.frequency - ellipse(ratio))
    assert np.all(error <= modes.frequency_error)
    assert np.all(error < 1e-7 * modes.frequency)


@pytest.mark.slow
@pytest.mark.parametrize("aspect", [2, 5, 10])
def test_bars_hold_around_slender_openings(aspect: int) -> None:
    hole = f'semi_axes = ["0.15 m", "{0.15 / aspect:.6g} m"]\nangle = "20 deg"'
    centre = MIDDLE.replace('["0 m", "0 m"]', '["0.03 m", "0.05 m"]')
    model = stiff(film('kind = "square"\nside = "1 m"', f"{centre}{hole}"), 0.01)
    modes = solve_modes(model, 2, cache=False)
    duffing = solve_nonlinearity(modes, cache=False)
    # By elements of a higher degree, on a finer mesh of its own
    finer = modes_of_degree(solve_prestress(mesh(model, resolution=1.5, degree=5), 5), 2, 5)
    known = solve_nonlinearity_of(finer, "clamped")
    pairs = [
        (modes.frequency, modes.frequency_error, finer.frequency),
        (modes.effective_mass, modes.effective_mass_error, finer.effective_mass),
        (duffing.alpha, duffing.alpha_error, known.alpha),
    ]
    for value, bar, reference in pairs:
        assert np.all(np.abs(value - reference) <= bar)
    assert np.all(modes.frequency_error < 2e-4 * modes.frequency)
    assert np.all(duffing.alpha_error < 2e-3 * duffing.alpha)


@pytest.mark.parametrize("poisson", [0.23, 0.3])
def test_a_round_plate_without_tension_hardens_as_ritz_says(poisson: float) -> None:
    text = f'name = "plate"\n[outline]\n{CIRCLE}\n[film]\n{FILM}'
    model = geometry.parse(text.replace("poisson = 0.3", f"poisson = {poisson}"))
    modes = solve_modes(replace(model, film=replace(model.film, stress=0.0)), 1, cache=False)
    found = solve_nonlinearity(modes, cache=False)
    unit = model.film.thickness**2
    assert abs(found.alpha[0] * unit - hardening(poisson)) <= found.alpha_error[0] * unit
    assert found.alpha[0] * unit == pytest.approx(hardening(poisson), rel=2e-6)
