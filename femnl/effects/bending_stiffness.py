"""Bending stiffness other than the film's thickness and modulus give."""

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def stiffen(system: ModalSystem, values: Values) -> ModalSystem:
    """Change ℓ² by s = ℓ² − ℓ₀², in the film and in the layer at its clamped edge."""
    return system.bent(float(np.sqrt(max(system.bending_length**2 + values["excess"], 0.0))))


EFFECT = Effect(
    name="bending_stiffness",
    accuracy=0.02,
    accuracy_reason="the layer at the clamp, and how thickness varies over a film",
    imitates={"spectrum": {"hole_dispersion": 0.92, UNKNOWN: 0.1}},
    equation="f² → (c/2π)² (k² + ℓ²k⁴), ℓ² = ℓ₀² + s, ℓ = h √(E/12(1 − ν²)σ), ℓ₀ from the geometry",
    parameters=(
        ParameterSpec(
            "excess",
            "m²",
            -1.0,
            15.0,
            scale="layer_square",
            reason="ℓ² is not negative, and a film has no more than four times the thickness or "
            "sixteen times the modulus that its geometry says",
        ),
    ),
    changes={"operators": stiffen},
    source="Kirchhoff plate in tension, e.g. Timoshenko & Woinowsky-Krieger (1959)",
    limits="wavelength long against ℓ; from 0 to four times ℓ₀, between which the simulated k is "
    "interpolated",
    sentence="the film is not as stiff in bending as its geometry says: another thickness, modulus "
    "or stress",
)
