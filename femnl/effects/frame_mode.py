"""A resonance of the frame that moves the film's edge as a whole."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Lines

MOTIONS = ("heave", "tilt_x", "tilt_y")


def pull(lines: Lines, values: Values) -> Lines:
    """Couple each mode to the frame, and take the eigenvalue that begins at the mode's own."""
    motions = zip(MOTIONS, lines.participation, strict=True)
    shares = np.sum([values[name] ** 2 * part for name, part in motions], axis=0)
    own = lines.frequency**2
    frame = values["frame_frequency"] ** 2 * (1 + 1j * values["frame_loss"])
    half = (own - frame) / 2
    # Of (f² − λ)(f_F² − λ) = λ²μ², the root that is f² where nothing couples
    root = half * np.sqrt(1 + own * frame * shares / half**2)
    found = np.sqrt(((own + frame) / 2 + root) / (1 - shares))
    moved = replace(lines, frequency=found.real)
    if len(lines.loss):
        moved = replace(moved, loss=lines.loss + 2 * found.imag / found.real)
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
    accuracy=0.05,
    accuracy_reason="a frame that moves rigidly, and one mode of it",
    imitates={
        "spectrum": {
            "gas_damping": 0.93,
            "compliant_clamp": 0.86,
            "tension_gradient": 0.78,
            "gas_loading": 0.73,
            "clamp_loss": 0.7,
            "trapped_gas": 0.7,
            "yielding_edge": 0.67,
            "hole_dispersion": 0.65,
            "added_mass": 0.63,
            "bending_stiffness": 0.63,
            "aspect_ratio": 0.56,
            "shear_stress": 0.51,
            UNKNOWN: 1.0,
        }
    },
    equation="(f² − λ)(f_F²(1 + i/Q_F) − λ) = λ²μ², λ = f²(1 + i/Q); close to it f + g²/Δ with "
    "g = fμ/2; μ² = Σ_φ r_φ² (∫ρhφξ)²/(∫ρhφ² ∫ρhξ²), φ = 1, x, y",
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
            reason="1/Q of chips that are glued or clamped; 1e5 is more than a mounted chip has, "
            "and below 10 it is no resonance",
        ),
    ),
    changes={"frequencies": pull},
    source="two coupled oscillators: Jöckel et al., Appl. Phys. Lett. 99, 143109 (2011); coupling "
    "by inertia, ∫ρhφξ of a motion φ of the frame that the film takes part in",
    limits="one resonance of the frame, stiff over the size of the film, so that modes even along "
    "both sides do not couple; modes one by one: μ² of their distance from the frame is left "
    "out, and so is what a frame makes of a pair of one frequency, (1,3) ± (3,1) of "
    "a square",
    sentence="a resonance of the frame moves the film's edge and pulls the modes near it",
    pointwise=True,
)
