"""Film stress that differs along x and y."""

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def stretch(system: ModalSystem, values: Values) -> ModalSystem:
    """Set σx = σ(1 + a/2) and σy = σ(1 − a/2)."""
    return system.tensioned(deviator=values["anisotropy"] / 2)


EFFECT = Effect(
    name="stress_anisotropy",
    accuracy=0.005,
    accuracy_reason="stress that is the same all over the film",
    imitates={
        "spectrum": {
            "aspect_ratio": 1.0,
            "shear_stress": 1.0,
            "yielding_edge": 1.0,
            "added_mass": 0.92,
            "trapped_gas": 0.68,
            UNKNOWN: 0.35,
        }
    },
    equation="σx = σ(1 + a/2), σy = σ(1 − a/2)",
    parameters=(
        ParameterSpec(
            "anisotropy",
            "1",
            -0.2,
            0.2,
            reason="a film deposited evenly on a wafer has none; frames that bend and lattices of "
            "holes leave a few percent",
        ),
    ),
    changes={"operators": stretch},
    source="membrane equation T : ∇∇w",
    limits="uniform stress; in frequencies alone the same as a rectangle (aspect_ratio) where "
    "nothing bends. The lowest 14 of 48 modes are right to 1e-8 of the film solved anew, "
    "with a lattice of 900 holes to 2e-6",
    sentence="the film stress differs along x and y",
)
