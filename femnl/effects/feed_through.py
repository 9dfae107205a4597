"""A part of the drive that stays after the switch-off."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Reading

_REASON = "what is as strong as the mode at the begin is the drive that was not switched off"


def leak(reading: Reading, values: Values) -> Reading:
    """Add a tone of constant amplitude at the frequency of the drive."""
    if not reading.drive:
        return reading
    size = values["in_phase"] + 1j * values["quadrature"]
    tone = size * np.exp(2j * np.pi * values["offset"] * reading.time)
    return replace(reading, added=reading.added + tone)


EFFECT = Effect(
    name="feed_through",
    accuracy=0.02,
    accuracy_reason="the amplitude of a generator's leak is steady to a few per cent over minutes",
    equation="V → V + c e^{2πiδt}",
    parameters=(
        ParameterSpec("in_phase", "1", -1.0, 1.0, reason=_REASON),
        ParameterSpec("quadrature", "1", -1.0, 1.0, reason=_REASON),
        ParameterSpec(
            "offset",
            "Hz",
            0.0,
            20.0,
            strength=False,
            scale="per_time",
            reason="a drive that was on resonance is off by no more than some linewidths; a faster "
            "beat is averaged away between a few hundred points",
        ),
    ),
    changes={"reading": leak},
    source="linear superposition of the motion and the attenuated drive at the analyser",
    limits="a steady tone; where it stands far above the floor's noise it looks like a floor that "
    "does not fluctuate",
    sentence="a part of the drive stays after the switch-off",
)
