"""A base model extended by effects, as a function of one vector of parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.observe.model import MeasurementModel, scale_of


@dataclass(frozen=True)
class ExtendedModel:
    """A problem's base model with some effects, as a function of one vector."""

    base_model: MeasurementModel
    effects: tuple[Effect, ...] = ()

    @cached_property
    def parameters(self) -> tuple[tuple[str, ParameterSpec], ...]:
        """Every free parameter with the name of its owner, "base" or the effect."""
        gone = {name for effect in self.effects for name in effect.replaces}
        own = [("base", spec) for spec in self.base_model.base if spec.name not in gone]
        return (
            *own,
            *((effect.name, spec) for effect in self.effects for spec in effect.parameters),
        )

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest values, in the unit of each parameter."""
        unit = np.array([scale_of(self.base_model, spec) for _, spec in self.parameters])
        low, high = (
            np.array([getattr(spec, side) for _, spec in self.parameters])
            for side in ("low", "high")
        )
        return low * unit, high * unit

    def part_of_range(self, vector: Array) -> Array:
        """Return where each parameter (p,) lies between its bounds, from 0 to 1.

        Where its prior is uniform in the logarithm, it is placed in the logarithm: a small time is
        not near its bound because the longest one allowed is so much longer.
        """
        low, high = self.bounds
        part = (vector - low) / (high - low)
        log = np.array([spec.log for _, spec in self.parameters])
        part[log] = np.log(vector[log] / low[log]) / np.log(high[log] / low[log])
        return np.asarray(part)

    def split(self, vector: Array) -> tuple[dict[str, float], list[dict[str, float]]]:
        """Return the values of the base parameters (0 for replaced ones) and of each effect."""
        named: dict[str, dict[str, float]] = {
            "base": dict.fromkeys((spec.name for spec in self.base_model.base), 0.0)
        }
        named |= {effect.name: {} for effect in self.effects}
        for (owner, spec), value in zip(self.parameters, vector, strict=True):
            named[owner][spec.name] = float(np.rint(value) if spec.whole else value)
        return named["base"], [named[effect.name] for effect in self.effects]

    def pack(self, base: Values, values: Sequence[Values]) -> Array:
        """Return the vector of named values."""
        owned = {"base": base} | {
            effect.name: own for effect, own in zip(self.effects, values, strict=True)
        }
        return np.array([owned[owner][spec.name] for owner, spec in self.parameters])

    def residuals(self, vector: Array) -> Array:
        """Return the residuals in σ, prior knowledge included."""
        base, values = self.split(vector)
        return self.base_model.residuals(self.effects, base, values)
