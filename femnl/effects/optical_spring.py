"""The force of the light in the cavity of film and wafer, which follows the motion."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Points


def push(points: Points, values: Values) -> Points:
    """Add the spring to f², and what it does with a delay to 1/Q."""
    power = points.control["laser_power"] * points.spot
    return replace(
        points,
        frequency=points.frequency * np.sqrt(1 + values["spring"] * power),
        quality_factor=points.quality_factor / (1 + values["loss"] * power),
    )


EFFECT = Effect(
    name="optical_spring",
    accuracy=0.1,
    accuracy_reason="one time constant of the force",
    imitates={"series": {"photothermal": 1.0, UNKNOWN: 0.01}},
    equation="f² → f² (1 + sPξ²(x₀)), 1/Q → (1 + gPξ²(x₀))/Q, "
    "g = −ωτsQ of a force that relaxes in τ",
    parameters=(
        ParameterSpec(
            "spring",
            "1/W",
            -0.5,
            0.5,
            scale="per_laser_power",
            reason="beyond half of the film's own stiffness its place at rest moves as much as the "
            "fringe is wide, and two places at rest exist (Dorsel et al., PRL 51, 1550 (1983))",
        ),
        ParameterSpec(
            "loss",
            "1/W",
            -0.9999,
            1e3,
            scale="per_laser_power",
            reason="at −1 the film oscillates by itself, and closer to it than 1e-4, where Q is "
            "1e4 times that in the dark, the power would have to be as steady; light has raised "
            "the loss 30-fold (Gigan et al., arXiv:quant-ph/0607068) and 120-fold (Gröblacher et "
            "al., arXiv:0705.1149); of a force that relaxes in one time g is at most sQ/2, 1e3 for "
            "sP = 0.002 and Q = 1e6",
        ),
    ),
    changes={"points": push},
    source="force F(x(t − τ)): Metzger & Karrai, Nature 432, 1002 (2004); Marquardt & Girvin, "
    "arXiv:0905.0566",
    limits="linear in the power; s and g at the frequency of the mode; of a force that relaxes in "
    "one time to (sP)², 1 % at sP = 0.1; g of either sign, as forces of several delays add up",
    sentence="the force of the light follows the motion and acts as a spring",
    needs=("laser_power", "frequency"),
)
