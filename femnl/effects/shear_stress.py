"""In-plane shear of the film stress."""

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def shear(system: ModalSystem, values: Values) -> ModalSystem:
    """Add σxy = s σ."""
    return system.tensioned(shear=values["shear"])


EFFECT = Effect(
    name="shear_stress",
    accuracy=0.005,
    accuracy_reason="shear that is the same all over the film",
    imitates={
        "spectrum": {
            "aspect_ratio": 1.0,
            "stress_anisotropy": 1.0,
            "added_mass": 0.56,
            UNKNOWN: 0.47,
        }
    },
    equation="σxy = s σ",
    parameters=(
        ParameterSpec(
            "shear",
            "1",
            -0.1,
            0.1,
            reason="shear of s is anisotropy of 2s along the diagonals, and that is at most 0.2",
        ),
    ),
    changes={"operators": shear},
    source="membrane equation T : ∇∇w",
    limits="uniform shear; frequencies tell its size alone, and labels of pairs such as "
    "(1,2)+(2,1) its sign. The lowest 14 of 48 modes are right to 1e-8 of the film solved anew, "
    "with anisotropy of 0.2 beside it to 5e-8, and with a lattice of 900 holes to 3e-6",
    sentence="the film stress has a shear component, which turns the pairs of modes to the "
    "diagonals",
)
