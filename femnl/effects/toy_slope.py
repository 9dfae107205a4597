"""Values that rise with their place in a list: a toy that shows what a new cause costs."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.observe.toy.model import Heights


def _rise(heights: Heights, values: Values) -> Heights:
    place = np.linspace(-1, 1, len(heights.value))
    return replace(heights, value=heights.value + values["rise"] * place)


EFFECT = Effect(
    name="toy_slope",
    equation="h → h + r x, x = −1 … 1 along the list",
    parameters=(ParameterSpec("rise", "m", -10.0, 10.0, scale="height"),),
    changes={"heights": _rise},
    source="none: a toy",
    limits="none",
    sentence="the heights rise along the list",
)
