"""Reference numbers of ideal shapes, computed by methods that share no element with femnl.

No book gives these numbers to enough digits.
"""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import eigsh, spsolve
from scipy.special import jn_zeros, jv, jvp
from skfem import Basis, BilinearForm, ElementTriP4, ElementVector, Functional, LinearForm, MeshTri1
from skfem.assembly.form.form import FormExtraParams
from skfem.helpers import ddot, dot, grad, sym_grad

from femnl.core import resources
from femnl.core.device import Model
from femnl.device.mesh import mesh
from femnl.pipeline import solve_modes_to, solve_nonlinearity
from femnl.validation import load
from tests.physics.error_battery import outline

Array = NDArray[np.float64]

# Of the quarter hexagon 0 ≤ x, 0 ≤ y ≤ HEIGHT, with its corners at (1, 0) and (½, HEIGHT)
HEIGHT = 3**0.5 / 2
POISSON = (0.23, 0.25, 0.27, 0.30)


def reference(case: str, quantity: str) -> float:
    """A reference number of a validation case."""
    return next(
        r.value for r in load(resources.cases() / f"{case}.py").references if r.quantity == quantity
    )


class Hexagon:
    """Method of particular solutions on a quarter of the regular hexagon of side 1.

    Bessel functions about its two corners.

    Each function solves −Δw = λw and vanishes on the edges at its own corner; those about (1, 0)
    also are even or odd in y.
    Source: Betcke & Trefethen, SIAM Rev. 47, 469 (2005).
    """

    def __init__(self, parity: tuple[int, int], n: int = 26, n_points: int = 90) -> None:
        self.even_x = parity[1] > 0
        self.even_y = parity[0] > 0
        self.n = n
        along = np.sin(np.pi * (np.arange(n_points) + 0.5) / n_points / 2) ** 2
        self.top = np.stack([along / 2, 0 * along + HEIGHT], 1)
        self.left = np.stack([0 * along, along * HEIGHT], 1)
        self.bottom = np.stack([along, 0 * along], 1)
        u = np.random.default_rng(1).uniform(size=(300, 2))
        self.inside = np.stack([u[:, 0] * (1 - u[:, 1] / 2), u[:, 1] * HEIGHT], 1)

    def values(self, eigenvalue: float, points: Array, axis: int | None = None) -> Array:
        """All functions at points (m, 2), or their derivatives along x (0) or y (1): (m, 2n)."""
        columns = []
        k = eigenvalue**0.5
        first = (1.5 if self.even_y else 3.0) + 3 * np.arange(self.n)
        for corner, start, order in (
            ((1, 0), 2 * np.pi / 3, first),
            ((0.5, HEIGHT), np.pi, 1.5 * (1 + np.arange(self.n))),
        ):
            away = points - corner
            r = np.hypot(*away.T)[:, None]
            phi = np.arctan2(away[:, 1], away[:, 0])[:, None] % (2 * np.pi)
            bessel = jv(order, k * r)
            angle = order * (phi - start)
            if axis is None:
                columns.append(bessel * np.sin(angle))
            else:
                outwards, around = ((np.cos(phi), -np.sin(phi)), (np.sin(phi), np.cos(phi)))[axis]
                columns.append(
                    k * jvp(order, k * r) * np.sin(angle) * outwards
                    + order * bessel / r * np.cos(angle) * around
                )
        return np.hstack(columns)

    def fit(self, eigenvalue: float) -> tuple[float, Array]:
        """Return how far the best combination of unit size misses the other edges' conditions.

        And the coefficients of that combination.
        """
        top = self.values(eigenvalue, self.top)
        left = (
            self.values(eigenvalue, self.left, 0)
            if self.even_x
            else self.values(eigenvalue, self.left)
        )
        bottom = (
            self.values(eigenvalue, self.bottom, 1)
            if self.even_y
            else self.values(eigenvalue, self.bottom)
        )
        top[:, self.n :] = bottom[:, : self.n] = 0  # by construction
        edges = np.vstack([top, left, bottom])
        both = np.vstack([edges, self.values(eigenvalue, self.inside)])
        scale = np.linalg.norm(both, axis=0)
        q, r = np.linalg.qr(both / scale)
        _, misses, right = np.linalg.svd(q[: len(edges)])
        return float(misses[-1]), np.linalg.solve(r, right[-1]) / scale

    def eigenvalue(self, near: float) -> float:
        """The minimum of the miss near a guess, by parabolas through its square."""
        centre = near
        width = 2e-4 * near
        for _ in range(4):
            where = centre + width * np.linspace(-1, 1, 5)
            parabola = np.polyfit(where - centre, [self.fit(v)[0] ** 2 for v in where], 2)
            centre = centre - parabola[1] / 2 / parabola[0]
            width = width / 20
        return float(centre)


