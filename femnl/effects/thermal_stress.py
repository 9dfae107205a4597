"""Film stress that follows temperature."""

from dataclasses import replace

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Points


def relax(points: Points, values: Values) -> Points:
    """Change f² by the factor 1 − s (T − T₀)."""
    warm = points.control["temperature"] - points.control["temperature"].mean()
    return replace(points, frequency=points.frequency * (1 - values["slope"] * warm) ** 0.5)


EFFECT = Effect(
    name="thermal_stress",
    equation="f² → f² (1 − s ΔT), s = E(α_film − α_wafer)/((1 − ν)σ₀), "
    "ΔT from the mean temperature",
    parameters=(ParameterSpec("slope", "1/K", -0.5, 0.5, scale="per_temperature"),),
    changes={"points": relax},
    source="σ(T) = σ₀ − E(α_film − α_wafer)ΔT/(1 − ν)",
    limits="constants do not depend on temperature",
    sentence="the film stress follows the temperature",
    needs=("temperature", "frequency"),
)
