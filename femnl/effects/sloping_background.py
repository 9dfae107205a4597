"""A background of the drive that changes along the sweep."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Signal

_REASON = (
    "as strong as the resonance, or as all that is seen at the first place, or twice a background "
    "that is stronger than the resonance and hides it"
)
_SLOPE = "a slope that doubles the largest background within the sweeps; steeper is a resonance"


def slope(signal: Signal, values: Values) -> Signal:
    """Add C₀ + C₁(f − f₀) times the drive to the signal."""
    level = values["real"] + 1j * values["imag"]
    tilt = values["slope_real"] + 1j * values["slope_imag"]
    background = (level + tilt * signal.detuning) * signal.drive
    return replace(signal, voltage=signal.voltage + background)


EFFECT = Effect(
    name="sloping_background",
    accuracy=0.05,
    accuracy_reason="first order in f − f₀",
    imitates={
        "response": {"crosstalk": 1.0, "fano_background": 1.0, "group_delay": 0.69, UNKNOWN: 0.51}
    },
    equation="V → V + (C₀ + C₁(f − f₀)) V_drive",
    parameters=(
        ParameterSpec("real", "V/V", -1.0, 1.0, scale="slope", reason=_REASON),
        ParameterSpec("imag", "V/V", -1.0, 1.0, scale="slope", reason=_REASON),
        ParameterSpec("slope_real", "V/(V Hz)", -1.0, 1.0, scale="slope_per_span", reason=_SLOPE),
        ParameterSpec("slope_imag", "V/(V Hz)", -1.0, 1.0, scale="slope_per_span", reason=_SLOPE),
    ),
    changes={"signal": slope},
    source="first order in f − f₀ of any transfer function without a resonance near by",
    limits="first order: a background that bends within the sweeps by more than their noise is a "
    "resonance of its own (fano_background); a sinusoidal drive; the same at all places",
    sentence="the drive leaks into the detected signal by an amount that changes with frequency",
    shared=False,
    pointwise=True,
)
