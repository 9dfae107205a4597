"""A detector that clips."""

from dataclasses import replace

from femnl.types.effect import Effect, Knob, Values
from femnl.types.scene import Fringe


def clip(fringe: Fringe, values: Values) -> Fringe:
    """Clip the signal at ±(1 − s) of the fringe's contrast."""
    return replace(fringe, limit=min(fringe.limit, 1 - values["clipped"]))


EFFECT = Effect(
    name="detector_saturation",
    equation="|v − V₀| ≤ (1 − s) V_C",
    parameters=(Knob("clipped", "1", 0.0, 0.8),),
    changes={"fringe": clip},
    source="an amplifier between its rails",
    limits="sharp and the same on both sides",
    sentence="the detector clips the signal",
)
