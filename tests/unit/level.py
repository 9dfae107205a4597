"""A model small enough to see through: data in units of σ, whose base model is a constant."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.observe.model import MeasurementModel, Named, apply


class Level(MeasurementModel):
    """Data (n,) in blocks (n,), with the level within ±half.

    Effects change the prediction at "placement", where no free form acts.
    """

    kind = "map"

    def __init__(
        self,
        data: Array,
        blocks: NDArray[np.int64],
        half: float,
        patterns: Mapping[str, Array] | None = None,
        needs_global_search: bool = False,
    ) -> None:
        self.data = data
        self._blocks = blocks
        self.needs_global_search = needs_global_search
        self.base = (ParameterSpec("level", "1", -half, half),)
        self.start = np.zeros(1)
        self.scales = {"time": 1.0}
        self.notes = ()
        self._patterns = dict(patterns or {})

    @property
    def blocks(self) -> NDArray[np.int64]:
        return self._blocks

    @property
    def quantity(self) -> tuple[Array, str]:
        return np.ones(len(self.data)), "V"

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        return self._patterns

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        return np.asarray(
            self.data - apply("placement", np.full(len(self.data), base["level"]), effects, values)
        )

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        return {}

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        return ()

    def describe(self, residuals: Array) -> str:
        return ""


def bump(place: Array, half: float) -> Effect:
    """Return something of a size up to half, at a place in -1 to 1, of a width."""

    def lift(value: Array, values: Values) -> Array:
        return np.asarray(
            value + values["size"] * np.exp(-(((place - values["place"]) / values["width"]) ** 2))
        )

    parameters = (
        ParameterSpec("size", "1", -half, half),
        ParameterSpec("place", "1", -1, 1, False),
        ParameterSpec("width", "1", 0.05, 1, False),
    )
    return Effect("bump", "", parameters, {"placement": lift}, "", "", "")
