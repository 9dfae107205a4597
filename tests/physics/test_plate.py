"""Plates in tension, from stiff to thin as a film.

Against spectral Ritz, beams and the layer at a clamped edge.
"""

import runpy
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import eigh
from skfem import MeshTri1, MeshTri2

from femnl.core import resources
from femnl.core.device import Film, Model
from femnl.core.domain import Domain
from femnl.core.errors import ConvergenceError
from femnl.core.modes import Modes
from femnl.device.mesh import mesh
from femnl.device.mesh.grading import bending_length
from femnl.mechanics.modes import shape_at, solve_modes
from femnl.mechanics.prestress import solve_prestress
from femnl.validation import load

Array = NDArray[np.float64]
Device = Callable[..., Model]


def clamped_line(size: int, parity: int) -> tuple[Array, Array, Array]:
    """∫φφ, ∫φ′φ′ and ∫φ″φ″ on [−½, ½] of polynomials with φ = φ′ = 0 at the ends.

    Parity 0 even, 1 odd.

    Shen's combinations of Legendre polynomials, whose ∫φ″φ″ is diagonal: SIAM J. Sci. Comput. 15,
    1489 (1994).
    """
    order = 2 * np.arange(size) + parity
    series = np.zeros((order[-1] + 5, size))
    for column, k in enumerate(order):
        series[[k, k + 2, k + 4], column] = np.array(
            [1, -2 * (2 * k + 5) / (2 * k + 7), (2 * k + 3) / (2 * k + 7)]
        )
        series[:, column] /= np.sqrt(2 * (2 * k + 3) ** 2 * (2 * k + 5))
    points, weights = legendre.leggauss(len(series) + 2)
    grams = []
    for derivative in range(3):
        terms = legendre.legder(series, derivative)
        values = 2**derivative * legendre.legvander(points, len(terms) - 1) @ terms
        grams.append(values.T @ (values * weights[:, None] / 2))
    return grams[0], grams[1], grams[2]


def spectral_frequency(layer: float, parity: tuple[int, int], size: int) -> float:
    """Return the lowest ω/√(T/ρh) of the clamped square of side 1 in one parity class.

    By Ritz with Legendre polynomials; ℓ = `layer`.

    Inverse iteration; each solve by conjugate gradients, preconditioned with the separable part,
    which is within a factor of two.
    """
    (mx, ax, bx) = clamped_line(size, parity[0])
    (my, ay, by) = clamped_line(size, parity[1])
    bend = layer**2

    def stiffness(w: Array) -> Array:
        return np.asarray(
            bend * (bx @ w @ my + 2 * ax @ w @ ay + mx @ w @ by) + ax @ w @ my + mx @ w @ ay
        )

    (lx, vx), (ly, vy) = (eigh(bend * b + a, m) for m, a, b in ((mx, ax, bx), (my, ay, by)))

    def precondition(r: Array) -> Array:
        return np.asarray(vx @ ((vx.T @ r @ vy) / (lx[:, None] + ly)) @ vy.T)

    def solve(right: Array, w: Array) -> Array:
        r = right - stiffness(w)
        z = p = precondition(r)
        product = np.sum(r * z)
        goal = 1e-28 * np.sum(right * precondition(right))
        while product > goal:
            step = stiffness(p)
            length = product / np.sum(p * step)
            w = w + length * p
            r = r - length * step
            z = precondition(r)
            before = product
            product = np.sum(r * z)
            p = z + product / before * p
        return w

    w = np.outer(vx[:, 0], vy[:, 0])
    last = np.inf
    square = np.sum(w * stiffness(w))
    while abs(square - last) > 1e-13 * square:
        w = solve(mx @ w @ my, w / square)
        w /= np.sqrt(np.sum(w * (mx @ w @ my)))
        last = square
        square = np.sum(w * stiffness(w))
    return float(np.sqrt(square))


def film(layer: float, poisson: float = 0.23) -> Film:
    """A film with √(T/ρh) = 1 m/s and ℓ = `layer` in m."""
    return Film(1e-3, 12e6 * (1 - poisson**2) * layer**2, poisson, 1.0, 1.0)


