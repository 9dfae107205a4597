"""Averaging over an unsteady trigger."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Harmonics


def blur(harmonics: Harmonics, values: Values) -> Harmonics:
    """Multiply V_n by e^{−(nωs)²/2}."""
    spread = 2 * np.pi * harmonics.frequency * values["sd"] * harmonics.harmonic[:, None]
    return replace(harmonics, values=harmonics.values * np.exp(-(spread**2) / 2))


EFFECT = Effect(
    name="trigger_jitter",
    accuracy=0.03,
    accuracy_reason="a normal distribution",
    imitates={
        "map": {"detector_bandwidth": 0.99, UNKNOWN: 0.04},
        "trace": {"detector_bandwidth": 0.98, UNKNOWN: 0.01},
    },
    equation="V_n → V_n e^{−(nωs)²/2}",
    parameters=(
        ParameterSpec(
            "sd",
            "s",
            0.0,
            0.3,
            scale="period",
            reason="at 0.3 periods e^{−(nωs)²/2} leaves 17 % of the first harmonic and a "
            "thousandth of the second: no more jitter leaves anything to tell it by",
        ),
    ),
    changes={"harmonics": blur},
    source="characteristic function of a normal time error",
    limits="normal, independent from trace to trace",
    sentence="the trigger jitters, and averaging wears the high harmonics down",
    shared=False,
)
