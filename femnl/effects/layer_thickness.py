"""Layers on the film that are thicker, or thinner, than the geometry says."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def thicken(system: ModalSystem, values: Values) -> ModalSystem:
    """Add what layers of thickness h(1 + t) change, a polynomial in t.

    The film is solved anew at a few t.
    """
    powers = values["excess"] ** np.arange(1, len(system.thicker) + 1)
    more = np.tensordot(powers, system.thicker, 1)
    return replace(system, stiffness=system.stiffness + more)


EFFECT = Effect(
    name="layer_thickness",
    accuracy=0.02,
    accuracy_reason="a layer as thick all over, of the density and stress that the geometry says",
    equation="h → h(1 + t) of the layers, with their mass ρh, tension hσ and stiffness A and D",
    parameters=(
        ParameterSpec(
            "excess",
            "1",
            -0.5,
            0.5,
            scale="layer_thickness",
            reason="a quartz monitor that is not calibrated to its place is off by tens of percent",
        ),
    ),
    changes={"operators": thicken},
    source="the film solved anew with such layers; on the base modes by des Cloizeaux, Nucl. Phys. "
    "20, 321 (1960)",
    limits="layers with a shape, all of them thicker by one factor; spectra alone. Mass dominates, "
    "so that another density of the layers is the same but for their stiffness and tension. "
    "The lowest 12 of 40 modes are right to 4e-6 of the film solved anew",
    sentence="the layers on the film are not as thick as the geometry says",
    needs=("layer_thickness",),
)
