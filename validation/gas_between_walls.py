"""Gas around a film: over a baffle, and in the gap between film and wafer."""

from collections.abc import Iterator
from math import pi

import numpy as np

from femnl.device import geometry
from femnl.mechanics.airload import airload
from femnl.mechanics.gas import crossing_time, free_molecular_loss
from femnl.observe.film import SimulatedFilm
from femnl.validation import Case, Reference

CELLS = 96
PISTON = 8 / (3 * pi)
"""Of a rigid disc in a baffle: mass 8ρa³/3 (Rayleigh)."""
LAMB = 0.6689
"""Of a clamped plate w = (1 − r²/a²)², one side."""


def _round(power: int) -> float:
    """Depth of the gas that moves with (1 − r²)^power over the unit disc, in radii."""
    axis = (np.arange(4 * CELLS) + 0.5) / (2 * CELLS) - 1
    x, y = np.meshgrid(axis, axis)
    inside = np.maximum(1 - x**2 - y**2, 0)
    shape = (inside**power * (inside > 0))[None]
    step = 1 / (2 * CELLS)
    return float(airload(shape, (step, step))[0, 0] / (np.sum(shape**2) * step**2))


def compute() -> Iterator[float]:
    """The loads of a disc, and the losses of a film in thin gas, free and over a wafer."""
    yield _round(0)
    yield _round(2)
    model = geometry.load("square-270um")
    gap = SimulatedFilm(model, 1).gap
    film = model.film
    inertia = film.density * film.thickness * 2 * pi * 1.5e6
    free = free_molecular_loss(film, 1.5e6)
    yield free * inertia
    yield crossing_time(model.outline) / (inertia * gap) / free


CASE = Case(
    claim="Gas over a baffle weighs what Rayleigh and Lamb found, thin gas takes what its "
    "molecules carry off, and a gap multiplies that by P/16πd",
    source="Rayleigh, Theory of Sound (1896), section 302: 8ρa³/3 of a disc; Lamb, Proc. R. Soc. "
    "A 98, 205 (1920): 0.6689 ρa/ρh of a clamped plate; 8p√(M/2πRT) of molecules that bounce off; "
    "Bao et al., J. Micromech. Microeng. 12, 341 (2002), for the gap",
    references=(
        Reference("depth/a of gas over a rigid disc", PISTON, relative=3e-3),
        Reference("depth/a of gas over a clamped plate", LAMB, relative=8e-5),
        Reference(
            "loss in N2, s/m", 8 * (0.0280134 / (2 * pi * 8.314462618 * 295)) ** 0.5, relative=1e-9
        ),
        Reference("loss over a wafer/free", 4 * 270e-6 / (16 * pi * 3.22625e-6), relative=1e-9),
    ),
    compute=compute,
)
