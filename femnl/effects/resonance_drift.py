"""A resonance that drifts past the drive while a map is taken."""

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Motion


def wander(motion: Motion, values: Values) -> Motion:
    """Let the motion at each point follow the detuning at the time when it was measured."""
    start, end = np.min(motion.time), np.max(motion.time)
    part = (motion.time - (start + end) / 2) / (end - start)
    detuning = values["detuning"] + values["drift"] * part
    response = (1 + 2j * values["detuning"]) / (1 + 2j * detuning)
    return motion.driven(motion.swing * response)


EFFECT = Effect(
    name="resonance_drift",
    accuracy=0.1,
    accuracy_reason="linear in time; drifts relax and wander",
    imitates={"map": {"doublet": 0.96, UNKNOWN: 0.24}},
    equation="U → U (1 + 2iδ)/(1 + 2i(δ + rs)), s = −½ … ½ the time in the map, δ = (f_d − f₀)/w "
    "in its middle",
    parameters=(
        ParameterSpec(
            "detuning",
            "1",
            -5.0,
            5.0,
            strength=False,
            reason="in linewidths; five away the motion is a tenth of that at resonance, and only "
            "the ratio of drift to detuning can be told",
        ),
        ParameterSpec(
            "drift",
            "1",
            -10.0,
            10.0,
            reason="in linewidths over the map; one that drifts farther is out of sight for most "
            "of it: 1e-5 of a resonance at 1.5 MHz is ten linewidths at Q = 1e6",
        ),
    ),
    changes={"motion": wander},
    source="Lorentzian response of a mode, linewidth w (Schmid, Villanueva & Roukes, "
    "Fundamentals of Nanomechanical Resonators, section 1.2.1), and a steady drift",
    limits="linear response; steady drift, slow against the ring-down: of r linewidths in a time T "
    "the motion is late by r/(πwT) of itself, 0.1 % for w = 10 Hz, r = 3 and T = 100 s",
    sentence="the resonance drifts while the map is taken, so that the motion changes from line to "
    "line",
    needs=("time",),
)
