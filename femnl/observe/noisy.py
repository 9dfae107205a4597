"""A measurement with its noise as the data show it, not as the file states it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison
from femnl.core.effect import Effect, Kind, ParameterSpec, Stage, Values
from femnl.core.readout import Array
from femnl.observe.model import KnownProduct, ManyResiduals, MeasurementModel, Named, Thinned
from femnl.observe.residuals import Layout, apart


@dataclass(frozen=True)
class FoundNoise:
    """What the data say of their noise.

    glitches: residuals that are left out. factor: standard deviation over the stated one.
    correlation: of neighbours on a line of acquisition, ρ of a noise of first order.
    """

    glitches: tuple[int, ...] = ()
    factor: float = 1.0
    correlation: float = 0.0

    @property
    def as_stated(self) -> bool:
        """Whether the data show nothing else than what the file states."""
        return not self.glitches and self.factor == 1.0 and self.correlation == 0.0

    @property
    def correlation_length(self) -> float:
        """Independent data are this many apart: (1 + ρ)/(1 − ρ)."""
        return (1 + self.correlation) / (1 - self.correlation)


@dataclass(frozen=True, eq=False, kw_only=True)
class NoisyModel(MeasurementModel):
    """A model whose residuals are white and of variance 1 under the noise that was found.

    Glitches are left out; r → r/s; rᵢ → (rᵢ − ρ rᵢ₋₁)/√(1 − ρ²) along each line of acquisition.

    bare: the model under the stated noise. noise: what was found. around: its layout.
    """

    bare: MeasurementModel
    noise: FoundNoise
    around: Layout
    kind: Kind
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...]
    needs_global_search: bool
    stages_of_many: tuple[Stage, ...]
    jumps: tuple[str, ...]
    tells_noise: bool

    @cached_property
    def kept(self) -> NDArray[np.bool_]:
        """The residuals (n_bare,) that are no glitches."""
        kept = np.ones(len(self.around.datum), dtype=bool)
        kept[list(self.noise.glitches)] = False
        return kept

    @cached_property
    def _factor(self) -> Array:
        """Standard deviation (n_bare,) over the stated one; prior knowledge has the stated one."""
        return np.where(self.around.datum < 0, 1.0, self.noise.factor)

    @property
    def variant(self) -> str:
        """The noise that was found."""
        return f"{self.noise!r} {self.bare.variant}".rstrip()

    @cached_property
    def _followers(self) -> NDArray[np.int64]:
        """Residuals whose predecessor is known too: those that are whitened."""
        before = self.around.previous
        return np.flatnonzero((before >= 0) & self.kept & self.kept[before])

    def white(self, whole: Array) -> Array:
        """Turn residuals (…, n_bare) in stated σ into those of unit variance, without glitches."""
        scaled = whole / self._factor
        rho = self.noise.correlation
        if rho:
            white = scaled.copy()
            at = self._followers
            earlier = scaled[..., self.around.previous[at]]
            white[..., at] = (scaled[..., at] - rho * earlier) / np.sqrt(1 - rho**2)
            scaled = white
        return np.asarray(scaled[..., self.kept]) if self.noise.glitches else scaled

    @property
    def independent_blocks(self) -> tuple[Mapping[str, NDArray[np.bool_]], ...]:
        """Those of the bare model, without glitches."""
        return tuple(
            {name: mask[self.kept] for name, mask in group.items()}
            for group in self.bare.independent_blocks
        )

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Those of the bare model, without glitches."""
        return self.bare.blocks[self.kept]

    @cached_property
    def layout(self) -> Layout:
        """That of the bare model; glitches are nobody's neighbours."""
        number = np.where(self.kept, np.cumsum(self.kept) - 1, -1)

        def renumbered(index: NDArray[np.int64]) -> NDArray[np.int64]:
            return np.where(index[self.kept] < 0, -1, number[index[self.kept]])

        around = self.around
        return replace(
            around,
            near=renumbered(around.near),
            previous=renumbered(around.previous),
            datum=around.datum[self.kept],
            repeated=around.repeated[self.kept],
        )

    @cached_property
    def thinned(self) -> Thinned | None:
        """Part of the bare model's data, under the same noise."""
        thin = self.bare.thinned
        if thin is None:
            return None
        glitches = np.flatnonzero(np.isin(thin.at, self.noise.glitches))
        noise = replace(
            self.noise,
            glitches=tuple(glitches.tolist()),
            correlation=self.noise.correlation**thin.step,
        )
        number = np.cumsum(self.kept) - 1
        at = number[thin.at[self.kept[thin.at]]]
        return Thinned(with_noise(thin.model, noise), at, thin.step)

    def known_product(self, base: dict[str, float]) -> KnownProduct | None:
        """Return that of the bare model."""
        return self.bare.known_product(base)

    @property
    def varied(self) -> tuple[str, ...]:
        """Those of the model under the stated noise."""
        return self.bare.varied

    @property
    def quantity(self) -> tuple[Array, str]:
        """That of the bare model, in the standard deviation that was found."""
        sizes, unit = self.bare.quantity
        return sizes[self.kept] * self.noise.factor, unit

    def deviations(self, residuals: Array) -> Array:
        """Return those of the bare model; glitches deviate by nothing."""
        whole = np.zeros((*residuals.shape[:-1], len(self.kept)))
        whole[..., self.kept] = residuals
        return self.bare.deviations(whole)[..., self.kept]

    def locate(self, residual: int) -> str:
        """Say which datum a residual is of."""
        return self.bare.locate(int(np.flatnonzero(self.kept)[residual]))

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return the white residuals of the data that are kept."""
        return self.white(self.bare.residuals(effects, base, values))

    @property
    def residuals_of_many(self) -> ManyResiduals | None:
        """That of the bare model, whitened like residuals."""
        bare = self.bare.residuals_of_many
        if bare is None:
            return None
        return lambda effects, base, values: self.white(bare(effects, base, values))

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return those of the bare model, whitened like residuals."""
        found = self.bare.residual_directions(effects, base, values)
        return {name: self.white(row) for name, row in found.items()}

    def smooth_deviations(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return those of the bare model, whitened like residuals."""
        found = self.bare.smooth_deviations(effects, base, values)
        return {name: self.white(row) for name, row in found.items()}

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return those of the bare model, in the standard deviation that was found."""
        found = self.bare.candidate_measurements(effects, base, values)
        return {name: row / self.noise.factor for name, row in found.items()}

    def systematic(self, unit: str) -> float:
        """Return that of the bare model."""
        return self.bare.systematic(unit)

    @property
    def order_of_blocks(self) -> NDArray[np.int64]:
        """That of the bare model."""
        return self.bare.order_of_blocks

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Return those of the bare model."""
        return self.bare.equivalent_solutions(base)

    def far_from(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Return base parameters far from a solution."""
        return self.bare.far_from(base)

    @property
    def common(self) -> object:
        """Return that of the bare model."""
        return self.bare.common

    def usable_effects(self, library: Iterable[Effect]) -> list[Effect]:
        """Return those of the bare model."""
        return self.bare.usable_effects(library)

    def ruled_out(self, library: Iterable[Effect]) -> tuple[str, ...]:
        """Return those of the bare model."""
        return self.bare.ruled_out(library)

    def can_show(self, effect: Effect) -> bool:
        """Whether the bare model can show it."""
        return self.bare.can_show(effect)

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Return those of the bare model, with glitches marked."""
        return self.bare.marked(self.bare.compare(models), self.noise.glitches)

    def describe(self, residuals: Array) -> str:
        """Say what the bare model does; glitches count as no deviation."""
        whole = np.zeros(len(self.kept))
        whole[self.kept] = residuals
        return self.bare.describe(whole)


def with_noise(bare: MeasurementModel, noise: FoundNoise) -> MeasurementModel:
    """Return the model under the noise that was found, itself where that is as stated."""
    if noise.as_stated:
        return bare
    around = bare.layout or bare.sequence or apart(bare.blocks)
    bare = bare.unscaled_by(noise.glitches)
    return NoisyModel(
        bare=bare,
        noise=noise,
        around=around,
        kind=bare.kind,
        base=bare.base,
        start=bare.start,
        scales=bare.scales,
        notes=(*bare.notes, *_told(noise)),
        needs_global_search=bare.needs_global_search,
        stages_of_many=bare.stages_of_many,
        jumps=bare.jumps,
        # Noise that was found once is not sought in other causes again
        tells_noise=bare.tells_noise or noise.factor != 1,
    )


def without_noise(model: MeasurementModel) -> MeasurementModel:
    """Return the model under the stated noise."""
    return model.bare if isinstance(model, NoisyModel) else model


def _told(noise: FoundNoise) -> list[str]:
    """Say what was found, for the report."""
    told = []
    if noise.factor != 1:
        told.append(f"the noise is {noise.factor:.3g} times what the file states")
    if noise.correlation:
        told.append(
            f"neighbouring data are correlated ({noise.correlation:.2f}), so residuals are whitened"
        )
    return told
