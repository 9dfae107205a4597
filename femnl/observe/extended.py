"""A base model extended by effects, as a function of one vector of parameters."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femnl.core.effect import Effect, ManyValues, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.observe.model import KnownProduct, MeasurementModel, scale_of


@dataclass(frozen=True)
class ProductOf:
    """A known product as a function of a vector; places: of its parameter, and of the others."""

    of: KnownProduct
    places: list[int]

    @property
    def place(self) -> int:
        """Where the parameter is that the factor multiplies."""
        return self.places[0]

    def factor(self, vector: Array) -> tuple[float, Array]:
        """Return the factor, and the slopes (p,) of its logarithm."""
        others = self.places[1:]
        factor, slopes = self.of.factor(*vector[others])
        found = np.zeros(len(vector))
        found[others] = slopes
        return factor, found


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

    def known_product(self, vector: Array) -> ProductOf | None:
        """Return the product that the data know near a vector, and hardly its factors, if any."""
        found = self.base_model.known_product(self.split(vector)[0])
        own = [spec.name for owner, spec in self.parameters if owner == "base"]
        if found is None or not {found.name, *found.others} <= set(own):
            return None
        return ProductOf(found, [own.index(name) for name in (found.name, *found.others)])

    def residuals(self, vector: Array) -> Array:
        """Return the residuals in σ, prior knowledge included."""
        base, values = self.split(vector)
        return self.base_model.residuals(self.effects, base, values)

    def residuals_of_each(self, vectors: Array) -> Iterator[Array]:
        """Yield the residuals (n,) of each of several vectors (m, p).

        Where the base model takes many sets of parameters, those that go the same way are computed
        at once: with 400 data, most of the time of one is not spent on data. Elsewhere one after
        the other, as millions of residuals fill the memory.
        """
        at_once = self.base_model.residuals_of_many
        if at_once is None or not all(self._takes_many(effect) for effect in self.effects):
            yield from map(self.residuals, vectors)
            return
        ways, way = np.unique(self._ways(vectors), axis=0, return_inverse=True)
        found: dict[int, Array] = {}
        for number in range(len(ways)):
            rows = np.flatnonzero(way == number)
            base, values = self._split_many(vectors[rows])
            together = at_once(self.effects, base, values)
            found |= dict(zip(rows.tolist(), together, strict=True))
        yield from (found[row] for row in range(len(vectors)))

    def _takes_many(self, effect: Effect) -> bool:
        """Whether an effect takes many sets of parameters at once."""
        together = self.base_model.stages_of_many
        return effect.pointwise or effect.changes.keys().isdisjoint(together)

    def _ways(self, vectors: Array) -> Array:
        """Return what (m, k) of vectors (m, p) must be equal for them to be computed at once.

        It is which parameters of effects vanish, and the whole numbers.
        """
        ways = []
        for (owner, spec), numbers in zip(self.parameters, vectors.T, strict=True):
            if spec.whole:
                ways.append(np.rint(numbers))
            elif owner != "base":
                ways.append((numbers == 0).astype(float))
        return np.stack(ways, axis=1) if ways else np.zeros((len(vectors), 1))

    def _split_many(self, vectors: Array) -> tuple[ManyValues, list[ManyValues]]:
        """Return what `split` does, of each row of vectors (m, p) at once."""
        none = np.zeros(len(vectors))
        named: dict[str, dict[str, Array]] = {
            "base": {spec.name: none for spec in self.base_model.base}
        }
        named |= {effect.name: {} for effect in self.effects}
        for (owner, spec), numbers in zip(self.parameters, vectors.T, strict=True):
            named[owner][spec.name] = np.rint(numbers) if spec.whole else numbers
        return named["base"], [named[effect.name] for effect in self.effects]
