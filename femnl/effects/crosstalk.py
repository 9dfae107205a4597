"""The drive seen by the detector directly."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Harmonics, Signal

_REASON = (
    "as strong as the resonance, or as all that is seen at the first place, or twice a background "
    "that is stronger than the resonance and hides it"
)


def leak(signal: Signal, values: Values) -> Signal:
    """Add a constant part of the drive to the signal."""
    return replace(
        signal, voltage=signal.voltage + (values["real"] + 1j * values["imag"]) * signal.drive
    )


def leak_first(harmonics: Harmonics, values: Values) -> Harmonics:
    """Add the same part of the drive to the first harmonic at every point."""
    added = (values["real"] + 1j * values["imag"]) * harmonics.drive * (harmonics.harmonic == 1)
    return replace(harmonics, values=harmonics.values + added[:, None])


EFFECT = Effect(
    name="crosstalk",
    accuracy=0.1,
    accuracy_reason="a path of the same gain over the span of the sweeps; standing waves in cables "
    "whose ends reflect a quarter and two fifths of the voltage vary it by 0.1",
    imitates={
        "map": {UNKNOWN: 0.98},
        "response": {"fano_background": 0.94, "group_delay": 0.66, UNKNOWN: 0.31},
        "trace": {UNKNOWN: 0.01},
    },
    equation="V → V + C V_drive",
    parameters=(
        ParameterSpec("real", "V/V", -1.0, 1.0, scale="slope", reason=_REASON),
        ParameterSpec("imag", "V/V", -1.0, 1.0, scale="slope", reason=_REASON),
    ),
    changes={"signal": leak, "harmonics": leak_first},
    source="linear superposition",
    limits="exact where the leak is flat over the resonance (else sloping_background) and the "
    "drive sinusoidal; where no drive is recorded, of 1 V",
    sentence="the drive leaks into the detected signal",
    shared=False,
    pointwise=True,
)
