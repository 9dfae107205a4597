"""A second mode that rings down within the bandwidth of the analyser."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Ringing

_REASON = "the stronger of the two at the begin is the mode itself"


def beat(ringing: Ringing, values: Values) -> Ringing:
    """Add the partner, which turns at the splitting and decays at a rate of its own."""
    size = values["in_phase"] + 1j * values["quadrature"]
    decay = -0.5 * values["partner_rate"] + 2j * np.pi * values["splitting"]
    return replace(ringing, amplitude=ringing.amplitude + size * np.exp(decay * ringing.time))


EFFECT = Effect(
    name="beating_pair",
    accuracy=0.01,
    accuracy_reason="superposition of two linear modes; a readout that sees both in another ratio "
    "is part of the amplitude",
    equation="A → A + r e^{−γ₂t/2 + 2πiΔt}",
    parameters=(
        ParameterSpec("in_phase", "1", -1.0, 1.0, reason=_REASON),
        ParameterSpec("quadrature", "1", -1.0, 1.0, reason=_REASON),
        ParameterSpec(
            "splitting",
            "Hz",
            2.5,
            40.0,
            strength=False,
            log=True,
            scale="per_time",
            reason="fewer than 2.5 beats in a decay look like any other bend; more than 40 are too "
            "fast for a few hundred points",
        ),
        ParameterSpec(
            "partner_rate",
            "1/s",
            0.2,
            3.0,
            strength=False,
            log=True,
            scale="rate",
            reason="a partner that decays more than three times as fast is gone before it beats, "
            "and is no more than a second rate; one that decays a fifth as fast soon is the mode "
            "itself",
        ),
    ),
    changes={"ringing": beat},
    source="superposition of two decays",
    limits="two modes without coupling of their energies; power alone does not tell which of the "
    "two has the higher frequency, and the splitting counts as positive",
    sentence="a second mode beats with the first within the bandwidth",
)
