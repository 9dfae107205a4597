"""A list of eigenfrequencies against the simulated film with its speed of waves free."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, Kind, ParameterSpec, Values
from femnl.core.errors import MeasurementError
from femnl.core.memo import recent
from femnl.core.readout import Array
from femnl.core.stages import Lines, ModalSystem
from femnl.diagnose.score_directions import smooth_film
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import Named, Ranked, apply

BENDING_SD = 0.03
"""Relative standard deviation of ℓ where the geometry gives thickness, modulus and stress: none of
them is known better.
"""
FARTHEST = 4.0
"""How many of those ℓ may deviate."""
OWN = 0.75
"""Share of a base mode in a changed mode from which on the change keeps its label."""
NEXT = 8
"""Unmeasured modes that are offered as the next measurement."""
CLOSE = 0.01
"""Relative distance in frequency up to which two modes may exchange labels."""


class SpectrumModel:
    """Residuals of measured eigenfrequencies; see `MeasurementModel`."""

    kind: Kind = "spectrum"
    needs_global_search = True
    jumps: tuple[str, ...] = ()
    independent_blocks: tuple[Mapping[str, NDArray[np.bool_]], ...] = ()

    def __init__(self, dataset: xr.Dataset, film: SimulatedFilm) -> None:
        usable = np.isfinite(dataset["frequency"].values) & np.isfinite(
            dataset["frequency_sd"].values
        )
        self.frequency = dataset["frequency"].values[usable]
        self.sd = dataset["frequency_sd"].values[usable]
        if len(self.frequency) < 3:
            raise MeasurementError(
                f"spectrum: {len(self.frequency)} usable modes; a diagnosis needs at least 3"
            )
        self.label = (
            [str(name) for name in dataset["label"].values[usable]] if "label" in dataset else []
        )
        self.time = dataset["time"].values[usable] if "time" in dataset else np.empty(0)
        if len(self.time) and not np.isfinite(self.time).all():
            self.time = np.empty(0)
        self.film = film
        unknown = any(
            key == "film" or key in ("film.thickness", "film.young", "film.stress")
            for key in film.model.assumed
        )
        self._bending_sd = np.inf if unknown else BENDING_SD
        # Where ℓ is known, no fit may leave its prior for what only another cause could do.
        low, high = (
            (0.0, 4.0) if unknown else (1 - FARTHEST * BENDING_SD, 1 + FARTHEST * BENDING_SD)
        )
        self._order = self._match()
        self._eigen = recent(_eigen if self.label else _squares)
        self._bare = recent(self._unchanged)
        ratio = float(np.median(self.frequency / film.modes.frequency[self._order]))
        self.base: tuple[ParameterSpec, ...] = (
            ParameterSpec("speed", "m/s", 0.3 * film.speed * ratio, 3 * film.speed * ratio),
            ParameterSpec(
                "bending_length", "m", low * film.bending_length, high * film.bending_length
            ),
        )
        self.start = np.array([film.speed * ratio, film.bending_length])
        self.ranked: tuple[Ranked, ...] = (
            () if self.label else (Ranked(np.arange(len(self.sd)), self.frequency, self.sd),)
        )
        self.scales: Mapping[str, float] = {
            "reach": film.projection.reach,
            "mass": float(film.modes.effective_mass[0] * (film.speed / self.start[0]) ** 2),
            "frequency": float(self.frequency.min()),
            "layer_square": film.bending_length**2,
            **(
                {"time": float(np.ptp(self.time))}
                if len(self.time) and np.ptp(self.time) > 0
                else {}
            ),
        }
        known = (
            "the geometry assumes its film, so ℓ is fitted without prior knowledge"
            if unknown
            else f"ℓ is known to {BENDING_SD:.0%}"
        )
        self.notes: tuple[str, ...] = (
            f"spectrum: c is free, {known}; side, stress and density enter only through c/L",
        )

    def _match(self) -> NDArray[np.int64]:
        """Return the base mode of each measured one: by label, else by rising frequency."""
        if not self.label:
            return _ranks(self.frequency)
        names = self.film.modes.label
        found = []
        for name in self.label:
            if f"({name})" not in names:
                raise MeasurementError(
                    f"spectrum/label: {name!r} is none of the first {len(names)} modes of "
                    f"{self.film.model.name}; correct it"
                )
            found.append(names.index(f"({name})"))
        if len(set(found)) < len(found):
            raise MeasurementError(
                f"spectrum/label: {', '.join(self.label)} names a mode twice; correct the labels"
            )
        return np.array(found, dtype=np.int64)

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Every mode is a block of its own; prior knowledge of ℓ belongs to none."""
        return np.append(np.arange(len(self.frequency)), -1)

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
        return {name: np.append(row, 0.0) for name, row in found.items()} | smooth_film(
            self, effects, base, values
        )

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (f − f_predicted)/σ of each mode, and the deviation of ℓ in units of its own σ."""
        frequency, share, plain = self._solved(effects, base, values)

        def misfit(chosen: NDArray[np.int64]) -> Array:
            lines = apply("frequencies", Lines(frequency[chosen], self.time), effects, values)
            return np.asarray((self.frequency - lines.frequency) / self.sd)

        chosen = self._labelled(frequency, share, plain, misfit)
        return np.append(
            misfit(chosen),
            (base["bending_length"] / self.film.bending_length - 1) / self._bending_sd,
        )

    def _solved(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> tuple[Array, Array, Array]:
        """Return the frequencies of the changed modes and the shares of base modes in them.

        shares: (base, changed); and the own frequency of each base mode.

        Where nothing has a label the shares are left out.
        """
        plain, mass, system = self._bare(base["speed"], base["bending_length"])
        system = apply("operators", system, effects, values)
        square, vectors = self._eigen(system.stiffness, system.mass)
        return np.sqrt(np.maximum(square, 0)) / (2 * np.pi), vectors**2 * mass[:, None], plain

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
        )
        return plain, mass, system

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """The next modes that were not measured; their pairs by rising frequency."""
        frequency, _, _ = self._solved(effects, base, values)
        missing = [k for k in range(max(self._order) + 1 + NEXT) if k not in self._order][:NEXT]
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
            moved = (self.frequency - self.sd * misfit(self._order)) / frequency[self._order]
            return _ranks(self.frequency / moved)
        _, column = linear_sum_assignment(-share[self._order])
        chosen = np.asarray(column, dtype=np.int64)
        mixed = np.flatnonzero(share[self._order, chosen] < OWN)
        for a, b in combinations(mixed, 2):
            if abs(plain[self._order[a]] / plain[self._order[b]] - 1) < CLOSE:
                swapped = chosen.copy()
                swapped[[a, b]] = chosen[[b, a]]
                if np.sum(misfit(swapped) ** 2) < np.sum(misfit(chosen) ** 2):
                    chosen = swapped
        return chosen

    def systematic(self, unit: str) -> float:
        """Nothing beside the statistics."""
        return 0.0

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """None: these data leave one solution."""
        return []

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
        names = tuple(self.label or [str(i + 1) for i in self._order])
        return (
            Curves(
                "spectrum",
                "mode",
                "",
                "frequency",
                "Hz",
                tuple(m[0] for m in models),
                (curve,),
                names,
                joined=False,
            ),
        )

    def describe(self, residuals: Array) -> str:
        """Name the modes that deviate most, in Hz and σ."""
        deviation = residuals[: len(self.frequency)]
        worst = np.argsort(-np.abs(deviation))[:3]
        names = self.label or [str(i + 1) for i in self._order]
        parts = [
            f"({names[i]}) by {deviation[i] * self.sd[i]:+.3g} Hz ({deviation[i]:+.1f}σ)"
            for i in worst
        ]
        return (
            f"modes {', '.join(parts)} deviate most from the simulated film; rms "
            f"{np.sqrt(np.mean(deviation**2)):.3g}σ"
        )


def _eigen(stiffness: Array, mass: Array) -> tuple[Array, Array]:
    """Return ω² and the vectors of M-norm 1.

    Most causes leave the masses alone, and then a plain problem is the faster one.
    """
    own = np.diag(mass)
    if np.count_nonzero(mass) == len(own):
        square, turned = np.linalg.eigh(stiffness / np.sqrt(np.outer(own, own)))
        return square, turned / np.sqrt(own)[:, None]
    square, vectors = eigh(stiffness, mass, check_finite=False)
    return np.asarray(square), np.asarray(vectors)


def _squares(stiffness: Array, mass: Array) -> tuple[Array, Array]:
    """Return ω² alone, and no vectors (n, 0).

    What has no labels goes by rank, and the vectors cost twice as much as the squares.
    """
    root = np.sqrt(np.diag(mass))
    none = np.empty((len(root), 0))
    scaled = np.outer(root, root)
    if np.count_nonzero(mass) == len(root):
        return np.linalg.eigvalsh(stiffness / scaled), none
    return np.asarray(eigh(stiffness, mass, eigvals_only=True, check_finite=False)), none


def _ranks(frequency: Array) -> NDArray[np.int64]:
    """The rank of each, from 0."""
    order = np.empty(len(frequency), dtype=np.int64)
    order[np.argsort(frequency, kind="stable")] = np.arange(len(frequency))
    return order