@pytest.mark.parametrize(
    ("number", "parity"),
    [
        (1, (1, 1)),
        (2, (1, -1)),
        (3, (-1, 1)),
        (4, (1, 1)),
        (5, (-1, -1)),
        (6, (1, 1)),
        (7, (1, -1)),
        (9, (-1, 1)),
        (10, (1, -1)),
    ],
)
def test_eigenvalues_of_the_hexagon_are_those_of_particular_solutions(
    number: int, parity: tuple[int, int]
) -> None:
    expected = reference("ideal_hexagon", f"λ{number}")
    assert Hexagon(parity).eigenvalue(expected * (1 + 3e-5)) == pytest.approx(expected, rel=2e-10)


def test_the_exact_eigenvalue_of_the_hexagon_is_one_of_particular_solutions() -> None:
    expected = reference("ideal_hexagon", "λ8 = 16π²/3")
    assert Hexagon((-1, 1)).eigenvalue(expected * (1 + 3e-5)) == pytest.approx(expected, rel=1e-10)


def test_ratios_of_the_hexagon_are_roots_of_its_eigenvalues() -> None:
    first = reference("ideal_hexagon", "λ1")
    for number in (2, 4, 6, 7, 9):
        root = (reference("ideal_hexagon", f"λ{number}") / first) ** 0.5
        assert reference("ideal_hexagon", f"f{number}/f1") == pytest.approx(root, abs=6e-8)


def test_the_effective_mass_of_the_hexagon_is_that_of_particular_solutions() -> None:
    hexagon = Hexagon((1, 1))
    eigenvalue = reference("ideal_hexagon", "λ1")
    coefficients = hexagon.fit(eigenvalue)[1]
    nodes, weights = legendre.leggauss(60)
    nodes = (nodes + 1) / 2
    weights = weights / 2
    u, v = (g.ravel() for g in np.meshgrid(nodes, nodes, indexing="ij"))
    shape = hexagon.values(eigenvalue, np.stack([u * (1 - v / 2), v * HEIGHT], 1)) @ coefficients
    area = np.outer(weights, weights).ravel() * (1 - v / 2) * HEIGHT
    centre = (hexagon.values(eigenvalue, np.zeros((1, 2))) @ coefficients)[0]
    mean = area @ shape**2 / area.sum() / centre**2
    assert reference("effective_mass", "m_eff/m, hexagon") == pytest.approx(mean, abs=6e-7)


def in_plane_modes(n: int) -> tuple[Array, Array, Array, Array]:
    """Return Legendre polynomials that vanish at ±½ and their derivatives, (points, n).

    And Gauss points and weights on [−½, ½].
    """
    nodes, weights = legendre.leggauss(2 * n + 20)
    series = np.eye(n + 2)[:, :n] - np.eye(n + 2, n, -2)
    values = legendre.legvander(nodes, n + 1) @ series
    slopes = legendre.legvander(nodes, n) @ legendre.legder(series) * 2
    return values, slopes, nodes / 2, weights / 2


