"""k₃ from the static deflection of the full nonlinear film, by Newton's method on its energy."""

from collections.abc import Iterator

import numpy as np

import femnl
from femnl.core.modes import Modes
from femnl.device import geometry
from femnl.mechanics.static_deflection import Film
from femnl.validation import Case, Reference

SQUARE = """
name = "square"
source = "an even square film, without bending"
[outline]
kind = "square"
side = "100 um"
[film]
thickness = "200 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
[model]
bending = false
"""
HEXAGON = """
name = "hexagon"
source = "a stiff hexagon with large holes: bending, uneven thickness and a stress far from even"
[outline]
kind = "regular-polygon"
sides = 6
long_axis = "20 um"
[holes]
lattice = "square"
pitch = "4 um"
count = [3, 3]
radius = "1 um"
[film]
thickness = "500 nm"
young = "250 GPa"
poisson = 0.27
density = "3100 kg/m^3"
stress = "0.2 GPa"
taper = "150 nm"
taper_length = "1 um"
"""
STEPS = np.array([0.01, 0.02, 0.03, 0.04])  # wanted k₃q²/k


def ratio(modes: Modes, index: int) -> float:
    """The cubic coefficient of the static force–deflection curve of one mode over its k₃."""
    film = Film(modes, "clamped")
    parity = modes.parity[index]
    square = (2 * np.pi * modes.frequency[index]) ** 2
    alpha = femnl.solve_nonlinearity(modes, edge="clamped").alpha[index]
    shape = modes.shapes[index]
    size = film.space.size
    load = film.mass @ shape
    state = np.zeros(3 * film.space.size)
    bend = []
    squares = []
    for step in STEPS:
        force = square * np.sqrt(step / alpha) * (1 + step)
        state = film.deflect(force * load, parity, state)
        q = load @ state[2 * size :] / (load @ shape)
        squares.append(q**2)
        bend.append((force / (square * q) - 1) / q**2)
    limit = np.polynomial.Polynomial.fit(squares, bend, len(STEPS) - 1)(0.0)
    return float(limit / alpha)


def compute() -> Iterator[float]:
    """Bend each film step by step, and take the curve's limit at no deflection."""
    modes = femnl.solve_modes(geometry.parse(SQUARE), count=4, resolution=0.7, cache=False)
    for index in (0, 1, 3):
        yield ratio(modes, index)
    modes = femnl.solve_modes(geometry.parse(HEXAGON), count=2, resolution=0.5, cache=False)
    for index in (0, 1):
        yield ratio(modes, index)


CASE = Case(
    claim="k₃ is the cubic coefficient of the static deflection under the mode's own load, in "
    "even and in perforated films",
    source="Newton's method on the von Kármán energy in all unknowns (u, w), four loads, limit "
    "by a polynomial in q²",
    references=(
        *(
            Reference(f"static/modal k₃, square {label}", 1.0, relative=1e-5)
            for label in ("(1,1)", "(2,1)", "(2,2)")
        ),
        *(
            Reference(f"static/modal k₃, perforated hexagon, mode {k}", 1.0, relative=1e-5)
            for k in (1, 2)
        ),
    ),
    compute=compute,
    slow=True,
)
