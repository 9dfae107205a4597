"""Loss by gas, in proportion to its pressure."""

from dataclasses import replace

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Lines, Points


def damp(points: Points, values: Values) -> Points:
    """Set 1/Q to 1/Q₀ + c p."""
    return replace(
        points,
        quality_factor=1
        / (1 / points.quality_factor + values["per_pressure"] * points.control["pressure"]),
    )


def damp_lines(lines: Lines, values: Values) -> Lines:
    """The same for every mode at one pressure, c ∝ 1/f from the lowest mode on."""
    if not len(lines.loss):
        return lines
    lowest = lines.frequency.min(axis=-1, keepdims=True)
    more = values["per_pressure"] * lines.pressure * lowest / lines.frequency
    return replace(lines, loss=lines.loss + more)


EFFECT = Effect(
    name="gas_damping",
    accuracy=0.2,
    accuracy_reason="free molecules at a wall of known temperature; the accommodation is not known",
    equation="1/Q → 1/Q₀ + c p, c = (2/π)^{3/2} √(M/RT)/(ρhf) times 0.13 to 4.6",
    parameters=(
        ParameterSpec(
            "per_pressure",
            "1/Pa",
            0.13,
            4.6,
            log=True,
            scale="gas_loss",
            reason="of nitrogen at 295 K on both sides: √(2/28) for H2 to √(146/28) for SF6, and a "
            "factor of 2 either way for how molecules leave the surface (Christian 1966; Bao "
            "2002); gas that is squeezed is trapped_gas",
        ),
    ),
    changes={"points": damp, "frequencies": damp_lines},
    source="free molecular flow: Christian, Vacuum 16, 175 (1966); Bao et al., J. Micromech. "
    "Microeng. 12, 341 (2002)",
    limits="mean free path long against the film, below about 100 Pa; both sides free, to a "
    "factor of 2, or a gap that gas leaves slowly (Bao's energy transfer needs ωτ ≪ 1)",
    sentence="gas damps the motion in proportion to its pressure",
    needs=("pressure", "quality_factor"),
    one_material=True,
    pointwise=True,
)
