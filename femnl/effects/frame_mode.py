"""A resonance of the frame that pulls a mode of the film."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Lines


def pull(lines: Lines, values: Values) -> Lines:
    """Couple each mode to the frame, and take the frequency on the mode's own side."""
    half = (lines.frequency - values["frame_frequency"]) / 2
    shift = np.sqrt(half**2 + values["coupling_square"]) - np.abs(half)
    return replace(lines, frequency=lines.frequency + np.where(half < 0, -shift, shift))


EFFECT = Effect(
    name="frame_mode",
    equation="f → f ± (√(Δ²/4 + g²) − |Δ|/2), the sign of Δ = f − f_frame; far away f + g²/Δ",
    parameters=(
        ParameterSpec("coupling_square", "Hz²", 0.0, 1e8),
        ParameterSpec(
            "frame_frequency", "Hz", 0.8, 5.0, strength=False, log=True, scale="frequency"
        ),
    ),
    changes={"frequencies": pull},
    source="two coupled oscillators, e.g. Jöckel et al., Appl. Phys. Lett. 99, 143109 (2011)",
    limits="one frame resonance; far from it g²/Δ whatever its loss κ, which frequencies do "
    "not tell",
    sentence="a resonance of the frame pulls the modes near it",
)
