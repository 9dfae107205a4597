"""Heights against one constant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.observe.model import MeasurementModel, Named, apply


@dataclass(frozen=True)
class Heights:
    """What the stage hands on: value (n,) [m]."""

    value: Array


@dataclass(frozen=True, eq=False)
class ToyModel(MeasurementModel):
    """Residuals of heights (n,) [m] with their standard deviations (n,) [m]."""

    kind = "toy"

    height: Array
    sd: Array
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...] = ()

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Four stretches of the list."""
        return np.arange(len(self.height)) * 4 // len(self.height)

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (h − h_predicted)/σ."""
        flat = Heights(np.full(len(self.height), base["height"]))
        predicted = apply("heights", flat, effects, values).value
        return np.asarray((self.height - predicted) / self.sd)

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """A bend of the list."""
        return {"bend": np.linspace(-1, 1, len(self.sd)) ** 2 / self.sd}

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """The same list again."""
        return {"the same list again": self.residuals(effects, base, values)}

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Heights along the list."""
        left = [self.residuals(effects, base, values) for _, effects, base, values in models]
        curve = Curve(
            "heights",
            np.arange(float(len(self.sd))),
            self.height,
            self.sd,
            self.height - np.stack(left) * self.sd,
        )
        names = tuple(name for name, *_ in models)
        return (Curves("toy", "place", "", "height", "m", names, (curve,)),)

    def describe(self, residuals: Array) -> str:
        """Say where the heights deviate most."""
        return f"height {int(np.argmax(np.abs(residuals))) + 1} deviates most"


def pose(dataset: xr.Dataset, film: object, checkpoint: object = None) -> ToyModel:
    """Return the model of a list of heights, which needs no film and no fit."""
    height = dataset["height"].values
    middle = float(np.median(height))
    size = float(np.ptp(height))
    spec = ParameterSpec("height", "m", middle - size, middle + size)
    sd = dataset["height_sd"].values
    return ToyModel(height, sd, (spec,), np.array([middle]), {"height": size})


def figure(dataset: xr.Dataset) -> Figure:
    """Draw the heights along the list."""
    drawn = Figure()
    drawn.subplots().errorbar(np.arange(len(dataset["height"])), dataset["height"])
    return drawn
