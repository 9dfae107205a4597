"""Damping that grows with amplitude."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Dissipation, Equation, Oscillator


def damp(mode: Oscillator, values: Values) -> Oscillator:
    """Add η to the nonlinear damping."""
    return replace(mode, damping=mode.damping + values["eta"])


def damp_record(forces: Equation, values: Values) -> Equation:
    """Add η to the damping that grows with displacement."""
    return replace(forces, damping=forces.damping + values["eta"])


def damp_decay(mode: Dissipation, values: Values) -> Dissipation:
    """Add ηA²/4 times the rate of small motion, A in units of that at the begin."""
    added = mode.slow * values["eta"] / 4 * np.exp(mode.level)
    return replace(mode, rate=mode.rate + added)


EFFECT = Effect(
    name="nonlinear_damping",
    accuracy=0.05,
    accuracy_reason="the first order in u²; the next follows with u⁴",
    imitates={
        "record": {UNKNOWN: 0.01},
        "response": {"drive_compression": 0.84, "quintic_stiffness": 0.58, UNKNOWN: 0.06},
    },
    equation="γ u̇ → γ (1 + η u²) u̇",
    parameters=(
        ParameterSpec(
            "eta",
            "m^-2",
            0.0,
            400.0,
            scale="curvature",
            reason="no film takes up energy; at most, the strongest drive moves it a fifth as far "
            "as linear damping would",
        ),
    ),
    changes={"oscillator": damp, "equation": damp_record, "dissipation": damp_decay},
    source="averaging of ηu²u̇ over a period; seen by Eichler et al., Nat. Nanotechnol. (2011), "
    "doi:10.1038/nnano.2011.71, and Zaitsev et al., arXiv:0911.0833",
    limits="first order of averaging: ηA² may be large, w ≪ f₀; of a decay, A counts in units of "
    "its amplitude A0 at the begin",
    sentence="damping grows with amplitude",
    pointwise=True,
)
