"""The Duffing coefficient of the clamped square plate without tension."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.polynomial import legendre, polynomial
from numpy.typing import NDArray
from scipy.linalg import eigh, inv, qr, solve

import femnl
from femnl.device import geometry
from femnl.validation import Case, Reference

Array = NDArray[np.float64]

POISSON = (0.3, 0.23)
GEOMETRY = """
name = "plate"
source = "a square plate of side 1 m"
[outline]
kind = "square"
side = "1 m"
[film]
thickness = "1 mm"
young = "1 GPa"
poisson = {poisson}
density = "1000 kg/m^3"
stress = "1 Pa"
"""


def line(size: int, power: int, parity: int, x: Array) -> Array:
    """(1 − x²)^power P_k(x), k = parity, parity + 2, …, with two derivatives: (3, points, size)."""
    edge = legendre.poly2leg(polynomial.polypow([1.0, 0.0, -1.0], power))
    series = [legendre.legmul(edge, np.eye(2 * k + parity + 1)[-1]) for k in range(size)]
    derived = [[legendre.legder(one, order) for one in series] for order in range(3)]
    return np.array([[legendre.legval(x, one) for one in rows] for rows in derived]).swapaxes(1, 2)


def first_mode(size: int, x: Array, weights: Array) -> tuple[float, Array]:
    """Lowest Ω² (unit D/ρha⁴, a half the side), and ξ, ∂ξ/∂x, ∂ξ/∂y at the nodes, max|ξ| = 1."""
    nodes = line(size, 2, 0, x)
    # Polynomials of high order are nearly dependent; those whose second derivatives are
    # orthonormal are not.
    even = inv(qr(nodes[2] * np.sqrt(weights)[:, None], mode="r")[0][:size])
    nodes = nodes @ even
    mass, slope, bend = (f.T @ (weights[:, None] * f) for f in nodes)
    stiffness = np.kron(bend, mass) + 2 * np.kron(slope, slope) + np.kron(mass, bend)
    square, vector = eigh(stiffness, np.kron(mass, mass), subset_by_index=[0, 0])
    share = vector[:, 0].reshape(size, size)
    middle = line(size, 2, 0, np.zeros(1))[0, 0] @ even
    share /= middle @ share @ middle
    value, change = nodes[0], nodes[1]
    shapes = [value @ share @ value.T, change @ share @ value.T, value @ share @ change.T]
    return float(square[0]), np.array(shapes)


def hardening(poisson: float, size: int = 12, plane: int = 16) -> float:
    """α h² = k₃h²/k of the first mode by Ritz: `size`² polynomials for ξ, `plane`² for u and v.

    k = D ∫ (Δξ)², k₃ = 2h ∫ C E:E with E = ε(u, v) + ½ ∇ξ⊗∇ξ and u, v such that ∫ C E:E is least:
    u = Σ u_kl (1 − x²) P_2k+1(x) (1 − y²) P_2l(y), and v likewise. With C E:E = E_Y/(1 − ν²) ·
    (E_xx² + E_yy² + 2ν E_xx E_yy + (1 − ν) ½γ²), γ = 2 E_xy, all that is left is 24 times the
    ratio of the two integrals.
    """
    x, weights = legendre.leggauss(4 * max(size, plane) + 8)
    square, (shape, along, across) = first_mode(size, x, weights)
    over = np.outer(weights, weights)
    odd = line(plane, 1, 1, x)
    even = line(plane, 1, 0, x)
    shear = (1 - poisson) / 2

    def gram(f: Array, g: Array) -> Array:
        return np.asarray(f.T @ (weights[:, None] * g))

    def against(stress: Array, f: Array, g: Array) -> Array:
        return np.asarray(f.T @ (over * stress) @ g).ravel()

    o, do = odd[0], odd[1]
    e, de = even[0], even[1]
    own = np.kron(gram(do, do), gram(e, e)) + shear * np.kron(gram(o, o), gram(de, de))
    other = np.kron(gram(e, e), gram(do, do)) + shear * np.kron(gram(de, de), gram(o, o))
    mixed = poisson * np.kron(gram(do, e), gram(e, do)) + shear * np.kron(gram(o, de), gram(de, o))
    matrix = np.block([[own, mixed], [mixed.T, other]])
    strain = np.array([along**2 / 2, across**2 / 2, along * across])
    stress_x = strain[0] + poisson * strain[1]
    stress_y = strain[1] + poisson * strain[0]
    stress_xy = shear * strain[2]
    load_u = against(stress_x, do, e) + against(stress_xy, o, de)
    load_v = against(stress_y, e, do) + against(stress_xy, de, o)
    load = np.concatenate([load_u, load_v])
    clamped = np.sum(over * (strain[0] * stress_x + strain[1] * stress_y + strain[2] * stress_xy))
    stretched = clamped - load @ solve(matrix, load, assume_a="pos")
    return float(24 * stretched / (square * np.sum(over * shape**2)))


def compute() -> Iterator[tuple[float, float]]:
    """Solve a plate of either ratio."""
    for poisson in POISSON:
        model = geometry.parse(GEOMETRY.format(poisson=poisson))
        plate = replace(model, film=replace(model.film, stress=0.0))
        modes = femnl.solve_modes(plate, count=1, cache=False)
        found = femnl.solve_nonlinearity(modes, cache=False)
        unit = plate.film.thickness**2
        yield found.alpha[0] * unit, found.alpha_error[0] * unit


CASE = Case(
    claim="A clamped square plate without tension hardens by α h² = 0.482795 at ν = 0.3, whatever "
    "its size",
    source="Ritz with Legendre polynomials over the whole square for the deflection and for the "
    "displacement in the plane, computed in this case and converged to 1e-8 "
    "(tests/physics/test_plate.py); no published number of six digits is known to us",
    references=tuple(
        Reference(f"α₁ h², ν = {poisson:g}", hardening(poisson), relative=2e-6)
        for poisson in POISSON
    ),
    compute=compute,
)
