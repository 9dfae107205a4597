"""Eigenfrequencies against the simulated film with its speed of waves free, and their loss.

Without any effect each mode loses what its bending does: 1/Q = s φ, with the part s of its energy
that is bending and one loss angle φ of the material.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, ManyValues, ParameterSpec, Values
from femnl.core.memo import recent, recent_of
from femnl.core.numbers import plain, signed
from femnl.core.readout import Array
from femnl.core.stages import ModalSystem
from femnl.observe.film import SimulatedFilm
from femnl.observe.many_sets import columns, of_set, one_set, part_of
from femnl.observe.model import ManyResiduals, MeasurementModel, Named, remembering
from femnl.observe.residuals import Quantity, Ranked
from femnl.observe.score_directions import smooth_film
from femnl.observe.spectrum.eigen import eigen, squares
from femnl.observe.spectrum.films import Films, Solved, bent_part, together, with_densities
from femnl.observe.spectrum.matching import by_label, by_rank
from femnl.observe.spectrum.reader import LineReader

NEXT = 8
"""Unmeasured modes that are offered as the next measurement."""
AT_ONCE = 16
"""Films that are read off at once; their matrices still lie in the cache of a processor."""


@dataclass(frozen=True, eq=False)
class SpectrumModel(MeasurementModel):
    """Residuals of measured eigenfrequencies.

    frequency, sd (n,) [Hz] and time (n,) [s], empty where not known, of each measured mode; label:
    of each, empty where they go by rank; order (n,): its mode of the unchanged film; target
    (n, n_modes): the shape that each label names, in modes of modal mass 1, empty without labels;
    bending_sd: relative standard deviation of ℓ. quality_factor and quality_factor_sd (n,), NaN
    where one was not measured, empty where none was; pressure [Pa] of the gas, 0 where not
    recorded; known_speed: c [m/s] and its standard deviation where the file tells them, as the rest
    of a chip does.
    """

    kind = "spectrum"
    needs_global_search = True
    stages_of_many = ("frequencies",)

    frequency: Array
    sd: Array
    label: tuple[str, ...]
    time: Array
    film: SimulatedFilm
    bending_sd: float
    order: NDArray[np.int64]
    target: Array
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...]
    quality_factor: Array = field(default_factory=lambda: np.empty(0))
    quality_factor_sd: Array = field(default_factory=lambda: np.empty(0))
    pressure: float = 0.0
    known_speed: tuple[float, float] | None = None

    @property
    def ranked(self) -> tuple[Ranked, ...]:
        """All frequencies, where no mode has a label."""
        if self.label:
            return ()
        return (Ranked(np.arange(len(self.sd)), self.frequency, self.sd),)

    @cached_property
    def _eigen(self) -> Callable[[ModalSystem], tuple[Array, Array]]:
        """Eigenvalues of the latest matrices; where no label and no loss asks, without vectors."""
        return recent_of(eigen if self.label or len(self._rated) else squares)

    @cached_property
    def _operators(
        self,
    ) -> Callable[[ModalSystem, Sequence[Effect], Sequence[Values]], ModalSystem]:
        """What effects make of the latest matrices."""
        return remembering("operators")

    @cached_property
    def _bare(self) -> Callable[[float, float], tuple[Array, Array, ModalSystem]]:
        """The unchanged film at the latest speeds and bending lengths."""
        return recent(self._unchanged)

    def can_show(self, effect: Effect) -> bool:
        """Whether an effect acts on spectra, its needs are met, and its equation holds."""
        return super().can_show(effect) and not (self.film.layered and effect.one_material)

    def ruled_out(self, library: Iterable[Effect]) -> tuple[str, ...]:
        """Name the effects whose equations hold for films of one material, where layers lie."""
        if not self.film.layered:
            return ()
        shown = super().can_show
        names = [effect.name for effect in library if effect.one_material and shown(effect)]
        if not names:
            return ()
        listed = ", ".join(names)
        return (f"spectrum: left out, as they are known for films of one material alone: {listed}",)

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Every mode is a block of its own; prior knowledge of ℓ and c belongs to none."""
        return np.concatenate([np.arange(len(self.frequency)), [-1], self._rated, -self._told])

    @property
    def quantity(self) -> tuple[Array, str]:
        """Hz of the frequencies."""
        rest = np.full(1 + len(self._rated) + len(self._told), np.nan)
        return np.concatenate([self.sd, rest]), "Hz"

    @property
    def _names(self) -> tuple[str, ...]:
        """The label of each mode, else its rank from 1."""
        return tuple(self.label or [str(i + 1) for i in self.order])

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Frequencies, and those quality factors that are known."""
        n = len(self.frequency)
        names = np.array(self._names)
        found = [Quantity("frequency", "Hz", np.arange(n), self.sd, {"mode": (names, "")})]
        rated = self._rated
        if len(rated):
            sd = self.quality_factor_sd[rated]
            at = n + 1 + np.arange(len(rated))
            found.append(Quantity("quality factor", "", at, sd, {"mode": (names[rated], "")}))
        return tuple(found)

    def locate(self, residual: int) -> str:
        """Name the mode."""
        n = len(self.frequency)
        names = self._names
        if residual < n:
            return f"frequency of mode ({names[residual]})"
        if residual == n:
            return "the bending length"
        if residual > n + len(self._rated):
            return "the speed of waves"
        return f"quality factor of mode ({names[self._rated[residual - n - 1]]})"

    @cached_property
    def _rated(self) -> NDArray[np.int64]:
        """The modes whose quality factors are known."""
        known = np.isfinite(self.quality_factor) & np.isfinite(self.quality_factor_sd)
        return np.flatnonzero(known)

    @cached_property
    def _told(self) -> NDArray[np.int64]:
        """One where the file tells the speed of waves, as its last residual; none elsewhere."""
        return np.ones(0 if self.known_speed is None else 1, dtype=np.int64)

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return deviations with frequency squared and with time, and an uneven film."""
        found = {
            "rise with frequency": (self.frequency / self.frequency.max()) ** 2
            * self.frequency
            / self.sd
        }
        if "time" in self.scales:
            found["order of acquisition"] = (
                (self.time - self.time.mean()) / self.scales["time"] * self.frequency / self.sd
            )
        told = np.zeros(len(self._told))
        lossless = np.zeros(1 + len(self._rated) + len(told))
        found = {name: np.append(row, lossless) for name, row in found.items()}
        if len(self._rated) > 1:
            q = self.quality_factor[self._rated]
            alike = q / q.max() * q / self.quality_factor_sd[self._rated]
            ratio = self.frequency[self._rated] / self.frequency.max()
            bare = np.zeros(1 + len(self.frequency))
            found["loss alike for all modes"] = np.concatenate([bare, alike, told])
            found["loss that falls with frequency"] = np.concatenate([bare, alike / ratio, told])
        return found | smooth_film(self, effects, base, values)

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (f − f_predicted)/σ of each mode, and the deviation of other known numbers in σ.

        These are, in order: ℓ, the quality factor Q of each mode where it is known, and c where it
        is.
        """
        one = self._of_films(effects, one_set(base), [one_set(own) for own in values])
        return one.reshape(-1)

    @property
    def residuals_of_many(self) -> ManyResiduals:
        """Those of films that are solved one after another, and read off at once."""

        def of_many(
            effects: Sequence[Effect], base: ManyValues, values: Sequence[ManyValues]
        ) -> Array:
            count = len(base["speed"])
            return np.concatenate(
                [
                    self._of_films(
                        effects, part_of(base, few), [part_of(own, few) for own in values]
                    )
                    for few in (slice(k, k + AT_ONCE) for k in range(0, count, AT_ONCE))
                ]
            )

        return of_many

    def _of_films(
        self, effects: Sequence[Effect], base: ManyValues, values: Sequence[ManyValues]
    ) -> Array:
        """Return the residuals (m, n_residuals) of m films."""
        count = len(base["speed"])
        sets = [[of_set(own, k) for own in values] for k in range(count)]
        solved = [self._solved(effects, of_set(base, k), numbers) for k, numbers in enumerate(sets)]
        films = Films(
            together([one.frequency for one in solved]),
            together([one.vectors for one in solved]),
            together([one.mass for one in solved]),
            self._loss_of(solved, base) if len(self._rated) else np.empty((count, 0)),
            with_densities([one.film for one in solved]),
        )
        numbers = sets[0] if count == 1 else [columns(own) for own in values]
        read_off = partial(self._reader.read_off, films, effects, numbers)
        if self.label:
            own = together([one.own[self.order] for one in solved])
            share = (self.target @ films.content) ** 2
            found, loss = by_label(share, own, self.frequency, self.sd, read_off)
        else:
            found, loss = by_rank(films.frequency, self.order, self.frequency, read_off)
        quality = self.quality_factor[self._rated] - 1 / loss[:, self._rated]
        speed, speed_sd = self.known_speed or (0.0, 1.0)
        return np.concatenate(
            [
                (self.frequency - found) / self.sd,
                (base["bending_length"][:, None] / self.film.bending_length - 1) / self.bending_sd,
                quality / self.quality_factor_sd[self._rated],
                self._told * (base["speed"][:, None] - speed) / speed_sd,
            ],
            axis=1,
        )

    @cached_property
    def _share(self) -> Callable[[float], Array]:
        """1/Q of each base mode in units of the loss angle of bending, (n,), at the latest ℓ."""
        return recent(self.film.bending_share_at)

    def _loss_of(self, solved: Sequence[Solved], base: ManyValues) -> Array:
        """Return the loss of each changed mode by its bending, (m, n_changed)."""
        # The cubic in ℓ may cross zero far from the geometry's own
        share = [np.maximum(self._share(one.system.bending_length), 0.0) for one in solved]
        return base["intrinsic_loss"][:, None] * bent_part(solved, together(share))

    @cached_property
    def _reader(self) -> LineReader:
        """Reads off what was measured of each mode."""
        participation = self.film.rigid**2 / self.film.modes.effective_mass
        return LineReader(self.time, self.order, participation, self.film.gap, self.pressure)

    def _solved(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Solved:
        """Return a changed film, without vectors where nothing has a label or a quality factor."""
        plain, mass, bare = self._bare(base["speed"], base["bending_length"])
        system = self._operators(bare, effects, values)
        square, vectors = self._eigen(system)
        frequency = np.sqrt(np.maximum(square, 0)) / (2 * np.pi)
        return Solved(frequency, vectors, plain, mass, bare.film, system)

    def _unchanged(self, speed: float, bending_length: float) -> tuple[Array, Array, ModalSystem]:
        """Return frequencies and masses of the unchanged film's modes, and its matrices."""
        plain = self.film.frequency(speed, bending_length)
        # The geometry states its stress and assumes its density, so that c is carried by the
        # density.
        film = replace(self.film.model.film, density=self.film.model.film.stress / speed**2)
        mass = self.film.modes.effective_mass * film.density / self.film.model.film.density
        stiffness = np.diag(mass * (2 * np.pi * plain) ** 2)
        box = self.film.model.outline.size
        system = ModalSystem(
            stiffness,
            np.diag(mass),
            film.stress,
            film,
            self.film.projection,
            box,
            bending_length,
            self.film.layer,
            self.film.gap,
            self.film.airload,
            speed_known=self.known_speed is not None,
            area=self.film.area,
            thicker=self.film.thicker,
        )
        return plain, mass, system

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return the next modes that were not measured; their pairs by rising frequency."""
        frequency = self._solved(effects, base, values).frequency
        missing = [k for k in range(max(self.order) + 1 + NEXT) if k not in self.order][:NEXT]
        names = [self.film.modes.label[k] or f"({k + 1})" for k in missing]
        return {
            f"the frequency of mode {name}": frequency[[k]] / np.median(self.sd)
            for name, k in zip(names, missing, strict=True)
        }

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Return the frequencies, mode by mode."""
        n = len(self.frequency)
        away = np.stack(
            [self.residuals(effects, base, values)[:n] for _, effects, base, values in models]
        )
        curve = Curve(
            "modes",
            np.arange(n, dtype=float),
            self.frequency,
            self.sd,
            self.frequency - away * self.sd,
        )
        return (
            Curves(
                "spectrum",
                "mode",
                "",
                "frequency",
                "Hz",
                tuple(m[0] for m in models),
                (curve,),
                self._names,
                joined=False,
            ),
        )

    def describe(self, residuals: Array) -> str:
        """Name the modes that deviate most, in Hz and σ."""
        deviation = residuals[: len(self.frequency)]
        worst = np.argsort(-np.abs(deviation))[:3]
        names = self._names
        parts = [
            f"({names[i]}) by {signed(deviation[i] * self.sd[i], 'Hz')} ({plain(deviation[i], 3)}σ)"
            for i in worst
        ]
        return (
            f"modes {', '.join(parts)} deviate most from the simulated film; rms "
            f"{plain(float(np.sqrt(np.mean(deviation**2))), 3)}σ"
        )
