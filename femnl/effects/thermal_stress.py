"""Film stress that follows temperature."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Points


def relax(points: Points, values: Values) -> Points:
    """Change f² by the factor 1 − s (T − T₀)."""
    warm = points.control["temperature"] - points.control["temperature"].mean()
    # A step of a fit may slacken the film
    left = np.maximum(1 - values["slope"] * warm, 0.0)
    return replace(points, frequency=points.frequency * left**0.5)


EFFECT = Effect(
    name="thermal_stress",
    accuracy=0.03,
    accuracy_reason="coefficients of expansion vary by some percent over tens of kelvin",
    imitates={"series": {UNKNOWN: 0.09}},
    equation="f² → f² (1 − s ΔT), s = E(α_film − α_wafer)/((1 − ν)σ₀), "
    "ΔT from the mean temperature",
    parameters=(
        ParameterSpec(
            "slope",
            "1/K",
            -1.5e-5,
            2.5e-5,
            scale="thermal_stress",
            reason="α_film − α_wafer: aluminium on silica, 23e-6/K, has the most of usual pairs, "
            "silica on gallium arsenide or sapphire the least, 0.5e-6 − 6e-6 = −5.5e-6/K; more "
            "for E/((1 − ν)σ) where the geometry assumes it",
        ),
    ),
    changes={"points": relax},
    source="σ(T) = σ₀ − E(α_film − α_wafer)ΔT/(1 − ν), Hooke's law of a film that is held to the "
    "wafer along x and y (Ohring, Materials Science of Thin Films, 2nd ed., chapter 12)",
    limits="constants do not depend on temperature: their change over 20 K, 1 % of silicon's α a "
    "kelvin or less, is left out; a wafer much thicker than the film; a modulus that falls "
    "with temperature changes f² of a device without tension, such as a reed, in the same way",
    sentence="the film stress follows the temperature",
    needs=("temperature", "frequency"),
)
