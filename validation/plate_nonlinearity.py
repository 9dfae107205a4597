"""The Duffing coefficient of clamped plates without tension."""

from collections.abc import Iterator
from dataclasses import replace

import femnl
from femnl.device import geometry
from femnl.validation import Case, Reference

# α h² of the first mode by Poisson's ratio
CIRCLE = {0.3: 0.500842985, 0.23: 0.490234110}
GEOMETRY = """
name = "plate"
source = "a round plate of diameter 2 m"
[outline]
kind = "circle"
diameter = "2 m"
[film]
thickness = "1 mm"
young = "1 GPa"
poisson = {poisson}
density = "1000 kg/m^3"
stress = "1 Pa"
"""


def compute() -> Iterator[tuple[float, float]]:
    """Solve a plate of either ratio."""
    for poisson in CIRCLE:
        model = geometry.parse(GEOMETRY.format(poisson=poisson))
        plate = replace(model, film=replace(model.film, stress=0.0))
        modes = femnl.solve_modes(plate, count=1, cache=False)
        found = femnl.solve_nonlinearity(modes, cache=False)
        unit = plate.film.thickness**2
        yield found.alpha[0] * unit, found.alpha_error[0] * unit


CASE = Case(
    claim="A clamped round plate without tension hardens by α h² of one half, whatever its size",
    source="deflection J₀(kr) − I₀(kr)J₀(ka)/I₀(ka) with (ka)² = 10.2158 (Leissa, Vibration of "
    "Plates, NASA SP-160 (1969), table 2.1), and the radial displacement that it causes by Ritz "
    "with polynomials, recomputed in tests/physics/test_inner_edges.py",
    references=tuple(
        Reference(f"α₁ h², ν = {poisson:g}", value, relative=5e-6)
        for poisson, value in CIRCLE.items()
    ),
    compute=compute,
)
