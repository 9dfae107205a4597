"""A resonance of the frame that moves the film's edge as a whole."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Lines

MOTIONS = ("heave", "tilt_x", "tilt_y")


def pull(lines: Lines, values: Values) -> Lines:
    """Couple each mode to the frame, and take the eigenvalue that begins at the mode's own."""
    shares = np.array([values[name] for name in MOTIONS]) ** 2 @ lines.participation
    frame = values["frame_frequency"] * (1 + 0.5j * values["frame_loss"])
    square = lines.frequency**3 / (2 * (lines.frequency + frame.real)) * shares
    half = (lines.frequency - frame) / 2
    shift = half * (np.sqrt(1 + square / half**2) - 1)
    moved = replace(lines, frequency=lines.frequency + shift.real)
    if len(lines.loss):
        moved = replace(moved, loss=lines.loss + 2 * shift.imag / lines.frequency)
    return moved


def _share(name: str, motion: str) -> ParameterSpec:
    # Of either sign, so that a motion that the frame does not make ends at no bound
    return ParameterSpec(
        name,
        "1",
        -0.03,
        0.03,
        reason=f"root of the mass of the film over that of the frame {motion}: a piece of the "
        "wafer 50 µm wide and thick is a thousand films",
    )


EFFECT = Effect(
    name="frame_mode",
    equation="f → f + Δ/2 (√(1 + 4g²/Δ²) − 1), far away g²/Δ, Δ = f − f_F(1 + i/2Q_F), its "
    "imaginary part in 1/2Q; g² = f³/(2(f + f_F)) Σ_φ r_φ² (∫ρhφξ)²/(∫ρhφ² ∫ρhξ²), φ = 1, x, y",
    parameters=(
        _share("heave", "as it moves up and down"),
        _share("tilt_x", "as it tilts along x"),
        _share("tilt_y", "as it tilts along y"),
        ParameterSpec(
            "frame_frequency",
            "Hz",
            0.8,
            5.0,
            strength=False,
            log=True,
            scale="frequency",
            reason="farther from the measured modes it shifts all of them as the speed of waves "
            "does, by g²/Δ ∝ f",
        ),
        ParameterSpec(
            "frame_loss",
            "1",
            1e-5,
            0.1,
            strength=False,
            log=True,
            reason="1/Q of chips that are glued or clamped; a Q of 1e5 is that of a free wafer "
            "(Jöckel et al. 2011), and below 10 it is no resonance",
        ),
    ),
    changes={"frequencies": pull},
    source="two coupled oscillators: Jöckel et al., Appl. Phys. Lett. 99, 143109 (2011); coupling "
    "by inertia as in a base-excited structure, e.g. Clough & Penzien, Dynamics of Structures "
    "(1993), section 26",
    limits="one resonance of the frame, stiff over the size of the film, so that modes even along "
    "both sides do not couple; modes one by one: g² over the distance between two "
    "modes is left out, and so is what a frame makes of a pair of one frequency, (1,3) ± (3,1) of "
    "a square",
    sentence="a resonance of the frame moves the film's edge and pulls the modes near it",
)
