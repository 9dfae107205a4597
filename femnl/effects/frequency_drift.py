"""Frequencies that move with time while they are measured."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Lines, Oscillator, Points, Ringing


def drift(lines: Lines, values: Values) -> Lines:
    """Change every frequency by the same relative rate from the first acquisition on."""
    return replace(
        lines, frequency=lines.frequency * (1 + values["rate"] * (lines.time - lines.time.min()))
    )


def drift_mode(mode: Oscillator, values: Values) -> Oscillator:
    """Change the resonance from point to point of each sweep."""
    return replace(
        mode, frequency=mode.frequency * (1 + values["rate"] * (mode.time - mode.time.min()))
    )


def drift_points(points: Points, values: Values) -> Points:
    """Change the frequency from point to point."""
    time = points.control["time"]
    return replace(points, frequency=points.frequency * (1 + values["rate"] * (time - time.min())))


def drift_ringing(ringing: Ringing, values: Values) -> Ringing:
    """Turn the phase of a decay by πf r t²."""
    angle = np.pi * ringing.frequency * values["rate"] * ringing.time**2
    return replace(ringing, amplitude=ringing.amplitude * np.exp(1j * angle))


EFFECT = Effect(
    name="frequency_drift",
    accuracy=0.1,
    accuracy_reason="linear in time; drifts relax and wander",
    imitates={
        "response": {UNKNOWN: 0.14},
        "series": {UNKNOWN: 0.01},
        "spectrum": {
            "compliant_clamp": 0.6,
            "tension_gradient": 0.57,
            "aspect_ratio": 0.5,
            UNKNOWN: 0.19,
        },
    },
    equation="f → f (1 + r (t − t₀)), t₀ the first acquisition; in sweeps, t of each point",
    parameters=(
        ParameterSpec(
            "rate",
            "1/s",
            -1e-6,
            1e-6,
            reason="1e-6 a second is 0.7 % of the film stress an hour: a nitride film of 1.1 GPa "
            "on silicon, at 9e-5 a kelvin, would have to warm by 80 K in that time",
        ),
    ),
    changes={
        "frequencies": drift,
        "oscillator": drift_mode,
        "points": drift_points,
        "ringing": drift_ringing,
    },
    source="first order in time of a drifting film stress",
    limits="a steady drift that is the same part of every frequency; the mode follows it within "
    "its decay time, which moves a sweep by r f₀/(πw), 0.1 Hz for r f₀ = 1 Hz/s and w = 3 Hz. "
    "Where the file has no duration, each sweep lasts until the next one begins",
    sentence="all frequencies drift with the time of acquisition",
    needs=("time",),
    pointwise=True,
)
