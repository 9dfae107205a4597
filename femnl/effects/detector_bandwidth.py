"""A detector too slow for the highest harmonics."""

from dataclasses import replace

import numpy as np

from femnl.types.effect import Effect, Knob, Values
from femnl.types.scene import Harmonics


def slow(harmonics: Harmonics, values: Values) -> Harmonics:
    """Divide V_n by 1 + inωτ."""
    omega = 2 * np.pi * harmonics.frequency
    return replace(harmonics, values=harmonics.values / (1 + 1j * harmonics.harmonic[:, None] * omega * values["time_constant"]))


EFFECT = Effect(
    name="detector_bandwidth",
    equation="V_n → V_n/(1 + inωτ), corner frequency 1/2πτ",
    parameters=(Knob("time_constant", "s", 0.0, 0.5, per="period"),),
    changes={"harmonics": slow},
    source="first-order low pass",
    limits="one pole",
    sentence="the detector is too slow for the highest harmonics",
    shared=False,
)
