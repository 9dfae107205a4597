"""A film that is bent at rest."""

from dataclasses import replace

import numpy as np

from femnl.types.effect import Effect, Knob, Values
from femnl.types.scene import Motion


def bow(motion: Motion, values: Values) -> Motion:
    """Add b ξ₁ to the phase of the fringe, ξ₁ the fundamental shape."""
    return replace(motion, theta=motion.theta + values["depth"] * np.abs(motion.shapes[0]))


EFFECT = Effect(
    name="static_bow",
    equation="θ → θ + b ξ₁",
    parameters=(Knob("depth", "rad", -6.0, 6.0),),
    changes={"motion": bow},
    source="static deflection u₀ ξ₁: θ = 4πu₀/λ",
    limits="a bow of the shape of the fundamental mode",
    sentence="the film is bent at rest, so that the working point of the fringe follows its shape",
)
