"""Frequency and coefficients of a bowed square against sine series that know no elements."""

from collections.abc import Iterator

import femnl
from femnl.device import geometry
from femnl.validation import Case, Reference

SQUARE = """
name = "square"
source = "an even square film, without bending, on sliding edges"
[outline]
kind = "square"
side = "100 um"
[film]
thickness = "200 nm"
young = "250 GPa"
poisson = 0.3
density = "3000 kg/m^3"
stress = "1 GPa"
[model]
bending = false
edge = "sliding"
"""


def compute() -> Iterator[tuple[float, float] | float]:
    """Bow the square by 1 µm in the shape of its fundamental mode, and by 1 Pa."""
    modes = femnl.solve_modes(geometry.parse(SQUARE), count=1, cache=False)
    for stressed in (True, False):
        bowed = femnl.solve_static_deflection(modes, depth=1e-6, stressed=stressed)
        yield bowed.frequency[0], bowed.frequency_error[0]
        yield bowed.k2[0], bowed.k2_error[0]
        yield bowed.k3[0], bowed.k3_error[0]
        yield bowed.alpha[0], bowed.alpha_error[0]
    yield femnl.solve_static_deflection(modes, pressure=1.0).depth


CASE = Case(
    claim="A bow makes a mode stiffer, gives it a quadratic coefficient and lowers α",
    source="Galerkin's method with 25 odd sines, whose in-plane relaxation on sliding edges is "
    "exact wave by wave, "
    "and the "
    "quartic energy "
    "that they leave (Sines in tests/physics/test_bow.py); depth: Timoshenko & Goodier, Theory "
    "of Elasticity (1970), "
    "section 109",
    references=(
        Reference("f, bow 1 µm that stretches the film", 4431311.60853, "Hz", relative=1e-7),
        Reference("k₂, the same", 181291689.90, "N/m²", relative=1e-5),
        Reference("k₃, the same", 6.1031921051e13, "N/m³", relative=1e-5),
        Reference("α, the same", 2.46375023621e10, "m⁻²", relative=1e-5),
        Reference(
            "f, bow 1 µm of a film with the stress given", 4318264.10907, "Hz", relative=1e-7
        ),
        Reference("k₂, the same", 179767002.579, "N/m²", relative=1e-5),
        Reference("k₃, the same", 6.0340873640e13, "N/m³", relative=1e-5),
        Reference("α, the same", 2.41953246852e10, "m⁻²", relative=1e-5),
        Reference("depth under 1 Pa", 0.0736713 * 1e-4**2 / 200, "m", relative=2e-6),
    ),
    compute=compute,
)
