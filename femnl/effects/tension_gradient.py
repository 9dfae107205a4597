"""Film stress that varies over the film."""

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem

LARGEST = 0.05
REASON = (
    "the stress of LPCVD nitride varies by a few percent over a wafer; a "
    "twentieth over one film is beyond any deposition"
)


def tilt(system: ModalSystem, values: Values) -> ModalSystem:
    """Deposit the film with σ (gx x/R + gy y/R + b (x² + y²)/R²) more, R the film's reach.

    The integrals are those of what is left once the film has relaxed in its plane.
    """
    return system.tensioned(x=values["slope_x"], y=values["slope_y"], bowl=values["bowl"])


EFFECT = Effect(
    name="tension_gradient",
    accuracy=0.05,
    accuracy_reason="second order in x and y",
    imitates={
        "spectrum": {
            "compliant_clamp": 0.98,
            "aspect_ratio": 0.94,
            "shear_stress": 0.86,
            "trapped_gas": 0.76,
            "added_mass": 0.73,
            "frame_mode": 0.71,
            "stress_anisotropy": 0.7,
            "yielding_edge": 0.67,
            "hole_dispersion": 0.58,
            "frequency_drift": 0.5,
            UNKNOWN: 0.6,
        }
    },
    equation="deposited σ → σ (1 + gx x/R + gy y/R + b (x² + y²)/R²); in equilibrium "
    "∇·(σ I + C ε(u)) = 0, u = 0 at the clamp",
    parameters=(
        ParameterSpec("slope_x", "1", -LARGEST, LARGEST, reason=REASON),
        ParameterSpec("slope_y", "1", -LARGEST, LARGEST, reason=REASON),
        ParameterSpec("bowl", "1", -LARGEST, LARGEST, reason=REASON),
    ),
    changes={"operators": tilt},
    source="plane stress with the film stress as eigenstrain, as thermal strain is (Timoshenko & "
    "Goodier, Theory of Elasticity); ∫ S : ∇ξ∇ξ of Rayleigh",
    limits="isotropic stress of second order in x and y; needs Poisson's ratio. The "
    "lowest 14 of 48 modes are right to 1e-8 of the film solved anew, with a lattice of 900 "
    "holes a bowl of 0.05 to 2e-7",
    sentence="the film stress varies over the film",
)
