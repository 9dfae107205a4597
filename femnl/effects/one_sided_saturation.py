"""A detector that clips one side of its signal, as a photodiode whose bias is off the middle."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Fringe, Signal


def clip(fringe: Fringe, values: Values) -> Fringe:
    """Clip the signal at +(1 − s) of the fringe's largest value, and not from below."""
    return replace(fringe, limit=min(fringe.limit, 1 - values["clipped"]))


def clip_side(signal: Signal, values: Values) -> Signal:
    """Clip the sinusoid at +(1 − s) of the strongest signal, and not from below.

    Half of what two rails take from the first harmonic.
    """
    size = np.abs(signal.voltage)
    r = np.minimum((1 - values["clipped"]) * signal.largest / np.where(size > 0, size, 1.0), 1.0)
    both = (2 / np.pi) * (np.arcsin(r) + r * np.sqrt(1 - r**2))
    return replace(signal, voltage=signal.voltage * (1 + both) / 2)


EFFECT = Effect(
    name="one_sided_saturation",
    accuracy=0.1,
    accuracy_reason="a sharp limit; amplifiers bend before they clip",
    imitates={
        "map": {"multilayer_fringe": 0.78, "detector_saturation": 0.75, UNKNOWN: 0.01},
        "response": {
            "detector_saturation": 1.0,
            "nonlinear_damping": 0.62,
            "nonlinear_readout": 0.55,
            UNKNOWN: 0.06,
        },
        "trace": {"detector_saturation": 0.71, "multilayer_fringe": 0.69, UNKNOWN: 0.41},
    },
    equation="v − V₀ ≤ (1 − s) max|f − V₀| of the fringe; in sweeps, of the strongest signal",
    parameters=(
        ParameterSpec(
            "clipped",
            "1",
            0.0,
            0.8,
            reason="at 0.8 the first harmonic of a signal is 0.63 of it, near the half left "
            "where one side is cut off wholly, as by a rectifier",
        ),
    ),
    changes={"fringe": clip, "signal": clip_side},
    source="a photodiode that saturates at much light; in sweeps the first Fourier coefficient of "
    "a sine that is clipped above, half of what two rails take",
    limits="sharp, exact for a sinusoid. In maps and traces the rail is above; a detector that "
    "inverts and clips below is not covered. Where little is clipped, sweeps cannot "
    "tell one rail at s from two at s/2^{2/3}: both take (1 − r)^{3/2} first. Nor can they tell "
    "which side it is",
    sentence="the detector clips one side of the signal",
    shared=False,
    pointwise=True,
)
