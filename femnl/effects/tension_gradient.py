"""Film stress that varies over the film."""

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import ModalSystem


def tilt(system: ModalSystem, values: Values) -> ModalSystem:
    """Add σ (gx x/R + gy y/R + b (x² + y²)/R²), R the film's reach."""
    s = system.stress
    for weight, slope in (
        (1, values["slope_x"]),
        (2, values["slope_y"]),
        (3, values["bowl"]),
        (5, values["bowl"]),
    ):
        system = system.stretched(weight, slope * s, slope * s)
    return system


EFFECT = Effect(
    name="tension_gradient",
    equation="σ → σ (1 + gx x/R + gy y/R + b (x² + y²)/R²)",
    parameters=(
        ParameterSpec("slope_x", "1", -0.2, 0.2),
        ParameterSpec("slope_y", "1", -0.2, 0.2),
        ParameterSpec("bowl", "1", -0.2, 0.2),
    ),
    changes={"operators": tilt},
    source="∫ δT |∇ξ|² of perturbation theory, here to all orders within the base modes",
    limits="lowest orders of a smooth variation; in-plane equilibrium is not imposed",
    sentence="the film stress varies over the film",
)
