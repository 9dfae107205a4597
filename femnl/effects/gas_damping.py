"""Loss by gas, in proportion to its pressure."""

from dataclasses import replace

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Points


def damp(points: Points, values: Values) -> Points:
    """Set 1/Q to 1/Q₀ + c p."""
    return replace(
        points,
        quality_factor=1
        / (1 / points.quality_factor + values["per_pressure"] * points.control["pressure"]),
    )


EFFECT = Effect(
    name="gas_damping",
    equation="1/Q → 1/Q₀ + c p",
    parameters=(ParameterSpec("per_pressure", "1/Pa", 0.0, 1.0, scale="per_pressure"),),
    changes={"points": damp},
    source="free molecular flow, e.g. Bao et al., J. Micromech. Microeng. 12, 341 (2002)",
    limits="mean free path long against the film and the gap",
    sentence="gas damps the motion in proportion to its pressure",
    needs=("pressure", "quality_factor"),
)
