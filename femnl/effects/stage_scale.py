"""A stage whose steps are not what they are said to be."""

from dataclasses import replace

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.stages import Placement


def scale(placement: Placement, values: Values) -> Placement:
    """Stretch the positions on the film by 1 + sx and 1 + sy."""
    return replace(
        placement,
        x=placement.x * (1 + values["stretch_x"]),
        y=placement.y * (1 + values["stretch_y"]),
    )


EFFECT = Effect(
    name="stage_scale",
    equation="x → (1 + sx) x, y → (1 + sy) y",
    parameters=(
        ParameterSpec("stretch_x", "1", -0.2, 0.2),
        ParameterSpec("stretch_y", "1", -0.2, 0.2),
    ),
    changes={"placement": scale},
    source="calibration of the stage",
    limits="the same as a film of another size",
    sentence="the scale of the stage is off",
)
