"""Ratios of the ideal square membrane."""

from collections.abc import Iterator
from dataclasses import replace
from math import sqrt

import femnl
from femnl.validation import Case, Reference

ORDERS = ((2, 1), (1, 2), (2, 2), (3, 1), (1, 3), (3, 2), (2, 3), (4, 1), (1, 4))


def compute() -> Iterator[tuple[float, float]]:
    """Solve the film without bending."""
    modes = femnl.solve_modes(
        replace(femnl.load("square-270um"), bending=False), count=10, cache=False
    )
    for m, n in ORDERS:
        index = modes.label.index(f"({m},{n})")
        yield modes.ratio[index], modes.ratio_error[index]


CASE = Case(
    claim="An ideal square membrane rings at f(m,n)/f(1,1) = √((m² + n²)/2), and its modes are "
    "found by their shapes",
    source="closed form: sin(mπx/L) sin(nπy/L) in c²Δw = ẅ; Rayleigh, The Theory of Sound (1894)",
    references=tuple(
        Reference(f"f({m},{n})/f(1,1)", sqrt((m * m + n * n) / 2), relative=1e-6) for m, n in ORDERS
    ),
    compute=compute,
)
