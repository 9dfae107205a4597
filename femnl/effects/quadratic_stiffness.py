"""A restoring force of second order, as a static bow makes it."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Equation, Motion, Oscillator


def soften(mode: Oscillator, values: Values) -> Oscillator:
    """Lower α by (10/9) κ₂²."""
    return replace(mode, alpha=mode.alpha - 10 / 9 * values["kappa2"] ** 2)


def rectify(motion: Motion, values: Values) -> Motion:
    """Move the film by −½κ₂U² ξ at rest and by ⅙κ₂U² ξ at twice the drive."""
    own = values["kappa2"] * motion.shapes[motion.mode]
    return motion.raised(2, own / 6 * motion.swing**2).shifted(-own / 2 * np.abs(motion.swing) ** 2)


def bend(forces: Equation, values: Values) -> Equation:
    """Add κ₂ to the restoring force."""
    return replace(forces, quadratic=forces.quadratic + values["kappa2"])


EFFECT = Effect(
    name="quadratic_stiffness",
    accuracy=0.02,
    accuracy_reason="second order in κ₂U",
    imitates={
        "map": {"static_bow": 0.82, UNKNOWN: 0.04},
        "record": {UNKNOWN: 0.01},
        "response": {"internal_resonance": 0.79, UNKNOWN: 0.01},
        "trace": {UNKNOWN: 0.01},
    },
    equation="ω₀² (u + αu³) → ω₀² (u + κ₂u² + αu³), κ₂ = k₂/k: α lowered by (10/9)κ₂², u₀ = "
    "−½κ₂U², u₂ = ⅙κ₂U²",
    parameters=(
        ParameterSpec(
            "kappa2",
            "m^-1",
            -3e5,
            3e5,
            reason="3αb of a film that is bent by b: 15 µm for α of 7·10⁹ m⁻², more than a gap",
        ),
    ),
    changes={"oscillator": soften, "motion": rectify, "equation": bend},
    source="second order of averaging (Nayfeh & Mook, Nonlinear Oscillations, 1979), κ₂A ≪ 1; u₀ "
    "and u₂ at ω ≈ ω₀",
    limits="first order in κ₂U; in sweeps of the first harmonic it shows only as softening, "
    "else the scale of metres "
    "takes it up",
    sentence="the film has a restoring force of second order, as a film that is bent at rest",
    pointwise=True,
)
