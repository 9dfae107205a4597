"""A wafer that is tilted against the film."""

from dataclasses import replace

from femnl.types.effect import Effect, Knob, Values
from femnl.types.scene import Motion


def tilt(motion: Motion, values: Values) -> Motion:
    """Add gx x + gy y to the phase of the fringe."""
    return replace(motion, theta=motion.theta + values["gradient_x"] * motion.x + values["gradient_y"] * motion.y)


EFFECT = Effect(
    name="phase_tilt",
    equation="θ → θ + gx x + gy y",
    parameters=(Knob("gradient_x", "rad/m", -3e4, 3e4), Knob("gradient_y", "rad/m", -3e4, 3e4)),
    changes={"motion": tilt},
    source="gap d(x, y) linear in x and y: θ = 4πd/λ",
    limits="film and wafer flat",
    sentence="the gap under the film is wedge-shaped, so that the working point of the fringe varies over the map",
)
