"""The annular membrane held at both rims."""

from collections.abc import Iterator
from math import pi

import femnl
from femnl.device import geometry
from femnl.validation import Case, Reference

# Roots k of J_m(k) Y_m(kb) = J_m(kb) Y_m(k) for the inner radius b over the outer one
ROOTS = {
    0.2: (3.81595633, 4.23574804, 5.22176827, 6.39459917),
    0.5: (6.24606184, 6.39315676, 6.81384285, 7.45774014),
}
GEOMETRY = """
name = "annulus"
source = "a film of wave speed 1 m/s between radii b and 1 m"
[outline]
kind = "circle"
diameter = "2 m"
[[holes]]
lattice = "list"
centres = [["0 m", "0 m"]]
radius = "{inner} m"
clamped = true
[film]
thickness = "1 um"
young = "250 GPa"
poisson = 0.3
density = "1 kg/m^3"
stress = "1 Pa"
[model]
bending = false
"""


def compute() -> Iterator[tuple[float, float]]:
    """Solve an annulus on a post, narrow and wide."""
    for inner, roots in ROOTS.items():
        model = geometry.parse(GEOMETRY.format(inner=inner))
        modes = femnl.solve_modes(model, count=2 * len(roots) - 1, cache=False)
        for index in range(0, 2 * len(roots) - 1, 2):
            yield 2 * pi * modes.frequency[index], 2 * pi * modes.frequency_error[index]


CASE = Case(
    claim="A membrane clamped at an outer and an inner circle rings at the roots of Bessel's cross "
    "products",
    source="Abramowitz & Stegun, Handbook of Mathematical Functions (1964), section 9.5.27 and "
    "table 9.7 (b/a = 0.5: (λ − 1)x₁ = 3.1230), with more digits from the same equation",
    references=tuple(
        Reference(f"ωa/c at b/a = {inner}, {m} nodal diameters", value, relative=1e-6)
        for inner, roots in ROOTS.items()
        for m, value in enumerate(roots)
    ),
    compute=compute,
)
