"""A stage that is turned against the film."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Placement


def turn(placement: Placement, values: Values) -> Placement:
    """Turn the positions on the film by the angle."""
    c = np.cos(values["angle"])
    s = np.sin(values["angle"])
    return replace(
        placement, x=c * placement.x + s * placement.y, y=c * placement.y - s * placement.x
    )


EFFECT = Effect(
    name="stage_rotation",
    accuracy=0.01,
    accuracy_reason="axes that are straight",
    imitates={"map": {UNKNOWN: 0.02}},
    equation="x → R(β) x",
    parameters=(
        ParameterSpec(
            "angle",
            "rad",
            -0.4,
            0.4,
            reason="23°, farther than anyone lays a chip by eye, and half of the 45° at which a "
            "square comes to its diagonal",
        ),
    ),
    changes={"placement": turn},
    source="geometry",
    limits="about the centre of the film",
    sentence="the stage is turned against the film",
)
