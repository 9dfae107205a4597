"""Effective masses of the ideal square and hexagon."""

from collections.abc import Iterator
from dataclasses import replace

import femnl
from femnl.validation import Case, Reference


def compute() -> Iterator[tuple[float, float]]:
    """Take m_eff over the mass of the film."""
    for name, area in (("square-270um", 1.0), ("hexagon-278um", 3**1.5 / 8)):
        model = replace(femnl.load(name), bending=False)
        modes = femnl.solve_modes(model, count=1, cache=False)
        mass = model.film.density * model.film.thickness * area * model.outline.length**2
        coarse = modes.coarse.effective_mass[0] if modes.coarse else float("inf")
        yield modes.effective_mass[0] / mass, abs(modes.effective_mass[0] - coarse) / mass


CASE = Case(
    claim="The effective mass at the antinode is a quarter of the film's for a square, and "
    "0.263689 of it for "
    "a hexagon",
    source="square: ∫ sin² sin² in closed form; hexagon: method of particular solutions, "
    "recomputed in tests/physics/test_references.py",
    references=(
        Reference("m_eff/m, square", 0.25, relative=1e-6),
        Reference("m_eff/m, hexagon", 0.263689, absolute=1e-6),
    ),
    compute=compute,
)
