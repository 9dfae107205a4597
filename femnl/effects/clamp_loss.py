"""Sound that the edge of the film radiates into the chip."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Lines


def radiate(lines: Lines, values: Values) -> Lines:
    """Add the power of the force, and of the torques, with which each mode shakes the chip."""
    if not len(lines.loss):
        return lines
    ratio = lines.frequency / lines.frequency.min(axis=-1, keepdims=True)
    heave, along, across = lines.participation
    monopole = values["monopole"] * ratio**3 * heave
    dipole = values["monopole"] * values["dipole"] ** 2 * ratio**5 * (along + across)
    return replace(lines, loss=lines.loss + np.asarray(monopole + dipole))


EFFECT = Effect(
    name="clamp_loss",
    accuracy=0.3,
    accuracy_reason="the chip is a half-space without modes of its own",
    imitates={"spectrum": {UNKNOWN: 0.0}},
    equation="1/Q → 1/Q + a [(f/f₁)³ H + b² (f/f₁)⁵ (X + Y)], H, X, Y = (∫φξ)²/(∫φ² ∫ξ²) with "
    "φ = 1, x, y; of a square H = 64/(π⁴m²n²) for m and n odd",
    parameters=(
        ParameterSpec(
            "monopole",
            "1",
            0.0,
            1e-2,
            reason="1/Q is less than ρhA ω³/(ρ_s c_s³) on a half-space of silicon, 1e-4 for a film "
            "of 0.3 mm and 0.2 µm; a hundred times that on a thin chip or a soft mount",
        ),
        ParameterSpec(
            "dipole",
            "1",
            -0.5,
            0.5,
            strength=False,
            reason="of the size of half the film times the wavenumber of sound in the chip, 0.2 in "
            "silicon at the lowest mode of a film with waves of 600 m/s; of either sign, so that "
            "none ends at no bound",
        ),
    ),
    changes={"frequencies": radiate},
    source="a half-space radiates ω² times the square of a force and, by dimensions, ω⁴ times that "
    "of a torque; those of the film are ω²∫ρhξ and ω²∫ρhξx, and its energy is ½ω²∫ρhξ². Of a "
    "square 1/Q is then ∝ (m² + n²)^{3/2}/(m²n²) for m and n odd. Such loss was measured and "
    "explained by Wilson-Rae et al., arXiv:1010.2171",
    limits="sound in the chip long against the film, and a chip large against it: a thin chip has "
    "resonances (frame_mode); modes even along both sides radiate less and count as not at all. "
    "Modes one by one: of a pair that is split by less than its linewidth, (1,3) ± (3,1), one has "
    "twice the loss and the other none",
    sentence="the edge radiates sound into the chip",
    needs=("quality_factor",),
    pointwise=True,
)
