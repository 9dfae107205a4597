"""A drive that does not follow its voltage."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Oscillator


def compress(mode: Oscillator, values: Values) -> Oscillator:
    """Let the force grow as V/(1 + κV²): slower than V for κ > 0, faster for κ < 0."""
    return replace(mode, force=mode.force / (1 + values["kappa"] * mode.force**2))


EFFECT = Effect(
    name="drive_compression",
    accuracy=0.2,
    accuracy_reason="a piezo saturates or grows by laws of its own",
    imitates={"response": {"nonlinear_damping": 0.89, UNKNOWN: 0.03}},
    equation="F → V/(1 + κV²)",
    parameters=(
        ParameterSpec(
            "kappa",
            "V^-2",
            -0.5,
            20.0,
            scale="drive_square",
            reason="κV² at the strongest drive: at −0.5 the force is twice what the voltage says "
            "and grows six times as fast; a piezo driven harder saturates beyond its coercive "
            "field (Hall, J. Mater. Sci. 36, 4575 (2001)). At 20 it is 5 % of what the voltage "
            "says, and falls as that grows",
        ),
    ),
    changes={"oscillator": compress},
    source="third order of an amplifier in compression, or of a piezo whose strain grows faster "
    "than its field (Hall, J. Mater. Sci. 36, 4575 (2001))",
    limits="the same at all frequencies; exact to the order κV², a model of one parameter beyond: "
    "of a force V + cV³ with cV² = 0.1 it misses 1 %",
    sentence="the drive does not grow as its voltage",
    pointwise=True,
)
