"""A drive that does not follow its voltage."""

from dataclasses import replace

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Oscillator


def compress(mode: Oscillator, values: Values) -> Oscillator:
    """Let the force grow as V/(1 + κV²)."""
    return replace(mode, force=mode.force / (1 + values["kappa"] * mode.force**2))


EFFECT = Effect(
    name="drive_compression",
    equation="F → V/(1 + κV²)",
    parameters=(ParameterSpec("kappa", "V^-2", 0.0, 20.0, scale="drive_square"),),
    changes={"oscillator": compress},
    source="third order of an amplifier or a piezo in compression",
    limits="the same at all frequencies",
    sentence="the drive does not grow as its voltage",
)
