"""A sweep that is too fast for the mode to settle."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Acquisition


def linger(swept: Acquisition, values: Values) -> Acquisition:
    """Let the mode keep a part of its deviation from the steady motion."""
    return replace(swept, motion=values["kept"])


EFFECT = Effect(
    name="unsettled_mode",
    accuracy=0.05,
    accuracy_reason="points at even times",
    imitates={"response": {UNKNOWN: 0.02}},
    equation="2 dA/dt = −(γ + 2iδ)A + F at each drive frequency for a time T; kept = e^{−γT/2}, "
    "γ = 2πw",
    parameters=(
        ParameterSpec(
            "kept",
            "1",
            0.0,
            0.9,
            reason="at 0.9 the mode rings over ten points, which are too few to follow its phase "
            "wherever it is detuned by more than a linewidth",
        ),
    ),
    changes={"acquisition": linger},
    source="slow flow of a driven Duffing oscillator by averaging (Nayfeh & Mook, Nonlinear "
    "Oscillations, 1979), with steps of the drive at continuous phase",
    limits="exact for a drive that steps from point to point, all at one pace (or that of the "
    "durations in the file), with a cubic force (no quintic one) and settled at the first point: "
    "the motion is right to 3e-6 of the linear one at resonance. A "
    "drive that is swept without steps rings otherwise by (d/w)², d the distance of two points. "
    "Where sweeps jump, the motion is as exact, but a fit may not find it: they are unexplained",
    sentence="the mode does not settle before the next point is taken",
    needs=("direction",),
    pointwise=True,
)
