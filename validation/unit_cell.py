"""Stress that a lattice of holes leaves in a film, and the wave speed that follows."""

from collections.abc import Iterator
from math import pi, sqrt

import numpy as np
from scipy.sparse import csc_matrix

from femnl.device import geometry
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.fem.stress import relaxed_stress
from femnl.mechanics.modes.operators import Operators
from femnl.mechanics.prestress import solve_prestress
from femnl.validation import Case, Reference

PITCH = 8.56e-6
DEGREE = 4
RESOLUTION = 2.0
# Mean stress of the film, holes counted as empty, and wave speed, both over those without holes, by
# the holes' radius in µm.
TABLE = {
    0.5: (0.97263, 0.99155),
    0.75: (0.93968, 0.98128),
    0.9: (0.91454, 0.97337),
    1.0: (0.89578, 0.96742),
    1.25: (0.84282, 0.95044),
    1.4: (0.80756, 0.93896),
    1.5: (0.78288, 0.93084),
    2.0: (0.65020, 0.88588),
}
GEOMETRY = """
name = "cell"
source = "one cell of a square lattice"
[outline]
kind = "square"
side = "8.56 um"
[holes]
lattice = "list"
centres = [["0 um", "0 um"]]
radius = "{radius} um"
[film]
thickness = "100 nm"
young = "250 GPa"
poisson = 0.23
density = "3000 kg/m^3"
stress = "1 GPa"
[model]
bending = false
"""


def relaxed(radius: float) -> tuple[float, float]:
    """Return ⟨σ⟩/σ₀ over the whole cell, and the tension over σ₀h that resists a deflection.

    The deflection w rises by one pitch a pitch.
    """
    model = geometry.parse(GEOMETRY.format(radius=radius))
    domain = mesh(model, "quarter", RESOLUTION)
    prestress = solve_prestress(domain, DEGREE, "sliding")
    space = Space(domain.mesh, DEGREE)
    order = 2 * DEGREE
    pairs = zip(cells(space, order), relaxed_stress(prestress, order), strict=True)
    quarter = (PITCH / 2) ** 2
    mean = (
        sum(float(np.sum(stress[..., :2].mean(axis=-1) * cell.dx)) for cell, stress in pairs)
        / quarter
        / model.film.stress
    )
    # Across the cell w rises from 0 to half a pitch; between, it is free to follow the uneven
    # stress, but need not.
    stiffness = Operators(prestress, DEGREE).stiffness(())
    w = space.location[:, 0].copy()
    held = np.isclose(w, 0) | np.isclose(w, PITCH / 2)
    free = np.flatnonzero(~held)
    fixed = np.flatnonzero(held)
    w[free] = factorize(csc_matrix(stiffness[free][:, free]))(-stiffness[free][:, fixed] @ w[fixed])
    return mean, float(w @ stiffness @ w) / quarter / model.film.stress / model.film.thickness


def compute() -> Iterator[float]:
    """Solve a quarter of the cell between sliding sides, which are mirror lines of the lattice."""
    for radius in TABLE:
        mean, tension = relaxed(radius)
        yield mean
        yield sqrt(mean / (1 - pi * (radius * 1e-6 / PITCH) ** 2))
        yield tension - mean


CASE = Case(
    claim="Holes lower the mean stress of a film as the unit cell says, and ⟨σ⟩h is exactly the "
    "tension that long "
    "waves feel",
    source="plane stress around the holes of a square lattice (pitch 8.56 µm, ν = 0.23, mean "
    "strain held at zero), "
    "extrapolated in the "
    "number of a hole's segments, ±2e-5; sum rule: div σ = 0 with traction-free holes leaves a "
    "linear w without "
    "corrector",
    references=tuple(
        reference
        for radius, (mean, speed) in TABLE.items()
        for reference in (
            Reference(f"⟨σ⟩/σ₀, r = {radius} µm", mean, absolute=1e-4),
            Reference(f"c/c₀, r = {radius} µm", speed, absolute=1e-4),
            Reference(f"T/σ₀h − ⟨σ⟩/σ₀, r = {radius} µm", 0.0, absolute=1e-6),
        )
    ),
    compute=compute,
)
