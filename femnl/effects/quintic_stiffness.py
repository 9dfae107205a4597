"""A restoring force of fifth order."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Equation, Oscillator


def stiffen(mode: Oscillator, values: Values) -> Oscillator:
    """Add α₅ to the quintic stiffness."""
    return replace(mode, quintic=mode.quintic + values["alpha5"])


def stiffen_record(forces: Equation, values: Values) -> Equation:
    """Add α₅ to the restoring force."""
    return replace(forces, quintic=forces.quintic + values["alpha5"])


EFFECT = Effect(
    name="quintic_stiffness",
    accuracy=0.05,
    accuracy_reason="the next order, u⁷",
    imitates={
        "record": {UNKNOWN: 0.01},
        "response": {
            "quadratic_stiffness": 0.96,
            "internal_resonance": 0.94,
            "nonlinear_damping": 0.79,
            "drive_compression": 0.56,
            UNKNOWN: 0.11,
        },
    },
    equation="ω₀² (u + αu³) → ω₀² (u + αu³ + α₅u⁵)",
    parameters=(
        ParameterSpec(
            "alpha5",
            "m^-4",
            -0.5,
            0.5,
            scale="stiffening_square",
            reason="half of the cubic term α at the largest motion; stronger, it is no correction "
            "of that",
        ),
    ),
    changes={"oscillator": stiffen, "equation": stiffen_record},
    source="first order of averaging (Nayfeh & Mook, Nonlinear Oscillations, 1979): the first "
    "Fourier coefficient of cos⁵ is 5/8",
    limits="a small correction of the cubic term",
    sentence="the film has a restoring force of fifth order",
    pointwise=True,
)
