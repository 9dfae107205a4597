"""Several measurements of one device at once: what is physically one is one parameter.

Film and stage are the same for all of a file, so effects on them have one set of parameters, as far
as measurements count them in the same unit; each driven mode and each decay has its own. What
belongs to detector and laser has one for each kind of measurement and wavelength. Of the base
models, maps of one mode at one drive share the amplitude of the motion in metres, and sweeps of one
mode its linewidth and its response to the drive. Frequencies are not tied to each other: a film
drifts from one measurement to the next.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison
from femnl.core.effect import Effect, Kind, ParameterSpec, Values
from femnl.core.numbers import scale_for, with_error
from femnl.core.readout import Array
from femnl.fits.least_squares import FitResult, fit
from femnl.observe.extended import ExtendedModel
from femnl.observe.map.model import MapModel
from femnl.observe.model import MeasurementModel, Named
from femnl.observe.noisy import without_noise
from femnl.observe.residuals import Ranked

Own = tuple[Sequence[Effect], Values, Sequence[Values]]
"""Effects, base parameters and those of each effect, as one measurement knows them."""

MEMORY = 8
"""Residuals of each measurement that are kept for when its parameters come again."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JointModel(MeasurementModel):
    """Residuals of all measurements of a file, one after the other.

    groups: the model of each measurement by name. names: of each, its base parameters' names here.
    originals: effects as their files state them, by name. places: of a parameter here that belongs
    to some measurements, (effect, name): its own name, and those measurements.
    """

    kind: Kind
    needs_global_search: bool
    jumps: tuple[str, ...]
    groups: Mapping[str, MeasurementModel]
    names: Mapping[str, Mapping[str, str]]
    originals: Mapping[str, Effect]
    places: Mapping[tuple[str, str], tuple[str, list[str]]]
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...]

    @cached_property
    def ranked(self) -> tuple[Ranked, ...]:
        """Those of each measurement, at their place among all residuals."""
        found = []
        begin = 0
        for group in self.groups.values():
            found += [replace(ranked, at=ranked.at + begin) for ranked in group.ranked]
            begin += len(group.blocks)
        return tuple(found)

    @property
    def variant(self) -> str:
        """Those of all measurements."""
        return repr({name: group.variant for name, group in self.groups.items()})

    @cached_property
    def _kept(self) -> dict[object, Array]:
        """Residuals of single measurements at the latest parameters."""
        return {}

    def can_show(self, effect: Effect) -> bool:
        """Whether any of the measurements can."""
        return any(group.can_show(effect) for group in self.groups.values())

    def seen_by(
        self, group: str, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> Own:
        """Return what the model of one measurement sees of all parameters."""
        kept = []
        numbers = []
        for effect, joint in zip(effects, values, strict=True):
            if self.groups[group].can_show(effect):
                places = [
                    (self.places.get((effect.name, name), (name, [group])), value)
                    for name, value in joint.items()
                ]
                kept.append(effect)
                numbers.append({name: value for (name, groups), value in places if group in groups})
        return kept, {name: base[joint] for name, joint in self.names[group].items()}, numbers

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Blocks of the same number in measurements of one kind are left out together."""
        first: dict[Kind, int] = {}
        found = []
        for base_model in self.groups.values():
            offset = first.setdefault(base_model.kind, 1000 * len(first))
            found.append(np.where(base_model.blocks >= 0, base_model.blocks + offset, -1))
        return np.concatenate(found)

    @property
    def quantity(self) -> tuple[Array, str]:
        """That of the first measurement, NaN for those of another unit."""
        found = [group.quantity for group in self.groups.values()]
        unit = found[0][1]
        return np.concatenate([s if u == unit else np.full_like(s, np.nan) for s, u in found]), unit

    def deviations(self, residuals: Array) -> Array:
        """Return those of each measurement."""
        ends = np.cumsum([len(base_model.blocks) for base_model in self.groups.values()])
        parts = np.split(residuals, ends[:-1], axis=-1)
        rows = zip(self.groups.values(), parts, strict=True)
        return np.concatenate([group.deviations(part) for group, part in rows], axis=-1)

    def locate(self, residual: int) -> str:
        """Name the measurement and its datum."""
        begin = 0
        for group, base_model in self.groups.items():
            if residual < begin + len(base_model.blocks):
                return f"{group}: {base_model.locate(residual - begin)}"
            begin += len(base_model.blocks)
        raise IndexError(residual)

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return the residuals of all measurements, one after the other."""
        found = []
        for group, base_model in self.groups.items():
            kept, own, numbers = self.seen_by(group, effects, base, values)
            # A tangent moves one parameter, so that most measurements stand as they were.
            key = (
                group,
                tuple(kept),
                tuple(own.values()),
                tuple(tuple(n.values()) for n in numbers),
            )
            if key not in self._kept:
                self._kept[key] = base_model.residuals(kept, own, numbers)
                if len(self._kept) > MEMORY * len(self.groups):
                    del self._kept[next(iter(self._kept))]
            found.append(self._kept[key])
        return np.concatenate(found)

    def _spread(self, group: str, rows: dict[str, Array]) -> dict[str, Array]:
        """Set directions of one measurement among zeros for the others."""
        sizes = {g: len(base_model.blocks) for g, base_model in self.groups.items()}
        return {
            f"{group}: {name}": np.concatenate(
                [row if g == group else np.zeros(n) for g, n in sizes.items()]
            )
            for name, row in rows.items()
        }

    def _of_each(
        self, rows: Callable[[MeasurementModel, Own], dict[str, Array]], seen: Own
    ) -> dict[str, Array]:
        """Return directions of every measurement, given the effects and values of all."""
        found: dict[str, Array] = {}
        for group, base_model in self.groups.items():
            found |= self._spread(group, rows(base_model, self.seen_by(group, *seen)))
        return found

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return those of each measurement."""
        return self._of_each(
            lambda one, own: one.residual_directions(*own), (effects, base, values)
        )

    def smooth_deviations(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return those of each measurement."""
        seen = (effects, base, values)
        return self._of_each(lambda one, own: one.smooth_deviations(*own), seen)

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return those of each measurement."""
        found: dict[str, Array] = {}
        for group, base_model in self.groups.items():
            own = self.seen_by(group, effects, base, values)
            found |= {
                f"{phrase} (as in {group})": row
                for phrase, row in base_model.candidate_measurements(*own).items()
            }
        return found

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Return equivalent solutions of all measurements together, as far as each has some.

        One map's motion may also be the other way round. What the electronics add to the phase of
        the motion under each laser is not known, so that phases do not tell whether two maps show
        the film on the same side. Causes that act differently upwards and downwards do tell.
        """
        found = []
        bare_groups = {name: without_noise(group) for name, group in self.groups.items()}
        maps = [(group, bare) for group, bare in bare_groups.items() if isinstance(bare, MapModel)]
        for group, turning in maps[1:]:
            plain = {name: base[joint] for name, joint in self.names[group].items()}
            found.append(
                base
                | {self.names[group][name]: value for name, value in turning.turned(plain).items()}
            )
        own = {
            g: p.equivalent_solutions({name: base[joint] for name, joint in self.names[g].items()})
            for g, p in self.groups.items()
        }
        for k in range(max(map(len, own.values()))):
            other = dict(base)
            for group, alike in own.items():
                if k < len(alike):
                    other |= {self.names[group][name]: value for name, value in alike[k].items()}
            found.append(other)
        return found

    def ruled_out(self, library: Iterable[Effect]) -> tuple[str, ...]:
        """Return those of every measurement, after its name."""
        effects = list(library)
        found: list[str] = []
        for name, group in self.groups.items():
            found += [f"{name}: {sentence}" for sentence in group.ruled_out(effects)]
        return tuple(found)

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Return those of each measurement, by its name."""
        found = []
        for group, base_model in self.groups.items():
            own = [
                (name, *self.seen_by(group, effects, base, values))
                for name, effects, base, values in models
            ]
            found += [
                replace(shown, title=f"{group}: {shown.title}") for shown in base_model.compare(own)
            ]
        return tuple(found)

    def systematic(self, unit: str) -> float:
        """Return the largest of any measurement."""
        return max(base_model.systematic(unit) for base_model in self.groups.values())

    def describe(self, residuals: Array) -> str:
        """Say where the measurement that deviates most does so."""
        ends = np.cumsum([len(base_model.blocks) for base_model in self.groups.values()])
        parts = dict(zip(self.groups, np.split(residuals, ends[:-1]), strict=True))
        rms = {group: float(np.sqrt(np.mean(part**2))) for group, part in parts.items()}
        worst = max(rms, key=lambda group: rms[group])
        table = ", ".join(f"{group}: {value:.2f}σ" for group, value in rms.items())
        return (
            f"in {worst}, {self.groups[worst].describe(parts[worst])} (rms by measurement {table})"
        )

    def bought(self, result: FitResult) -> tuple[str, ...]:
        """Say what the joint fit and each measurement alone know of each shared parameter."""
        base, values = result.model.split(result.vector)
        alone = {}
        for group, base_model in self.groups.items():
            acting, own, numbers = self.seen_by(group, result.model.effects, base, values)
            originals = [self.originals[effect.name] for effect in acting]
            model = ExtendedModel(base_model, tuple(base_model.usable_effects(originals)))
            alone[group] = fit(model, model.pack(own, numbers), checkpoint=result.checkpoint)
        notes = []
        for k, (owner, spec) in enumerate(result.model.parameters):
            values_alone = []
            for group, single in alone.items():
                names = [
                    (o, self._joint_name(group, o, n.name)) for o, n in single.model.parameters
                ]
                if (owner, spec.name) in names:
                    i = names.index((owner, spec.name))
                    values_alone.append((group, _number(single, i)))
            if len(values_alone) > 1:
                name = spec.name if owner == "base" else f"{owner}.{spec.name}"
                told = [_number(result, k), *(number for _, number in values_alone)]
                largest = max(max(abs(value), 10 * sd) for value, sd in told)
                scale = scale_for(largest, spec.unit)
                whole, *parts = (
                    with_error(value / scale.size, sd / scale.size, 2) for value, sd in told
                )
                groups = [group for group, _ in values_alone]
                listed = ", ".join(map(" ".join, zip(groups, parts, strict=True)))
                notes.append(f"joint: {name} {whole} {scale.unit}".rstrip() + f"; alone {listed}")
        return tuple(notes) or (
            "joint: the measurements have no parameter in common, so each is judged by itself",
        )

    def _joint_name(self, group: str, owner: str, name: str) -> str:
        """Return the name here of a parameter that one measurement knows by a name of its own."""
        if owner == "base":
            return self.names[group][name]
        for (effect, joint), (own, groups) in self.places.items():
            if (effect, own) == (owner, name) and group in groups:
                return joint
        return name


def _number(result: FitResult, which: int) -> tuple[float, float]:
    """Return a parameter of a fit with its standard deviation."""
    return float(result.vector[which]), float(np.sqrt(result.covariance[which, which]))
