"""Eigenvalues and ratios of the ideal regular hexagon."""

from collections.abc import Iterator
from dataclasses import replace
from math import pi

import femnl
from femnl.validation import Case, Reference

# λ of −Δw = λw on the hexagon of side 1.
EIGENVALUES = (
    7.155339133926055,
    18.131677865531,
    18.131677865531,
    32.451857514400,
    32.451857514400,
    37.491352876798,
    47.629365773857,
)
EXACT = 16 * pi**2 / 3
HIGHEST = 60.105112094
RATIOS = (
    1.5918564,
    1.5918564,
    2.1296325,
    2.1296325,
    2.2890245,
    2.5800153,
    2.7122775,
    2.8982817,
    2.8982817,
)


def compute() -> Iterator[tuple[float, float]]:
    """Solve the film without bending, and scale to side 1 and unit wave speed."""
    model = replace(femnl.load("hexagon-278um"), bending=False)
    modes = femnl.solve_modes(model, count=10, degree=6, cache=False)
    side = model.outline.length / 2
    speed = (model.film.stress / model.film.density) ** 0.5
    unit = 2 * pi * side / speed
    for f, error in zip(modes.frequency, modes.frequency_error, strict=True):
        yield (unit * f) ** 2, 2 * unit**2 * f * error
    yield from zip(modes.ratio[1:], modes.ratio_error[1:], strict=True)


CASE = Case(
    claim="The ideal hexagon has the eigenvalues of the literature to ten digits, 16π²/3 among "
    "them, in spite of its "
    "120° corners",
    source="16π²/3: closed form, the mode whose nodal lines cut the hexagon into equilateral "
    "triangles of side 1 "
    "(McCartin, "
    "SIAM Rev. "
    "45, 267 (2003)); λ1: Jones, Adv. Comput. Math. 43, 1325 (2017); the others: method of "
    "particular solutions, Bessel "
    "functions about "
    "the corners (Betcke & Trefethen, SIAM Rev. 47, 469 (2005)), recomputed in "
    "tests/physics/test_references.py",
    references=(
        *(Reference(f"λ{k + 1}", value, relative=5e-11) for k, value in enumerate(EIGENVALUES)),
        Reference("λ8 = 16π²/3", EXACT, relative=5e-11),
        *(Reference(f"λ{k}", HIGHEST, relative=5e-11) for k in (9, 10)),
        *(Reference(f"f{k + 2}/f1", ratio, absolute=6e-8) for k, ratio in enumerate(RATIOS)),
    ),
    compute=compute,
)