def solve(
    model: Model, count: int = 4, symmetry: str = "auto", resolution: float = 1.0, degree: int = 4
) -> Modes:
    return solve_modes(solve_prestress(mesh(model, symmetry, resolution), degree), count, degree)


@pytest.fixture(scope="module")
def square(device: Device) -> Model:
    return device('kind = "square"\nside = "1 m"', model="bending = true")


@pytest.mark.parametrize("tension", [10, 100, 1000, 10000, 100000])
def test_published_frequencies_of_the_clamped_plate_in_tension_are_those_of_legendre_polynomials(
    tension: int,
) -> None:
    published = {
        r.quantity: r.value for r in load(resources.cases() / "clamped_plate.py").references
    }
    omega = np.sqrt(tension) * spectral_frequency(tension**-0.5, (0, 0), 40)
    assert published[f"Ω1 at Ta²/D = {tension}"] == pytest.approx(omega, rel=4e-8)


def test_published_frequencies_of_the_clamped_plate_are_those_of_legendre_polynomials() -> None:
    lines = [clamped_line(12, parity) for parity in (0, 1)]
    squares = [
        eigh(
            np.kron(bx, my) + 2 * np.kron(ax, ay) + np.kron(mx, by),
            np.kron(mx, my),
            eigvals_only=True,
        )[:6]
        for mx, ax, bx in lines
        for my, ay, by in lines
    ]
    published = [
        r.value
        for r in load(resources.cases() / "clamped_plate.py").references
        if "without" in r.quantity
    ]
    np.testing.assert_allclose(published, np.sqrt(np.sort(np.concatenate(squares))[:6]), rtol=1e-9)


def test_the_plates_published_hardening_is_that_of_converged_polynomials() -> None:
    case = runpy.run_path(str(resources.cases() / "clamped_plate_nonlinearity.py"))
    hardening = case["hardening"]
    best = hardening(0.3, 14, 24)
    errors = [abs(hardening(0.3, 12, plane) / best - 1) for plane in (6, 8, 12, 16)]
    assert all(later < earlier / 3 for earlier, later in pairwise(errors))
    assert errors[-1] < 2e-9
    assert abs(hardening(0.3, 8, 16) / best - 1) < 1e-8  # the mode needs fewer
    assert best == pytest.approx(0.482795, abs=5e-7)  # all digits of another Legendre-Galerkin code
    x, weights = legendre.leggauss(60)
    square, _ = case["first_mode"](10, x, weights)
    assert 4 * np.sqrt(square) == pytest.approx(35.98519111, rel=1e-9)


@pytest.mark.parametrize(
    ("layer", "size", "resolution", "error"),
    [
        (1.0, 20, 1, 1.2e-5),
        (0.1, 20, 1, 1.2e-5),
        (1e-2, 40, 1, 5e-6),
        (1e-3, 80, 0.6, 3e-6),
        pytest.param(1e-4, 160, 0.3, 1.2e-5, marks=pytest.mark.slow),
    ],
)
def test_frequencies_hold_from_the_stiff_plate_to_the_thinnest_film(
    square: Model, layer: float, size: int, resolution: float, error: float
) -> None:
    modes = solve(replace(square, film=film(layer)), resolution=resolution)
    for index, parity in ((0, (0, 0)), (1, (1, 0)), (3, (1, 1))):
        assert 2 * np.pi * modes.frequency[index] == pytest.approx(
            spectral_frequency(layer, parity, size), rel=error
        )
    assert modes.label == ("(1,1)", "(2,1)", "(1,2)", "(2,2)")


def regular(model: Model, refine: int) -> Domain:
    """The whole square in a regular mesh."""
    linear = MeshTri1.init_sqsymmetric().refined(refine)
    grid = MeshTri2.from_mesh(MeshTri1(np.asarray(linear.p) - 0.5, linear.t))
    return Domain(
        model, grid.with_boundaries({"clamped": lambda x: np.full(x.shape[1:], True)}), 2 * np.pi
    )


