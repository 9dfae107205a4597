"""A resonance of the frame that pulls a mode of the film."""

from dataclasses import replace

from femnl.types.effect import Effect, Knob, Values
from femnl.types.scene import Lines


def pull(lines: Lines, values: Values) -> Lines:
    """Shift every mode by g²/(f − f_frame), which the frame's loss keeps finite."""
    distance = lines.frequency - values["frame_frequency"]
    # κ = 2g, the border of strong coupling: a smaller loss would split the mode in two where it meets the frame.
    square = values["coupling_square"]
    shift = square * distance / (distance**2 + square)
    return replace(lines, frequency=lines.frequency + shift)


EFFECT = Effect(
    name="frame_mode",
    equation="f → f + Re g²/(Δ − iκ/2), Δ = f − f_frame, κ = 2g",
    parameters=(
        Knob("coupling_square", "Hz²", 0.0, 1e8),
        Knob("frame_frequency", "Hz", 0.8, 5.0, strength=False, log=True, per="frequency"),
    ),
    changes={"frequencies": pull},
    source="two coupled oscillators, e.g. Jöckel et al., Appl. Phys. Lett. 99, 143109 (2011)",
    limits="one frame resonance; far from it g²/Δ whatever its loss κ, which frequencies do not tell",
    sentence="a resonance of the frame pulls the modes near it",
)
