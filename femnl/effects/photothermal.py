"""Heat of the laser in the film."""

from dataclasses import replace

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Points


def heat(points: Points, values: Values) -> Points:
    """Lower f and change 1/Q in proportion to the laser power, f with a small bend."""
    power = points.control["laser_power"]
    frequency = points.frequency * (1 - values["softening"] * power * (1 + values["bend"] * power))
    return replace(
        points,
        frequency=frequency,
        quality_factor=points.quality_factor / (1 + values["loss"] * power),
    )


EFFECT = Effect(
    name="photothermal",
    equation="f → f (1 − aP(1 + bP)), 1/Q → (1 + gP)/Q, a ≥ 0",
    parameters=(
        ParameterSpec(
            "softening",
            "1/W",
            0.0,
            0.5,
            scale="per_laser_power",
            reason="a film that the laser heats expands against its cold frame and loses tension, "
            "Δf/f = −EαΔT/(2(1 − ν)σ), and at one half it would have lost all of it",
        ),
        ParameterSpec(
            "bend",
            "1/W",
            -0.5,
            0.5,
            strength=False,
            scale="per_laser_power",
            reason="up to 500 K the expansion and conductivity of nitrides, oxides and silicon "
            "change by half (Touloukian, Thermophysical Properties of Matter, 1970)",
        ),
        ParameterSpec(
            "loss",
            "1/W",
            -0.9,
            10.0,
            scale="per_laser_power",
            reason="at −1 the delayed force of the heat makes the film oscillate by itself; a loss "
            "ten times that in the dark is no small effect of warmth",
        ),
    ),
    changes={"points": heat},
    source="thermal stress of a film on a cold frame; loss: Metzger & Karrai, Nature 432, 1002 "
    "(2004)",
    limits="to second order in the power; f is good to (aP)², 1 % at aP = 0.1",
    sentence="the laser heats the film, which loses tension",
    needs=("laser_power",),
)
