"""Eigenfrequencies against the simulated film with its speed of waves free, and their loss.

Without any effect each mode loses what its bending does: 1/Q = s φ, with the part s of its energy
that is bending and one loss angle φ of the material.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.memo import recent, recent_of
from femnl.core.readout import Array
from femnl.core.stages import Lines, ModalSystem
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import MeasurementModel, Named, Quantity, Ranked, apply, remembering
from femnl.observe.score_directions import smooth_film

OWN = 0.75
"""Share of a base mode in a changed mode from which on the change keeps its label."""
NEXT = 8
"""Unmeasured modes that are offered as the next measurement."""
CLOSE = 0.01
"""Relative distance in frequency up to which two modes may exchange labels."""


@dataclass(frozen=True, eq=False)
class SpectrumModel(MeasurementModel):
    """Residuals of measured eigenfrequencies.

    frequency, sd (n,) [Hz] and time (n,) [s], empty where not known, of each measured mode; label:
    of each, empty where they go by rank; order (n,): its mode of the unchanged film; target
    (n, n_modes): the shape that each label names, in modes of modal mass 1, empty without labels;
    bending_sd: relative standard deviation of ℓ. quality_factor and quality_factor_sd (n,), NaN
    where one was not measured, empty where none was; pressure [Pa] of the gas, 0 where not
    recorded.
    """

    kind = "spectrum"
    needs_global_search = True

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

    @property
    def ranked(self) -> tuple[Ranked, ...]:
        """All frequencies, where no mode has a label."""
        if self.label:
            return ()
        return (Ranked(np.arange(len(self.sd)), self.frequency, self.sd),)

    @cached_property
    def _eigen(self) -> Callable[[ModalSystem], tuple[Array, Array]]:
        """Eigenvalues of the latest matrices; what has no labels needs no vectors."""
        return recent_of(_eigen if self.label else _squares)

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

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Every mode is a block of its own; prior knowledge of ℓ belongs to none."""
        return np.concatenate([np.arange(len(self.frequency)), [-1], self._rated])

    @property
    def quantity(self) -> tuple[Array, str]:
        """Hz of the frequencies."""
        rest = np.full(1 + len(self._rated), np.nan)
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
        return f"quality factor of mode ({names[self._rated[residual - n - 1]]})"

    @cached_property
    def _rated(self) -> NDArray[np.int64]:
        """The modes whose quality factors are known."""
        known = np.isfinite(self.quality_factor) & np.isfinite(self.quality_factor_sd)
        return np.flatnonzero(known)

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Deviations with frequency squared and with time, and an uneven film."""
        found = {
            "rise with frequency": (self.frequency / self.frequency.max()) ** 2
            * self.frequency
            / self.sd
        }
        if "time" in self.scales:
            found["order of acquisition"] = (
                (self.time - self.time.mean()) / self.scales["time"] * self.frequency / self.sd
            )
        lossless = np.zeros(1 + len(self._rated))
        found = {name: np.append(row, lossless) for name, row in found.items()}
        if len(self._rated) > 1:
            q = self.quality_factor[self._rated]
            alike = q / q.max() * q / self.quality_factor_sd[self._rated]
            ratio = self.frequency[self._rated] / self.frequency.max()
            bare = np.zeros(1 + len(self.frequency))
            found["loss alike for all modes"] = np.append(bare, alike)
            found["loss that falls with frequency"] = np.append(bare, alike / ratio)
        return found | smooth_film(self, effects, base, values)

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (f − f_predicted)/σ of each mode, the deviation of ℓ in units of its own σ.

        And (Q − Q_predicted)/σ of each mode whose quality factor is known.
        """
        frequency, content, plain, layer = self._solved(effects, base, values)
        film = self._bare(base["speed"], base["bending_length"])[2].film

        rated = len(self._rated) > 0
        own_loss = base["intrinsic_loss"] * self._share(layer) if rated else np.empty(0)

        def read_off(chosen: NDArray[np.int64]) -> Lines:
            # Without labels no vectors are solved for, and the film's own modes stand for them.
            own = np.eye(len(plain))[:, self.order]
            parts = content[:, chosen] ** 2 if self.label else own
            lines = Lines(
                frequency[chosen],
                self.time,
                own_loss @ parts if rated else own_loss,
                self._participation @ parts,
                film,
                self.film.gap,
                self.pressure,
            )
            return apply("frequencies", lines, effects, values)

        def misfit(chosen: NDArray[np.int64]) -> Array:
            return np.asarray((self.frequency - read_off(chosen).frequency) / self.sd)

        chosen = self._labelled(frequency, (self.target @ content) ** 2, plain, misfit)
        lines = read_off(chosen)
        quality = self.quality_factor[self._rated] - 1 / lines.loss[self._rated]
        return np.concatenate(
            [
                (self.frequency - lines.frequency) / self.sd,
                [(base["bending_length"] / self.film.bending_length - 1) / self.bending_sd],
                quality / self.quality_factor_sd[self._rated],
            ]
        )

    @cached_property
    def _share(self) -> Callable[[float], Array]:
        """1/Q of each base mode in units of the loss angle of bending, (n,), at the latest ℓ."""
        return recent(self.film.bending_share_at)

    @cached_property
    def _participation(self) -> Array:
        """Squared share of each base mode in the rigid motions of the film, (3, n)."""
        return self.film.rigid**2 / self.film.modes.effective_mass

    def _solved(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> tuple[Array, Array, Array, float]:
        """Return the frequencies of the changed modes, and the base modes of modal mass 1 in them.

        (base, changed), whose squares are shares; the own frequency of each base mode; and ℓ [m] of
        the changed film.

        Where nothing has a label the vectors are left out.
        """
        plain, mass, system = self._bare(base["speed"], base["bending_length"])
        system = self._operators(system, effects, values)
        square, vectors = self._eigen(system)
        frequency = np.sqrt(np.maximum(square, 0)) / (2 * np.pi)
        return frequency, vectors * np.sqrt(mass)[:, None], plain, system.bending_length

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
        )
        return plain, mass, system

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """The next modes that were not measured; their pairs by rising frequency."""
        frequency, _, _, _ = self._solved(effects, base, values)
        missing = [k for k in range(max(self.order) + 1 + NEXT) if k not in self.order][:NEXT]
        names = [self.film.modes.label[k] or f"({k + 1})" for k in missing]
        return {
            f"the frequency of mode {name}": frequency[[k]] / np.median(self.sd)
            for name, k in zip(names, missing, strict=True)
        }

    def _labelled(
        self,
        frequency: Array,
        share: Array,
        plain: Array,
        misfit: Callable[[NDArray[np.int64]], Array],
    ) -> NDArray[np.int64]:
        """Return the changed mode of each measured one: by rank.

        With labels by its share of that mode, mixed pairs as they fit best.
        """
        if not self.label:
            # Ranks are those of one moment: two close modes may have been measured in the wrong
            # order by a film that drifts.
            moved = (self.frequency - self.sd * misfit(self.order)) / frequency[self.order]
            return ranks(self.frequency / moved)
        _, column = linear_sum_assignment(-share)
        chosen = np.asarray(column, dtype=np.int64)
        mixed = np.flatnonzero(share[np.arange(len(share)), chosen] < OWN)
        for a, b in combinations(mixed, 2):
            if abs(plain[self.order[a]] / plain[self.order[b]] - 1) < CLOSE:
                swapped = chosen.copy()
                swapped[[a, b]] = chosen[[b, a]]
                if np.sum(misfit(swapped) ** 2) < np.sum(misfit(chosen) ** 2):
                    chosen = swapped
        return chosen

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Frequencies, mode by mode."""
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
            f"({names[i]}) by {deviation[i] * self.sd[i]:+.3g} Hz ({deviation[i]:+.1f}σ)"
            for i in worst
        ]
        return (
            f"modes {', '.join(parts)} deviate most from the simulated film; rms "
            f"{np.sqrt(np.mean(deviation**2)):.3g}σ"
        )


def _eigen(system: ModalSystem) -> tuple[Array, Array]:
    """Return ω² and the vectors of M-norm 1.

    Most causes leave the masses alone, and then a plain problem is the faster one.
    """
    mass = system.mass
    own = np.diag(mass)
    if np.count_nonzero(mass) == len(own):
        square, turned = np.linalg.eigh(system.stiffness / np.sqrt(np.outer(own, own)))
        return square, turned / np.sqrt(own)[:, None]
    square, vectors = eigh(system.stiffness, mass, check_finite=False)
    return np.asarray(square), np.asarray(vectors)


def _squares(system: ModalSystem) -> tuple[Array, Array]:
    """Return ω² alone, and no vectors (n, 0).

    What has no labels goes by rank, and the vectors cost twice as much as the squares.
    """
    mass = system.mass
    root = np.sqrt(np.diag(mass))
    none = np.empty((len(root), 0))
    scaled = np.outer(root, root)
    if np.count_nonzero(mass) == len(root):
        return np.linalg.eigvalsh(system.stiffness / scaled), none
    return np.asarray(eigh(system.stiffness, mass, eigvals_only=True, check_finite=False)), none


def ranks(frequency: Array) -> NDArray[np.int64]:
    """Return the rank (n,) of each frequency, from 0."""
    order = np.empty(len(frequency), dtype=np.int64)
    order[np.argsort(frequency, kind="stable")] = np.arange(len(frequency))
    return order
