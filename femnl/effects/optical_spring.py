"""The force of the light in the cavity of film and wafer, which follows the motion."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Points


def push(points: Points, values: Values) -> Points:
    """Add the spring to f², and what it does with a delay to 1/Q."""
    spring = values["spring"] * points.control["laser_power"] * points.spot
    loss = 1 / points.quality_factor - values["lag"] ** 2 * spring
    return replace(
        points,
        frequency=points.frequency * np.sqrt(1 + spring),
        quality_factor=1 / loss,
    )


EFFECT = Effect(
    name="optical_spring",
    equation="f² → f² (1 + sPξ²(x₀)), 1/Q → 1/Q − b²sPξ²(x₀), b² = ωτ of the delay of the force",
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
            "lag",
            "1",
            -3.2,
            3.2,
            strength=False,
            reason="a force later than ωτ = 10 has hardly a spring, 1/(1 + ω²τ²) of it: 1 %; of "
            "either sign, so that none ends at no bound",
        ),
    ),
    changes={"points": push},
    source="force F(x(t − τ)): Metzger & Karrai, Nature 432, 1002 (2004); Aspelmeyer, Kippenberg "
    "& Marquardt, Rev. Mod. Phys. 86, 1391 (2014), section V",
    limits="linear in the power; exact for a force that relaxes with one time; s is that at the "
    "frequency of the mode",
    sentence="the force of the light follows the motion and acts as a spring",
    needs=("laser_power", "frequency"),
)