@pytest.mark.parametrize(("degree", "refine"), [(2, (2, 3, 4)), (3, (1, 2, 3)), (4, (2, 3, 4))])
def test_the_clamped_plates_eigenvalue_error_falls_as_twice_degree_minus_one(
    square: Model, degree: int, refine: tuple[int, ...]
) -> None:
    model = replace(square, film=film(0.1))
    exact = spectral_frequency(0.1, (0, 0), 20) ** 2
    errors = []
    for level in refine:
        modes = solve_modes(solve_prestress(regular(model, level), degree), 1, degree)
        errors.append((2 * np.pi * modes.frequency[0]) ** 2 / exact - 1)
    rates = [np.log2(coarse / fine) for coarse, fine in pairwise(errors)]
    assert rates[-1] == pytest.approx(2 * degree - 2, abs=0.35)


def test_the_edge_layers_error_falls_as_the_sixth_power_of_its_elements(square: Model) -> None:
    model = replace(square, film=film(1e-2))
    exact = spectral_frequency(1e-2, (0, 0), 40)
    errors = [
        abs(2 * np.pi * solve(model, 1, resolution=r).frequency[0] / exact - 1)
        for r in (0.5, 1.0, 2.0)
    ]
    assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(6, abs=2.5)
    assert errors[2] < 3e-7


def test_the_film_leaves_a_clamped_edge_within_the_bending_length(square: Model) -> None:
    layer = 3e-3
    modes = solve(replace(square, film=film(layer)), 1, resolution=2)
    assert bending_length(modes.domain.model) == pytest.approx(layer)
    distance = layer * np.array([0.2, 0.5, 1.0, 2.0, 4.0])
    shape = shape_at(modes, 0, distance - 0.5, np.zeros(5))
    # Tw″ = Dw⁗ beside a straight clamped edge
    profile = distance - layer * (1 - np.exp(-distance / layer))
    np.testing.assert_allclose(shape / profile, shape[-1] / profile[-1], rtol=1.5e-3)


def strip(device: Device, free: list[int]) -> Model:
    """A strip of 1 m × 0.2 m; its edges are 1 below, 2 right, 3 above, 4 left."""
    points = '["-0.5 m", "-0.1 m"], ["0.5 m", "-0.1 m"], ["0.5 m", "0.1 m"], ["-0.5 m", "0.1 m"]'
    return device(f'kind = "polygon"\npoints = [{points}]\nfree = {free}', model="bending = true")


def test_a_cantilever_without_poissons_effect_rings_as_a_beam(device: Device) -> None:
    # With ν = 0 the beam's deflection w(x) satisfies the plate's equation and its free edges
    # exactly.
    stiff = replace(film(1.0, poisson=0.0), stress=0.0)
    modes = solve(replace(strip(device, [1, 2, 3]), film=stiff), 4, resolution=2)
    omega = (
        2 * np.pi * modes.frequency * np.sqrt(12 * stiff.density / stiff.young) / stiff.thickness
    )
    for beam in (1.8751040687119611**2, 4.694091132974175**2):  # cos β cosh β = −1
        assert np.abs(omega / beam - 1).min() < 1e-6


def test_a_strip_held_at_its_ends_without_poissons_effect_rings_as_a_clamped_beam(
    device: Device,
) -> None:
    stiff = replace(film(1.0, poisson=0.0), stress=0.0)
    modes = solve(replace(strip(device, [1, 3]), film=stiff), 1, resolution=2)
    omega = (
        2 * np.pi * modes.frequency[0] * np.sqrt(12 * stiff.density / stiff.young) / stiff.thickness
    )
    assert omega == pytest.approx(4.730040744862704**2, rel=1e-6)  # cos β cosh β = 1


def test_a_strip_with_free_sides_wrinkles_unless_bending_holds_it(device: Device) -> None:
    # Beside its free sides the film contracts; at the clamped ends, which do not, stretched corners
    # leave parts compressed.
    model = replace(strip(device, [1, 3]), film=film(0.01))
    assert solve(model, 2).frequency[0] > 0
    with pytest.raises(
        ConvergenceError,
        match="under compression; femnl geometry check draws where; check the outline's free edges",
    ):
        solve(replace(model, bending=False), 2)
