"""Waves slowed by a lattice of holes."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def slow(system: ModalSystem, values: Values) -> ModalSystem:
    """Lower each f by the part βa²k²."""
    own = np.sqrt(np.diag(system.stiffness))
    factor = (1 - values["beta_area"] * system.wavenumber**2) ** 2 - 1
    return replace(system, stiffness=system.stiffness + np.diag(factor * own**2))


EFFECT = Effect(
    name="hole_dispersion",
    equation="f → f (1 − βa² k²), a the pitch of the holes",
    parameters=(ParameterSpec("beta_area", "m²", 0.0, 5e-11),),
    changes={"operators": slow},
    source="second order of Bloch waves in a periodic membrane",
    limits="wavelength long against the pitch; is indistinguishable from less bending stiffness",
    sentence="the lattice of holes slows short waves",
)
