"""The clamped square plate in tension, from a stiff plate to a film."""

from collections.abc import Iterator
from dataclasses import replace
from math import pi, sqrt

import femnl
from femnl.device import geometry
from femnl.validation import Case, Reference

# Ω = ω a² √(ρh/D) of the first mode, by the tension T a²/D.
TENSION = {10.0: 39.166735, 1e2: 60.171859, 1e3: 151.454604, 1e4: 453.803717, 1e5: 1414.0449}
# The lowest modes without tension.
PLATE = (35.98519111, 73.39384553, 73.39384553, 108.21650174, 131.5807726, 132.2047902)
GEOMETRY = """
name = "plate"
source = "a square plate of side 1 m"
[outline]
kind = "square"
side = "1 m"
[film]
thickness = "1 mm"
young = "12 GPa"
poisson = 0.23
density = "1000 kg/m^3"
stress = "1 Pa"
"""


def compute() -> Iterator[tuple[float, float]]:
    """Solve one plate under rising tension."""
    model = geometry.parse(GEOMETRY)
    film = model.film
    rigidity = film.young * film.thickness**3 / 12 / (1 - film.poisson**2)
    unit = 2 * pi * sqrt(film.density * film.thickness / rigidity)
    for tension in TENSION:
        stretched = replace(model, film=replace(film, stress=tension * rigidity / film.thickness))
        modes = femnl.solve_modes(stretched, count=1, resolution=2, cache=False)
        yield unit * modes.frequency[0], unit * modes.frequency_error[0]
    modes = femnl.solve_modes(
        replace(model, film=replace(film, stress=0.0)), count=6, resolution=3, cache=False
    )
    yield from zip(unit * modes.frequency, unit * modes.frequency_error, strict=True)


CASE = Case(
    claim="One element is right from the clamped plate without tension to the film whose edge "
    "layer is 1/316 of "
    "its side",
    source="Ritz with Legendre polynomials, recomputed in tests/physics/test_plate.py, and "
    "Argyris elements "
    "on graded "
    "meshes, to "
    "the digits given; the first three digits without tension: Leissa, Vibration of Plates, "
    "NASA SP-160 (1969), "
    "section 4.1",
    references=(
        *(
            Reference(f"Ω1 at Ta²/D = {tension:g}", value, relative=1e-6)
            for tension, value in TENSION.items()
        ),
        *(
            Reference(f"Ω{k + 1} without tension", value, relative=1e-6)
            for k, value in enumerate(PLATE)
        ),
    ),
    compute=compute,
    slow=True,
)
