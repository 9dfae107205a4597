"""Several measurements of one device at once: what is physically one is one parameter.

Film and stage are the same for all of a file, so effects on them have one set of parameters; what
belongs to detector and laser has one for each kind of measurement and wavelength. Of the base
models, maps of one mode at one drive share the amplitude of the motion in metres, and sweeps of one
mode its linewidth and its response to the drive. Frequencies are not tied to each other: a film
drifts from one measurement to the next.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison
from femnl.core.effect import Effect, Kind, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.least_squares import FitResult, fit
from femnl.diagnose.map import MapModel
from femnl.diagnose.response import ResponseModel
from femnl.observe.model import ExtendedModel, MeasurementModel, Named

Own = tuple[Sequence[Effect], Values, Sequence[Values]]
"""Effects, base parameters and those of each effect, as one measurement knows them."""

ROUGH = 6
"""Evaluations that each start of a shared parameter gets."""
MEMORY = 8
"""Residuals of each measurement that are kept for when its parameters come again."""
APART = 1e-3
"""Relative difference of shared parameters from which on each measurement's own value is tried as
the start of all.
"""


class JointModel:
    """Residuals of all measurements of a file, see `MeasurementModel`.

    Parameters of one of them are named "measurement.parameter".
    """

    def __init__(self, groups: Mapping[str, MeasurementModel], backwards: bool = False) -> None:
        self.groups = dict(groups)
        self.kind: Kind = next(iter(self.groups.values())).kind
        self.needs_global_search = any(group.needs_global_search for group in self.groups.values())
        self._names = {group: self._named(group) for group in self.groups}
        self.jumps = tuple(
            dict.fromkeys(
                self._names[name][spec]
                for name, group in self.groups.items()
                for spec in group.jumps
            )
        )
        self.independent_blocks: tuple[Mapping[str, NDArray[np.bool_]], ...] = ()
        begins = np.cumsum([0, *(len(base_model.blocks) for base_model in self.groups.values())])
        self.ranked = tuple(
            replace(ranked, at=ranked.at + begin)
            for begin, base_model in zip(begins[:-1], self.groups.values(), strict=True)
            for ranked in base_model.ranked
        )
        merged: dict[str, ParameterSpec] = {}
        starts: dict[str, list[float]] = {}
        for group, base_model in self.groups.items():
            own = dict(
                zip(
                    (spec.name for spec in base_model.base),
                    _aligned(base_model, next(iter(self.groups.values())), backwards),
                    strict=True,
                )
            )
            for spec in base_model.base:
                name = self._names[group][spec.name]
                known = merged.get(name, spec)
                merged[name] = replace(
                    spec, name=name, low=min(spec.low, known.low), high=max(spec.high, known.high)
                )
                starts.setdefault(name, []).append(own[spec.name])
        self.base = tuple(merged.values())
        self.scales: Mapping[str, float] = self._facts(list(self.groups))
        self.notes: tuple[str, ...] = tuple(
            f"{group}: {note}"
            for group, base_model in self.groups.items()
            for note in base_model.notes
        )
        self._originals: dict[str, Effect] = {}
        self._places: dict[tuple[str, str], tuple[str, list[str]]] = {}
        self._kept: dict[object, tuple[Sequence[Effect], Array]] = {}
        self.start = np.array([np.mean(starts[spec.name]) for spec in self.base])
        self.start = self._best_start(starts)

    def _named(self, group: str) -> dict[str, str]:
        """Name the base parameters of a measurement; shared ones keep their plain name."""
        base_model = self.groups[group]
        names = {spec.name: f"{group}.{spec.name}" for spec in base_model.base}
        for name in _shareable(base_model):
            alike = [
                g
                for g, other in self.groups.items()
                if _shareable(other).get(name) == _shareable(base_model)[name]
            ]
            sets = {
                _shareable(other)[name]
                for other in self.groups.values()
                if name in _shareable(other)
            }
            if len(alike) > 1:
                names[name] = name if len(sets) == 1 else f"{'+'.join(alike)}.{name}"
        return names

    def _facts(self, groups: list[str], label: str = "") -> dict[str, float]:
        """The largest of each fact among some measurements, under a label."""
        found: dict[str, float] = {}
        for name, value in (
            (n, v) for group in groups for n, v in self.groups[group].scales.items()
        ):
            found[label + name] = max(value, found.get(label + name, value))
        return found

    def _best_start(self, starts: dict[str, list[float]]) -> Array:
        """Start shared parameters at the value of the measurement from which all are met best."""
        most = max(len(values) for values in starts.values())
        if all(np.ptp(values) <= APART * abs(np.mean(values)) for values in starts.values()):
            return self.start
        tried = [
            np.array([starts[k.name][min(i, len(starts[k.name]) - 1)] for k in self.base])
            for i in range(most)
        ]
        return min(
            (fit(ExtendedModel(self), start, most=ROUGH) for start in tried), key=lambda s: s.chi2
        ).vector

    def pool(self, library: Iterable[Effect]) -> list[Effect]:
        """Return the effects that can show in any of the measurements, with parameters here."""
        found = []
        for effect in library:
            acting = [
                group for group, base_model in self.groups.items() if _acts(effect, base_model)
            ]
            if acting:
                self._originals[effect.name] = effect
                found.append(self._adapted(effect, acting))
        return found

    def _adapted(self, effect: Effect, acting: list[str]) -> Effect:
        gone = tuple(
            self._names[g][name]
            for g in acting
            for name in effect.replaces
            if name in self._names[g]
        )
        lasers: dict[object, list[str]] = {}
        for group in acting:
            lasers.setdefault(
                (self.groups[group].kind, self.groups[group].scales.get("wavelength")), []
            ).append(group)
        if effect.shared or len(lasers) == 1:
            return replace(effect, replaces=gone)
        specs = []
        for groups in lasers.values():
            label = "+".join(groups) + "."
            self.scales = {**self.scales, **self._facts(groups, label)}
            specs += [
                replace(k, name=label + k.name, scale=label + k.scale if k.scale else "")
                for k in effect.parameters
            ]
            self._places |= {
                (effect.name, label + k.name): (k.name, groups) for k in effect.parameters
            }
        return replace(effect, replaces=gone, parameters=tuple(specs))

    def _own(
        self, group: str, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> Own:
        """Return what the model of one measurement sees of all parameters."""
        kept = []
        numbers = []
        for effect, joint in zip(effects, values, strict=True):
            if _acts(effect, self.groups[group]):
                places = [
                    (self._places.get((effect.name, name), (name, [group])), value)
                    for name, value in joint.items()
                ]
                kept.append(effect)
                numbers.append({name: value for (name, groups), value in places if group in groups})
        return kept, {name: base[joint] for name, joint in self._names[group].items()}, numbers

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Blocks of the same number in measurements of one kind are left out together."""
        first: dict[Kind, int] = {}
        found = []
        for base_model in self.groups.values():
            offset = first.setdefault(base_model.kind, 1000 * len(first))
            found.append(np.where(base_model.blocks >= 0, base_model.blocks + offset, -1))
        return np.concatenate(found)

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return the residuals of all measurements, one after the other."""
        found = []
        for group, base_model in self.groups.items():
            kept, own, numbers = self._own(group, effects, base, values)
            # A tangent moves one parameter, so that most measurements stand as they were.
            key = (
                group,
                tuple(map(id, kept)),
                tuple(own.values()),
                tuple(tuple(n.values()) for n in numbers),
            )
            if key not in self._kept:
                self._kept[key] = kept, base_model.residuals(kept, own, numbers)
                if len(self._kept) > MEMORY * len(self.groups):
                    del self._kept[next(iter(self._kept))]
            found.append(self._kept[key][1])
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

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Those of each measurement."""
        found: dict[str, Array] = {}
        for group, base_model in self.groups.items():
            own = self._own(group, effects, base, values)
            found |= self._spread(group, base_model.residual_directions(*own))
        return found

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Those of each measurement."""
        found: dict[str, Array] = {}
        for group, base_model in self.groups.items():
            own = self._own(group, effects, base, values)
            found |= {
                f"{phrase} (as in {group})": row
                for phrase, row in base_model.candidate_measurements(*own).items()
            }
        return found

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Those of all measurements together, as far as each of them has some.

        And one map's motion the other way round.

        What the electronics add to the phase of the motion under each laser is not known, so that
        phases do not tell whether two maps show the film on the same side; causes that know up from
        down do.
        """
        found = []
        maps = [
            (group, base_model)
            for group, base_model in self.groups.items()
            if isinstance(base_model, MapModel)
        ]
        for group, turning in maps[1:]:
            plain = {name: base[joint] for name, joint in self._names[group].items()}
            found.append(
                base
                | {self._names[group][name]: value for name, value in turning.turned(plain).items()}
            )
        own = {
            g: p.equivalent_solutions({name: base[joint] for name, joint in self._names[g].items()})
            for g, p in self.groups.items()
        }
        for k in range(max(map(len, own.values()))):
            other = dict(base)
            for group, alike in own.items():
                if k < len(alike):
                    other |= {self._names[group][name]: value for name, value in alike[k].items()}
            found.append(other)
        return found

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Those of each measurement, by its name."""
        found = []
        for group, base_model in self.groups.items():
            own = [
                (name, *self._own(group, effects, base, values))
                for name, effects, base, values in models
            ]
            found += [
                replace(shown, title=f"{group}: {shown.title}") for shown in base_model.compare(own)
            ]
        return tuple(found)

    def systematic(self, unit: str) -> float:
        """The largest of any measurement."""
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
            acting, own, numbers = self._own(group, result.model.effects, base, values)
            model = ExtendedModel(
                base_model, tuple(self._originals[effect.name] for effect in acting)
            )
            alone[group] = fit(model, model.pack(own, numbers))
        notes = []
        for k, (owner, spec) in enumerate(result.model.parameters):
            told = []
            for group, single in alone.items():
                names = [
                    (o, self._names[group][n.name] if o == "base" else n.name)
                    for o, n in single.model.parameters
                ]
                if (owner, spec.name) in names:
                    i = names.index((owner, spec.name))
                    told.append(
                        f"{group} {single.vector[i]:.6g} ± {np.sqrt(single.covariance[i, i]):.2g}"
                    )
            if len(told) > 1:
                name = spec.name if owner == "base" else f"{owner}.{spec.name}"
                value = (
                    f"{result.vector[k]:.6g} ± {np.sqrt(result.covariance[k, k]):.2g} {spec.unit}"
                )
                notes.append(f"joint: {name} {value}; alone {', '.join(told)}")
        return tuple(notes) or (
            "joint: the measurements have no parameter in common, so each is judged by itself",
        )


def _acts(effect: Effect, base_model: MeasurementModel) -> bool:
    return base_model.kind in effect.kinds and all(
        fact in base_model.scales for fact in effect.needs
    )


def _shareable(base_model: MeasurementModel) -> dict[str, tuple[object, ...]]:
    """What other measurements may have in common with this one.

    Parameters, and what must agree for it.
    """
    if isinstance(base_model, MapModel):
        return {"amplitude": ("map", base_model.mode, base_model.drive, base_model.frequency)}
    if isinstance(base_model, ResponseModel):
        return dict.fromkeys(("linewidth", "peak"), ("response", base_model.mode))
    return {}


def _aligned(base_model: MeasurementModel, first: MeasurementModel, backwards: bool) -> Array:
    """Return the start with motion in phase with that of the first map.

    Under a cosine −θ and antiphase are the same.

    backwards: all of them in antiphase to that, which an asymmetric fringe can tell.
    """
    if not isinstance(base_model, MapModel):
        return base_model.start
    own = dict(zip((spec.name for spec in base_model.base), base_model.start.tolist(), strict=True))
    phase = [spec.name for spec in base_model.base].index("motion_phase")
    reference = first.start[phase] if isinstance(first, MapModel) else own["motion_phase"]
    if (np.cos(own["motion_phase"] - reference) < 0) != backwards:
        own |= base_model.turned(own)
    return np.array(list(own.values()))
