"""Heat of the laser in the film."""

from dataclasses import replace

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Points


def heat(points: Points, values: Values) -> Points:
    """Shift f and 1/Q in proportion to the laser power, f with a small bend."""
    power = points.control["laser_power"]
    frequency = points.frequency * (1 + values["pull"] * power + values["bend"] * power**2)
    return replace(
        points,
        frequency=frequency,
        quality_factor=points.quality_factor / (1 + values["loss"] * power),
    )


EFFECT = Effect(
    name="photothermal",
    equation="f → f (1 + aP + bP²), 1/Q → (1 + gP)/Q",
    parameters=(
        ParameterSpec("pull", "1/W", -0.5, 0.5, scale="per_laser_power"),
        ParameterSpec("bend", "1/W^2", -0.5, 0.5, scale="per_laser_power_square"),
        ParameterSpec("loss", "1/W", -0.9, 10.0, scale="per_laser_power"),
    ),
    changes={"points": heat},
    source="Metzger & Karrai, Nature 432, 1002 (2004), to second order in the power",
    limits="low power",
    sentence="the laser heats the film and pulls its resonance",
    needs=("laser_power",),
)
