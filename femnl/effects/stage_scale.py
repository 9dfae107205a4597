"""A stage whose steps are not what they are said to be."""

from dataclasses import replace

from femnl.core.effect import UNKNOWN, Effect, ParameterSpec, Values
from femnl.core.stages import Placement

REASON = (
    "hysteresis of piezo stages in open loop is 10 to 15 % of their travel (Devasia et al., IEEE "
    "Trans. Control Syst. Technol. 15, 802 (2007)); beyond a fifth the device is another one"
)


def scale(placement: Placement, values: Values) -> Placement:
    """Stretch the positions on the film by 1 + sx and 1 + sy."""
    return replace(
        placement,
        x=placement.x * (1 + values["stretch_x"]),
        y=placement.y * (1 + values["stretch_y"]),
    )


EFFECT = Effect(
    name="stage_scale",
    accuracy=0.01,
    accuracy_reason="steps of equal length; piezos creep and bend",
    imitates={"map": {"multilayer_fringe": 0.53, "one_sided_saturation": 0.51, UNKNOWN: 0.15}},
    equation="x → (1 + sx) x, y → (1 + sy) y",
    parameters=(
        ParameterSpec("stretch_x", "1", -0.2, 0.2, reason=REASON),
        ParameterSpec("stretch_y", "1", -0.2, 0.2, reason=REASON),
    ),
    changes={"placement": scale},
    source="calibration of the stage",
    limits="the same as a film of another size",
    sentence="the scale of the stage is off",
)
