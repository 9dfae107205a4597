"""Attraction between film and wafer under a voltage, which grows as they approach."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Points


def soften(points: Points, values: Values) -> Points:
    """Take the gradient of the attraction off the stiffness."""
    voltage = points.control["voltage"]
    # From 0 V on, where the frequency is what it is.
    square = voltage**2 - 2 * voltage * values["offset"]
    # Pulled in, it vibrates no more
    stiffness = np.maximum(1 - values["softening"] * square, 0.0)
    return replace(points, frequency=points.frequency * np.sqrt(stiffness))


EFFECT = Effect(
    name="electrostatic_softening",
    accuracy=0.03,
    accuracy_reason="plates without rim, and a charge that stays",
    imitates={"series": {UNKNOWN: 0.09}},
    equation="f² → f² (1 − s(V² − 2VV₀)), s ≤ ε₀/(ρhd³ω²), V₀ of charges and contact potential",
    parameters=(
        ParameterSpec(
            "softening",
            "1/V^2",
            0.0,
            1.1,
            scale="electrostatic",
            reason="metal on film and wafer with the whole film between them has 1; less where "
            "only a part is covered or the field falls off in dielectrics; 10 % for the gap",
        ),
        ParameterSpec(
            "offset",
            "V",
            -10.0,
            10.0,
            strength=False,
            reason="contact potentials are below 1 V; charges trapped in nitride reach 10 V "
            "(Wibbeler, Pfeifer & Hietschold, Sens. Actuators A 71, 74 (1998))",
        ),
    ),
    changes={"points": soften},
    source="energy −½ε₀V²/(d − w) per area of a plate capacitor at a given voltage, whose second "
    "derivative at w = 0 is the stiffness −ε₀V²/d³",
    limits="electrode even over the mode; the film's way d₀ towards the wafer adds 3d₀/d of the "
    "effect and stiffens the film as its square: 3 % at d₀ = d/100",
    sentence="the voltage between film and wafer softens the film",
    needs=("voltage", "frequency"),
)
