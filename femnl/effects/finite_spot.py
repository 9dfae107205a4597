"""A laser spot of finite size."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Placement


def blur(placement: Placement, values: Values) -> Placement:
    """Average the signal over a Gaussian spot of 1/e² radius w, whose sd is w/2."""
    return replace(placement, spot=float(np.hypot(placement.spot, values["radius"] / 2)))


EFFECT = Effect(
    name="finite_spot",
    accuracy=0.03,
    accuracy_reason="a Gaussian spot; optics leave rings",
    imitates={"map": {UNKNOWN: 0.02}},
    equation="V_n → ∫ V_n(x + s) 2/(πw²) e^{−2s²/w²} d²s",
    parameters=(
        ParameterSpec(
            "radius",
            "m",
            0.0,
            1.5e-5,
            reason="rings of the fringe are 10 to 50 µm apart: a wider spot washes them out, and "
            "leaves nothing to tell its size by",
        ),
    ),
    changes={"placement": blur},
    source="Gaussian beam on a detector that adds up power",
    limits="spot smaller than the rings, about λ_ring/2",
    sentence="the laser spot averages over neighbouring points",
    shared=False,
)
