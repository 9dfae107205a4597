"""Bending stiffness other than the film's thickness and modulus give."""

from dataclasses import replace

import numpy as np

from femnl.types.effect import Effect, Knob, Values
from femnl.types.scene import ModalSystem


def stiffen(system: ModalSystem, values: Values) -> ModalSystem:
    """Raise each ω² by s k², with s = ℓ² − ℓ₀²; the part 2ℓ/L of the clamped edge is the same for all modes and stays in c."""
    own = np.sqrt(np.diag(system.stiffness))
    return replace(system, stiffness=system.stiffness + np.diag(values["excess"] * (system.wavenumber * own) ** 2))


EFFECT = Effect(
    name="bending_stiffness",
    equation="f² → f² (1 + s k²), s = ℓ² − ℓ₀², ℓ = √(D/T), ℓ₀ from the geometry",
    parameters=(Knob("excess", "m²", 0.0, 1e-10),),
    changes={"operators": stiffen},
    source="Kirchhoff plate in tension, e.g. Timoshenko & Woinowsky-Krieger (1959)",
    limits="ℓ ≪ wavelength; the clamped edge's 2ℓ/L cannot be told from the speed of waves",
    sentence="the film is stiffer in bending than its geometry says",
)