def square_constant(m: int, n: int, poisson: float, size: int = 28) -> float:
    """C of k₃ = C·Eh/((1−ν²)L²) for sin·sin on the clamped square: minimum of 2∫ C E .

    E over u, by Legendre polynomials.
    """
    f, df, x, weight = in_plane_modes(size)
    # u_x is odd in x and even in y, u_y the other way round
    even = slice(0, None, 2)
    odd = slice(1, None, 2)
    wx = np.outer(m * np.pi * np.cos(m * np.pi * (x + 0.5)), np.sin(n * np.pi * (x + 0.5)))
    wy = np.outer(np.sin(m * np.pi * (x + 0.5)), n * np.pi * np.cos(n * np.pi * (x + 0.5)))

    def product(a: Array, b: Array) -> Array:
        return np.asarray(np.einsum("ia,jb->ijab", a, b).reshape(len(x) ** 2, -1))

    zero = np.zeros((len(x) ** 2, (size // 2) ** 2))
    xx = product(df[:, odd], f[:, even])
    yy = product(f[:, even], df[:, odd])
    xy = np.hstack([product(f[:, odd], df[:, even]), product(df[:, even], f[:, odd])])
    strain = np.stack([np.hstack([xx, zero]), np.hstack([zero, yy]), xy])
    stretch = np.stack([wx**2 / 2, wy**2 / 2, wx * wy]).reshape(3, -1)
    moduli = np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    area = np.outer(weight, weight).ravel()
    stress = np.einsum("cd,dqj->cqj", moduli, strain * area[:, None]).reshape(-1, strain.shape[-1])
    matrix = strain.reshape(stress.shape).T @ stress
    load = stretch.ravel() @ stress
    alone = np.einsum("cq,cd,dq,q->", stretch, moduli, stretch, area)
    return float(2 * (alone - load @ np.linalg.solve(matrix, load)))


@pytest.mark.parametrize("poisson", POISSON)
def test_the_cubic_stiffness_of_the_square_is_that_of_legendre_polynomials(poisson: float) -> None:
    assert reference("duffing_table", f"C, square, ν = {poisson}") == pytest.approx(
        square_constant(1, 1, poisson), rel=3e-9
    )


@pytest.mark.parametrize("order", [(2, 1), (2, 2), (3, 1), (3, 3)])
def test_the_cubic_stiffness_of_higher_modes_is_that_of_legendre_polynomials(
    order: tuple[int, int],
) -> None:
    m, n = order
    assert reference("duffing_table", f"C, square ({m},{n}), ν = 0.27") == pytest.approx(
        square_constant(m, n, 0.27), rel=2e-6
    )


def test_a_tolerance_of_all_numbers_is_met_by_the_cubic_stiffness_too() -> None:
    model = outline("square")
    tolerance = 3e-6
    exact = (
        square_constant(1, 1, model.film.poisson)
        * model.film.young
        * model.film.thickness
        / (1 - model.film.poisson**2)
    )
    modes = solve_modes_to(model, tolerance, 2, cache=False, of="all")
    found = solve_nonlinearity(modes, cache=False)
    assert found.k3[0] == pytest.approx(exact, rel=tolerance)
    assert found.alpha[0] == pytest.approx(exact / modes.stiffness[0], rel=tolerance)
    assert np.all(modes.effective_mass_error <= tolerance * modes.effective_mass)
    loose = solve_modes_to(model, tolerance, 2, cache=False)
    assert solve_nonlinearity(loose, cache=False).k3_error[0] > tolerance * exact, (
        "the tolerance of frequencies alone would do"
    )


@pytest.mark.parametrize("poisson", POISSON)
def test_the_cubic_stiffness_of_the_circle_is_that_of_its_radial_problem(poisson: float) -> None:
    # Minimum over u(r) of 4π∫ (e_r² + e_θ² + 2ν e_r e_θ) r dr with e_r = u′ + ½ξ′², e_θ = u/r and ξ
    # = J₀(jr).
    nodes, weights = legendre.leggauss(60)
    r = (nodes + 1) / 2
    weight = weights / 2
    powers = 2 * np.arange(16) + 1
    u = r[:, None] ** powers - r[:, None] ** (powers + 2)
    du = powers * r[:, None] ** (powers - 1) - (powers + 2) * r[:, None] ** (powers + 1)
    zero = jn_zeros(0, 1)[0]
    stretch = (zero * jv(1, zero * r)) ** 2 / 2
    radial = np.column_stack([stretch, du])
    hoop = np.column_stack([0 * r, u / r[:, None]])
    area = 4 * np.pi * (weight * r)[:, None]
    form = (area * radial).T @ (radial + poisson * hoop) + (area * hoop).T @ (
        hoop + poisson * radial
    )
    constant = form[0, 0] - form[0, 1:] @ np.linalg.lstsq(form[1:, 1:], form[1:, 0], rcond=None)[0]
    assert reference("duffing_table", f"C, circle, ν = {poisson}") == pytest.approx(
        constant, abs=6e-7
    )
    davidovikj = np.pi / (1.27 - 0.97 * poisson - 0.27 * poisson**2) * (1 - poisson**2)
    assert constant == pytest.approx(davidovikj, rel=1.3e-3)


@pytest.fixture(scope="module")
def scikit_hexagon(device: Callable[..., Model]) -> tuple[Basis, Array]:
    """Return the first mode of the hexagon of side 1, max ξ = 1, by scikit-fem's own elements."""
    graded = mesh(device('kind = "regular-polygon"\nsides = 6\nlong_axis = "2 m"'), "full", 1).mesh
    basis = Basis(MeshTri1(np.asarray(graded.p), graded.t), ElementTriP4(), intorder=12)
    inside = basis.complement_dofs(basis.get_dofs())
    forms = (
        BilinearForm(lambda u, v, _: dot(grad(u), grad(v))),
        BilinearForm(lambda u, v, _: u * v),
    )
    stiffness, mass = (csc_matrix(form.assemble(basis))[inside][:, inside] for form in forms)
    values, vectors = eigsh(stiffness, k=1, M=mass, sigma=0.0)
    assert values[0] == pytest.approx(reference("ideal_hexagon", "λ1"), rel=1e-8)
    shape = np.zeros(basis.N)
    shape[inside] = vectors[:, 0]
    return basis, shape / (basis.probes(np.zeros((2, 1))) @ shape)


@pytest.mark.parametrize("poisson", POISSON)
def test_the_cubic_stiffness_of_the_hexagon_is_that_of_scikit_fems_own_forms(
    scikit_hexagon: tuple[Basis, Array], poisson: float
) -> None:
    basis, shape = scikit_hexagon
    plane = basis.with_element(ElementVector(ElementTriP4()))

    def stress(strain: Array) -> Array:
        return np.asarray(
            (1 - poisson) * strain + poisson * np.einsum("ij,kk...->ij...", np.eye(2), strain)
        )

    def stretch(w: FormExtraParams) -> Array:
        return np.asarray(np.einsum("i...,j...->ij...", grad(w["w"]), grad(w["w"])) / 2)

    stiffness = BilinearForm(lambda u, v, _: ddot(stress(sym_grad(u)), sym_grad(v))).assemble(plane)
    load = LinearForm(lambda v, w: -ddot(stress(stretch(w)), sym_grad(v))).assemble(
        plane, w=basis.interpolate(shape)
    )
    alone = Functional(lambda w: ddot(stress(stretch(w)), stretch(w))).assemble(
        basis, w=basis.interpolate(shape)
    )
    inside = plane.complement_dofs(plane.get_dofs())
    u = spsolve(csc_matrix(stiffness)[inside][:, inside], load[inside])
    assert reference("duffing_table", f"C, hexagon, ν = {poisson}") == pytest.approx(
        2 * (alone - load[inside] @ u), rel=3e-7
    )
