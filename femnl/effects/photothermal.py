"""Heat of the laser in the film."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Points


def heat(points: Points, values: Values) -> Points:
    """Lower the stress, and change 1/Q, in proportion to the laser power."""
    power = points.control["laser_power"]
    frequency = points.frequency * (1 - 2 * values["softening"] * power) ** 0.5
    return replace(
        points,
        frequency=frequency,
        quality_factor=points.quality_factor / (1 + values["loss"] * power),
    )


EFFECT = Effect(
    name="photothermal",
    accuracy=0.1,
    accuracy_reason="linear in the power; absorption and conduction vary with temperature",
    imitates={"series": {"optical_spring": 1.0, UNKNOWN: 0.01}},
    equation="f² → f² (1 − 2aP), 1/Q → (1 + gP)/Q, a ≥ 0",
    parameters=(
        ParameterSpec(
            "softening",
            "1/W",
            0.0,
            0.49,
            scale="per_laser_power",
            reason="a film that the laser heats expands against its cold frame and loses tension, "
            "Δf²/f² = −EαΔT/((1 − ν)σ), and at one half it would have lost all of it",
        ),
        ParameterSpec(
            "loss",
            "1/W",
            -0.9999,
            1e3,
            scale="per_laser_power",
            reason="at −1 the delayed force of the heat makes the film oscillate by itself, for "
            "the last 1e-4 see optical_spring; it has cooled a lever from 300 to 18 K, which takes "
            "16 times the loss in the dark (Metzger & Karrai, Nature 432, 1002 (2004)); for 1e3 "
            "see optical_spring, from which frequency and loss alone do not tell it",
        ),
    ),
    changes={"points": heat},
    source="thermal stress of a film on a cold frame; loss: Metzger & Karrai, Nature 432, 1002 "
    "(2004)",
    limits="constants that do not depend on temperature: heated by 100 K, expansion and "
    "conductivity of nitride and silicon change by tens of per cent, and the shift with them",
    sentence="the laser heats the film, which loses tension",
    needs=("laser_power",),
)
