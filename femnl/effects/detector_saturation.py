"""A detector that clips."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Fringe, Signal


def clip(fringe: Fringe, values: Values) -> Fringe:
    """Clip the signal at ±(1 − s) of the fringe's largest value; s = 0 clips nothing."""
    rail = 1 - values["clipped"]
    return replace(fringe, limit=min(fringe.limit, rail), floor=max(fringe.floor, -rail))


def clip_sweep(signal: Signal, values: Values) -> Signal:
    """Clip the sinusoid at ±(1 − s) of the strongest signal.

    That leaves (2/π)(asin r + r √(1 − r²)) of one 1/r times the limit.
    """
    size = np.abs(signal.voltage)
    r = np.minimum((1 - values["clipped"]) * signal.largest / np.where(size > 0, size, 1.0), 1.0)
    return replace(
        signal, voltage=signal.voltage * (2 / np.pi) * (np.arcsin(r) + r * np.sqrt(1 - r**2))
    )


EFFECT = Effect(
    name="detector_saturation",
    accuracy=0.1,
    accuracy_reason="a sharp limit; amplifiers bend before they clip",
    imitates={
        "map": {"one_sided_saturation": 0.85, UNKNOWN: 0.01},
        "response": {"one_sided_saturation": 0.92, UNKNOWN: 0.05},
        "trace": {"one_sided_saturation": 0.73, UNKNOWN: 0.8},
    },
    equation="|v − V₀| ≤ (1 − s) max|f − V₀| of the fringe; in sweeps, of the strongest signal",
    parameters=(
        ParameterSpec(
            "clipped",
            "1",
            0.0,
            0.8,
            reason="at 0.8 a signal of five times the rails is a square wave, whose first harmonic "
            "is within 1 % of its limit 4/π and tells no size any more",
        ),
    ),
    changes={"fringe": clip, "signal": clip_sweep},
    source="an amplifier between its rails; in sweeps its describing function, the first Fourier "
    "coefficient of a clipped sine (Gelb & Vander Velde, Multiple-Input Describing Functions and "
    "Nonlinear System Design)",
    limits="sharp and the same on both sides (one rail: one_sided_saturation); exact for a "
    "sinusoid",
    sentence="the detector clips the signal",
    shared=False,
    pointwise=True,
)
