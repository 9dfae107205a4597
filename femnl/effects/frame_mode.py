"""A resonance of the frame that pulls a mode of the film."""

from dataclasses import replace

from femnl.types.effect import Effect, Knob, Values
from femnl.types.scene import Lines


def pull(lines: Lines, values: Values) -> Lines:
    """Shift every mode by g²/(f − f_frame)."""
    distance = lines.frequency - values["frame_frequency"]
    # Where a mode meets the frame the two repel by g at least: the pole of perturbation theory becomes an avoided crossing.
    square = values["coupling_square"]
    shift = square * distance / (distance**2 + square)
    return replace(lines, frequency=lines.frequency + shift)


EFFECT = Effect(
    name="frame_mode",
    equation="f → f + g² Δ/(Δ² + g²), Δ = f − f_frame",
    parameters=(
        Knob("coupling_square", "Hz²", 0.0, 1e8),
        Knob("frame_frequency", "Hz", 0.8, 5.0, strength=False, log=True, per="frequency"),
    ),
    changes={"frequencies": pull},
    source="two coupled oscillators, e.g. Jöckel et al., Appl. Phys. Lett. 99, 143109 (2011)",
    limits="one frame resonance; far from it g²/Δ; its loss is not seen in frequencies",
    sentence="a resonance of the frame pulls the modes near it",
)
