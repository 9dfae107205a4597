"""A detector too slow for the highest harmonics."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Harmonics


def slow(harmonics: Harmonics, values: Values) -> Harmonics:
    """Divide V_n by 1 + inωτ and undo the delay τ that all harmonics share.

    The phase of the motion takes up that delay.
    """
    lag = 2 * np.pi * harmonics.frequency * values["time_constant"] * harmonics.harmonic[:, None]
    return replace(harmonics, values=harmonics.values * np.exp(1j * lag) / (1 + 1j * lag))


EFFECT = Effect(
    name="detector_bandwidth",
    accuracy=0.03,
    accuracy_reason="one pole; amplifiers have further ones beyond",
    imitates={
        "map": {"trigger_jitter": 0.92, UNKNOWN: 0.05},
        "trace": {"trigger_jitter": 0.91, UNKNOWN: 0.01},
    },
    equation="V_n → V_n e^{inωτ}/(1 + inωτ), corner frequency 1/2πτ",
    parameters=(
        ParameterSpec(
            "time_constant",
            "s",
            0.0,
            0.5,
            scale="period",
            reason="a corner at a third of the drive: of a slower detector all harmonics fall as "
            "1/n, and only its delay, which counts to the motion, goes on growing",
        ),
    ),
    changes={"harmonics": slow},
    source="first-order low pass",
    limits="one pole; its delay τ counts to the phase of the motion",
    sentence="the detector is too slow for the highest harmonics",
    shared=False,
)
