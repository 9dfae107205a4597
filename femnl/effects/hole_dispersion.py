"""Waves slowed by a lattice of holes more, or less, than the geometry says."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def slow(system: ModalSystem, values: Values) -> ModalSystem:
    """Lower each f by the part βa²k²."""
    own = np.sqrt(np.diag(system.stiffness))
    factor = (1 - values["beta_area"] * system.wavenumber**2) ** 2 - 1
    return replace(system, stiffness=system.stiffness + np.diag(factor * own**2))


EFFECT = Effect(
    name="hole_dispersion",
    accuracy=0.05,
    accuracy_reason="the next order in (ka)²",
    imitates={"spectrum": {"bending_stiffness": 0.98, UNKNOWN: 0.38}},
    equation="f → f (1 − βa² k²), a the pitch of the holes, β beyond that of the simulated holes",
    parameters=(
        ParameterSpec(
            "beta_area",
            "m²",
            -1 / 24,
            1 / 24,
            scale="pitch_square",
            reason="β is at most 1/24, that of masses on a string without mass, and at least 0 "
            "(Kittel, Introduction to Solid State Physics, chapter 4); the geometry's holes have "
            "their own β in the simulation already",
        ),
    ),
    changes={"operators": slow},
    source="second order in ka of Bloch waves, as of a string with masses, "
    "ω = (2c/a) sin(ka/2) ≈ ck(1 − k²a²/24)",
    limits="wavelength long against the pitch: (ka)⁴/1920 is left out; only films whose geometry "
    "has holes; in frequencies alone the same as another bending stiffness",
    sentence="the lattice of holes slows short waves more or less than the geometry says",
    needs=("pitch_square",),
    one_material=True,
)
