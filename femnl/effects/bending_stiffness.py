"""Bending stiffness other than the film's thickness and modulus give."""

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def stiffen(system: ModalSystem, values: Values) -> ModalSystem:
    """Raise ℓ² by s = ℓ² − ℓ₀², in the film and in the layer at its clamped edge."""
    return system.bent(float(np.sqrt(system.bending_length**2 + values["excess"])))


EFFECT = Effect(
    name="bending_stiffness",
    equation="f² → (c/2π)² (k² + ℓ²k⁴), ℓ² = ℓ₀² + s, ℓ = √(D/T), ℓ₀ from the geometry",
    parameters=(ParameterSpec("excess", "m²", 0.0, 15.0, scale="layer_square"),),
    changes={"operators": stiffen},
    source="Kirchhoff plate in tension, e.g. Timoshenko & Woinowsky-Krieger (1959)",
    limits="ℓ ≪ wavelength, and up to four times ℓ₀, as far as the simulated film's k is known",
    sentence="the film is stiffer in bending than its geometry says",
)
