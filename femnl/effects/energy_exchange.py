"""A mode that loses energy through another one as long as it moves strongly."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Dissipation

EDGE = 0.06
"""Change of ln energy over which the rate changes: less than most records resolve."""


def exchange(mode: Dissipation, values: Values) -> Dissipation:
    """Raise the rate above a threshold of the energy."""
    above = np.clip((mode.level - values["threshold"]) / EDGE + 0.5, 0.0, 1.0)
    return replace(mode, rate=mode.rate + mode.slow * values["excess"] * above)


EFFECT = Effect(
    name="energy_exchange",
    accuracy=0.1,
    accuracy_reason="two constant rates; the rate of the hybrid mode depends on how much of each "
    "mode is in it, which changes a little with amplitude",
    equation="γ → γ (1 + x) where E > E₁, γ below",
    parameters=(
        ParameterSpec(
            "excess",
            "1",
            0.0,
            20.0,
            reason="seen are factors up to ten (Güttinger et al.); a drive that dies in the filter "
            "is faster still",
        ),
        ParameterSpec(
            "threshold",
            "1",
            -8.0,
            -0.2,
            strength=False,
            reason="ln E₁/E at the begin: above −0.2 nearly nothing of the decay is fast, and from "
            "−8, 35 dB down, on the slow part is in the noise",
        ),
    ),
    changes={"dissipation": exchange},
    source="Güttinger et al., Nat. Nanotechnol. 12, 631 (2017), doi:10.1038/nnano.2017.86: energy "
    "decays fast while modes exchange it through an internal resonance, and slowly once the "
    "amplitude has tuned them apart",
    limits="one threshold, passed once; coherent oscillations of the energy between both modes are "
    "not in it",
    sentence="the mode loses energy through another mode until its amplitude has fallen",
)
