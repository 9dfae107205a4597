"""In-plane shear of the film stress."""

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def shear(system: ModalSystem, values: Values) -> ModalSystem:
    """Add σxy = s σ."""
    return system.stretched(0, 0.0, 0.0, values["shear"] * system.stress)


EFFECT = Effect(
    name="shear_stress",
    equation="σxy = s σ",
    parameters=(ParameterSpec("shear", "1", 0.0, 0.1),),
    changes={"operators": shear},
    source="membrane equation T : ∇∇w",
    limits="uniform shear; frequencies tell its size and not its sign",
    sentence="the film stress has a shear component, which turns the pairs of modes to the "
    "diagonals",
)
