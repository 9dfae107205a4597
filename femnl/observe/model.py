"""The forward model of a measurement, whatever its kind: residuals in σ of named parameters."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison
from femnl.core.effect import Effect, Kind, ManyValues, ParameterSpec, Stage, Values
from femnl.core.errors import ParameterError
from femnl.core.memo import recent_of
from femnl.core.readout import Array
from femnl.observe.residuals import Layout, Quantity, Ranked

T = TypeVar("T")
Named = tuple[str, Sequence[Effect], Values, Sequence[Values]]
"""A model to be shown: its name, its effects, the base parameters and those of each effect."""
ManyResiduals = Callable[[Sequence[Effect], ManyValues, Sequence[ManyValues]], Array]
"""Residuals (m, n_residuals) under effects, with base parameters (m,) and those of each effect."""


@dataclass(frozen=True, eq=False)
class Thinned:
    """The model of a part of the data, evenly spread.

    at (n,): their residuals among those of the whole model. step: from one of them to the next, in
    steps of the whole data along a line of acquisition.
    """

    model: "MeasurementModel"
    at: NDArray[np.int64]
    step: int


@dataclass(frozen=True)
class KnownProduct:
    """A base parameter of which the data know the product with a factor, and hardly more.

    factor: what others make, by their values, with the slopes of its logarithm by these.
    """

    name: str
    others: tuple[str, ...]
    factor: Callable[..., tuple[float, tuple[float, ...]]]


class MeasurementModel(ABC):
    """One group of a measurement file with its base model: a forward model and its noise.

    A model stores what `pose` of its kind (`KindSpec.pose`) found in the file; it computes only
    when it is asked.

    kind: as effects name it. base: parameters of the base model. start (n_base,): their values
    before any fit. scales: numbers that ranges of parameters count in (`ParameterSpec.scale`), and
    that effects may need. notes: for the report. needs_global_search: whether effects act by jumps,
    so that they are sought from afar as well. stages_of_many: those that `residuals_of_many` runs
    on many sets of parameters at once. jumps: base parameters that move jumps of the data,
    at which a fit may stop short. independent_blocks: groups of base parameters of which each moves
    residuals of its own, given by the mask (n_residuals,) of those, unless an effect
    `couples_blocks`. tells_noise: whether the data themselves tell their noise. noise_factor: noise
    that the model takes over the one stated, and correlation_length: how many neighbouring data it
    takes for one. left_out: glitches that never became residuals, where
    and by how many σ. ranked: residuals whose data go to predictions by rank.
    """

    kind: Kind
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...]
    needs_global_search: bool = False
    stages_of_many: tuple[Stage, ...] = ()
    jumps: tuple[str, ...] = ()
    tells_noise: bool = False
    noise_factor: float = 1.0
    correlation_length: float = 1.0
    left_out: tuple[tuple[str, float], ...] = ()

    @property
    def independent_blocks(self) -> tuple[Mapping[str, NDArray[np.bool_]], ...]:
        """None, unless a kind says otherwise."""
        return ()

    def unscaled_by(self, glitches: Sequence[int]) -> "MeasurementModel":
        """Return the model whose scales do not follow these residuals; itself if none do."""
        return self

    @property
    def order_of_blocks(self) -> NDArray[np.int64]:
        """Numbers of blocks by rising time; empty unless the start hides behind something else."""
        return np.empty(0, np.int64)

    @property
    def thinned(self) -> Thinned | None:
        """Part of the data, in which strong causes show as well; None where all are few."""
        return None

    @property
    def ranked(self) -> tuple[Ranked, ...]:
        """None, unless a kind says otherwise."""
        return ()

    @property
    def common(self) -> object:
        """What measurements of this kind agree in that have parameters of effects in common.

        Nothing, unless a kind says otherwise.
        """
        return None

    @property
    def variant(self) -> str:
        """What residuals depend on beside the file and the parameters, for the names of fits."""
        return ""

    @property
    def varied(self) -> tuple[str, ...]:
        """Control variables that take more than one value, none unless a kind has them."""
        return ()

    @property
    def layout(self) -> Layout | None:
        """None where residuals have no neighbours, as the modes of a spectrum."""
        return None

    @property
    def sequence(self) -> Layout | None:
        """Neighbours in the order of the data, where only noise is alike in them; else None."""
        return None

    def locate(self, residual: int) -> str:
        """Say in a phrase which datum a residual is of."""
        return f"datum {residual + 1}"

    @property
    @abstractmethod
    def quantity(self) -> tuple[Array, str]:
        """What one σ of each residual is (n_residuals,), and its unit.

        NaN for residuals of another quantity, and for prior knowledge.
        """

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Return all that was measured, each in its own unit; prior knowledge is no datum.

        Only residuals whose `quantity` is known are returned, unless a kind says otherwise.
        """
        sizes, unit = self.quantity
        at = np.flatnonzero(np.isfinite(sizes))
        places = np.array([self.locate(int(residual)) for residual in at])
        return (Quantity(self.kind, unit, at, sizes[at], {"datum": (places, "")}),)

    def deviations(self, residuals: Array) -> Array:
        """Return residuals (…, n_residuals) as deviations of the data, in the sd of each datum.

        The same, unless a kind frees its residuals from correlated noise.
        """
        return residuals

    @property
    @abstractmethod
    def blocks(self) -> NDArray[np.int64]:
        """The block of held-out data that each residual (n_residuals,) belongs to.

        −1 is prior knowledge, which is never left out.
        """

    @abstractmethod
    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (data − prediction)/σ of the base model extended by effects, (n_residuals,)."""

    @property
    def residuals_of_many(self) -> ManyResiduals | None:
        """What returns `residuals` of m sets of parameters at once, (m, n_residuals).

        None, unless a kind says otherwise: one after another. It is asked only with effects that
        are `pointwise` where they act at `stages_of_many`, with strengths that vanish in all sets
        or in none, and with the same whole numbers in all.
        """
        return None

    @abstractmethod
    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return directions (n_residuals,) to test whatever the cause, by what they mean."""

    def smooth_deviations(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return directions along which every model may miss the data, by what they mean.

        They are those of `residual_directions`, but for what some cause of the library does alone.
        """
        return self.residual_directions(effects, base, values)

    @abstractmethod
    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return what measurements not yet made would give, in σ of the present ones.

        A phrase names each of them.
        """

    def systematic(self, unit: str) -> float:
        """Return the relative sd of parameters in this unit that no amount of data lowers."""
        return 0.0

    def known_product(self, base: dict[str, float]) -> KnownProduct | None:
        """Return the product that the data know near here, and hardly its factors, if any."""
        return None

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Return other base parameters that predict about the same.

        From them an effect may lead elsewhere.
        """
        return []

    def far_from(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Return base parameters far from a solution, which predict something else.

        A strong cause that a model lacks may have led its fit astray, and only from them leads a
        way to the solution with it.
        """
        return []

    def can_show(self, effect: Effect) -> bool:
        """Whether an effect acts on this kind of measurement, and its `needs` are met."""
        return self.kind in effect.kinds and all(name in self.scales for name in effect.needs)

    def usable_effects(self, library: Iterable[Effect]) -> list[Effect]:
        """Return the effects that can show in this measurement."""
        return [effect for effect in library if self.can_show(effect)]

    def ruled_out(self, library: Iterable[Effect]) -> tuple[str, ...]:
        """Return sentences on effects that this device rules out, though its kind can show them."""
        return ()

    @abstractmethod
    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Set the data beside what each model predicts, ready to be drawn."""

    def marked(
        self, comparisons: tuple[Comparison, ...], residuals: Sequence[int]
    ) -> tuple[Comparison, ...]:
        """Mark the data of some residuals, which no fit has seen, in what is drawn."""
        return comparisons

    @abstractmethod
    def describe(self, residuals: Array) -> str:
        """Say in one sentence where the data deviate and how."""


def scale_of(base_model: MeasurementModel, spec: ParameterSpec) -> float:
    """Return the number that the range of a parameter counts in.

    The one that its `scale` names, 1 where it names none.

    Raises: ParameterError where the measurement does not give it.
    """
    if not spec.scale:
        return 1.0
    if spec.scale not in base_model.scales:
        known = ", ".join(sorted(base_model.scales)) or "none"
        raise ParameterError(
            f"parameter {spec.name}: its range counts in '{spec.scale}', which a "
            f"{base_model.kind} does not give; it gives: {known}"
        )
    return base_model.scales[spec.scale]


def apply(stage: Stage, value: T, effects: Sequence[Effect], values: Sequence[Values]) -> T:
    """Let every effect that acts at a stage change its value, in the order of the list."""
    for effect, numbers in zip(effects, values, strict=True):
        if stage in effect.changes:
            value = effect.changes[stage](value, numbers)
    return value


def remembering(
    stage: Stage, most: int = 24
) -> Callable[[T, Sequence[Effect], Sequence[Values]], T]:
    """Return `apply` at a stage, which keeps what each effect has lately made of each value.

    A fit moves the parameters of one effect while those of others rest, and score tests try effects
    beside causes that rest. For values that nobody changes.
    """

    def changed(value: T, effect: Effect, numbers: Values) -> T:
        result: T = effect.changes[stage](value, numbers)
        return result

    known = recent_of(changed, most)

    def applied(value: T, effects: Sequence[Effect], values: Sequence[Values]) -> T:
        for effect, numbers in zip(effects, values, strict=True):
            if stage in effect.changes:
                value = known(value, effect, numbers)
        return value

    return applied
