"""An interferometer whose working point drifts while the motion rings down."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Reading


def wander(reading: Reading, values: Values) -> Reading:
    """Let the slope of the fringe follow a phase that moves evenly."""
    begin = values["phase"]
    slope = np.cos(begin + values["turn"] * reading.time) / np.cos(begin)
    return replace(reading, gain=reading.gain * slope)


EFFECT = Effect(
    name="working_point",
    accuracy=0.1,
    accuracy_reason="an even drift of the phase; drifts of temperature relax and wander",
    equation="V → V cos(φ + φ̇t)/cos φ",
    parameters=(
        ParameterSpec(
            "turn",
            "rad/s",
            -7.0,
            7.0,
            scale="per_time",
            reason="more than a fringe in one decay is a lock that is lost: the power would vanish "
            "again and again",
        ),
        ParameterSpec(
            "phase",
            "rad",
            0.0,
            1.4,
            strength=False,
            reason="beyond 1.4 rad from the steepest point of the fringe an interferometer shows a "
            "sixth of the motion and nobody begins there",
        ),
    ),
    changes={"reading": wander},
    source="slope of a two-beam interference fringe, the derivative of a sine",
    limits="motion small against the wavelength, a steady drift; a drift of less than a radian "
    "looks like a frequency that leaves the filter",
    sentence="the working point of the interferometer drifts during the decay",
)
