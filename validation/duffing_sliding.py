"""Cubic stiffness of a rectangle whose edges slide: the closed formula for every mode."""

from collections.abc import Iterator
from dataclasses import replace
from math import pi

import femnl
from femnl.validation import Case, Reference

ORDERS = ((1, 1), (2, 1), (1, 2), (3, 1), (2, 2), (3, 2))
MODEL = replace(femnl.load("rectangle"), bending=False)


def closed_form(m: int, n: int) -> float:
    """k₃ = (m_film/4)(E/ρ)/(1−ν²)·[(p⁴+q⁴)(3−ν²)/16 + νp²q²/4] with p = mπ/Lx, q = nπ/Ly."""
    film = MODEL.film
    (width, height) = MODEL.outline.size or (0.0, 0.0)
    p = m * pi / width
    q = n * pi / height
    nu = film.poisson
    bracket = (p**4 + q**4) * (3 - nu**2) / 16 + nu * p**2 * q**2 / 4
    return float(film.young * film.thickness * width * height / 4 / (1 - nu**2) * bracket)


def compute() -> Iterator[tuple[float, float]]:
    """Solve the shipped rectangle without bending."""
    modes = femnl.solve_modes(MODEL, count=10, resolution=2, cache=False)
    found = femnl.solve_nonlinearity(modes, edge="sliding")
    for m, n in ORDERS:
        index = modes.label.index(f"({m},{n})")
        yield found.k3[index], found.k3[index] * found.alpha_error[index] / found.alpha[index]


CASE = Case(
    claim="With edges that slide, k₃ of a rectangle follows the closed formula for every mode",
    source="closed form: sin·sin shapes stretch a film with shear-free, normal-immovable edges "
    "in three cosines, which "
    "Airy's stress "
    "function solves term by term (von Kármán; Chia, Nonlinear Analysis of Plates (1980), "
    "chapter 3)",
    references=tuple(
        Reference(f"k₃({m},{n})", closed_form(m, n), "N/m³", relative=1e-5) for m, n in ORDERS
    ),
    compute=compute,
)
