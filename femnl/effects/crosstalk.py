"""The drive seen by the detector directly."""

from dataclasses import replace

from femnl.types.effect import Effect, Knob, Values
from femnl.types.scene import Signal


def leak(signal: Signal, values: Values) -> Signal:
    """Add a constant part of the drive to the signal."""
    return replace(signal, voltage=signal.voltage + (values["real"] + 1j * values["imag"]) * signal.drive)


EFFECT = Effect(
    name="crosstalk",
    equation="V → V + C V_drive",
    parameters=(Knob("real", "V/V", -1.0, 1.0, per="slope"), Knob("imag", "V/V", -1.0, 1.0, per="slope")),
    changes={"signal": leak},
    source="linear superposition",
    limits="flat over the resonance",
    sentence="the drive leaks into the detected signal",
)
