"""Which parameters the measurements of a file share, and the joint model that follows."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import Effect, ParameterSpec
from femnl.core.readout import Array
from femnl.diagnose.joint import JointModel
from femnl.fits.least_squares import fit
from femnl.observe.extended import ExtendedModel
from femnl.observe.map.model import MapModel
from femnl.observe.model import MeasurementModel
from femnl.observe.noisy import without_noise
from femnl.observe.response.model import ResponseModel

Groups = Mapping[str, MeasurementModel]
Places = dict[tuple[str, str], tuple[str, list[str]]]

ROUGH = 6
"""Evaluations that each start of a shared parameter gets."""
DIFFERENT = 1e-3
"""Relative difference of shared parameters from which on each measurement's own value is tried as
the start of all.
"""


@dataclass
class _Adapted:
    """Effects with the parameters that they have in a joint model, and what these stand for."""

    effects: list[Effect]
    originals: dict[str, Effect]
    places: Places
    scales: dict[str, float]


def pose_joint(
    groups: Groups,
    library: Iterable[Effect],
    backwards: bool = False,
    checkpoint: Checkpoint | None = None,
) -> tuple[JointModel, list[Effect]]:
    """Return the model of all measurements of a file, and the effects that can show in it.

    Parameters of one measurement are named "measurement.parameter". Effects on film and stage have
    one set of parameters for all measurements that count them in the same unit, but one for each
    mode that is driven and for each decay; those of a laser have one for each kind of measurement
    and wavelength.

    Args: groups: the model of each measurement by name. library: effects. backwards: whether all
    other maps start in antiphase to the first, which an asymmetric fringe can tell. checkpoint:
    keeps the fits that find the start.
    """
    names = {group: _named(groups, group) for group in groups}
    base, starts = _merged(groups, names, backwards)
    adapted = _adapted(groups, names, library)
    jumps = [names[name][spec] for name, group in groups.items() for spec in group.jumps]
    model = JointModel(
        kind=next(iter(groups.values())).kind,
        needs_global_search=any(group.needs_global_search for group in groups.values()),
        jumps=tuple(dict.fromkeys(jumps)),
        groups=groups,
        names=names,
        originals=adapted.originals,
        places=adapted.places,
        base=base,
        start=np.array([np.mean(starts[spec.name]) for spec in base]),
        scales=adapted.scales,
        notes=tuple(f"{name}: {note}" for name, group in groups.items() for note in group.notes),
    )
    return replace(model, start=_best_start(model, starts, checkpoint)), adapted.effects


def _named(groups: Groups, group: str) -> dict[str, str]:
    """Name the base parameters of a measurement; shared ones keep their plain name."""
    base_model = groups[group]
    own = _shareable(base_model)
    names = {spec.name: f"{group}.{spec.name}" for spec in base_model.base}
    for name, condition in own.items():
        sharing = [g for g, other in groups.items() if _shareable(other).get(name) == condition]
        conditions = {
            _shareable(other)[name] for other in groups.values() if name in _shareable(other)
        }
        if len(sharing) > 1:
            names[name] = name if len(conditions) == 1 else f"{'+'.join(sharing)}.{name}"
    return names


def _merged(
    groups: Groups, names: Mapping[str, Mapping[str, str]], backwards: bool
) -> tuple[tuple[ParameterSpec, ...], dict[str, list[float]]]:
    """Return the base parameters of all measurements, and each measurement's start of them.

    A shared parameter has the widest range of any measurement.
    """
    first = next(iter(groups.values()))
    merged: dict[str, ParameterSpec] = {}
    starts: dict[str, list[float]] = {}
    for group, base_model in groups.items():
        begun = _aligned(base_model, first, backwards)
        for spec, value in zip(base_model.base, begun, strict=True):
            name = names[group][spec.name]
            known = merged.get(name, spec)
            merged[name] = replace(
                spec, name=name, low=min(spec.low, known.low), high=max(spec.high, known.high)
            )
            starts.setdefault(name, []).append(float(value))
    return tuple(merged.values()), starts


def _best_start(
    model: JointModel, starts: dict[str, list[float]], checkpoint: Checkpoint | None
) -> Array:
    """Start shared parameters at the value of the measurement from which all are met best."""
    most = max(len(values) for values in starts.values())
    if all(np.ptp(values) <= DIFFERENT * abs(np.mean(values)) for values in starts.values()):
        return model.start
    tried = [
        np.array([starts[k.name][min(i, len(starts[k.name]) - 1)] for k in model.base])
        for i in range(most)
    ]
    fits = [fit(ExtendedModel(model), start, most=ROUGH, checkpoint=checkpoint) for start in tried]
    return min(fits, key=lambda s: s.chi2).vector


def _adapted(
    groups: Groups, names: Mapping[str, Mapping[str, str]], library: Iterable[Effect]
) -> _Adapted:
    """Return the effects that can show in any of the measurements, with their parameters here."""
    found = _Adapted([], {}, {}, _largest_scales(groups, list(groups)))
    for effect in library:
        own = {
            name: one.parameters
            for name, group in groups.items()
            for one in group.usable_effects([effect])
        }
        if own:
            found.originals[effect.name] = effect
            gone = tuple(
                names[group][name]
                for group in own
                for name in effect.replaces
                if name in names[group]
            )
            specs = _parameters(groups, effect, own, found)
            found.effects.append(replace(effect, replaces=gone, parameters=specs))
    return found


def _parameters(
    groups: Groups,
    effect: Effect,
    own: Mapping[str, tuple[ParameterSpec, ...]],
    found: _Adapted,
) -> tuple[ParameterSpec, ...]:
    """Return the parameters of an effect on some measurements: one set for those that share it.

    Places and scales of such sets are added to what was found.

    Args: own: the parameters that each measurement that shows the effect gives it.
    """
    unlike: dict[str, set[object]] = {}  # modes or decays, by kind
    for group in own:
        unlike.setdefault(groups[group].kind, set()).add(groups[group].common)
    sets: dict[object, list[str]] = {}
    for group, specs in own.items():
        one = groups[group]
        laser = (one.kind, one.scales.get("wavelength"))
        film = one.common if len(unlike[one.kind]) > 1 else None
        sets.setdefault((specs, film if effect.shared else laser), []).append(group)
    merged = []
    for members in sets.values():
        label = "+".join(members) + "."
        found.scales |= _largest_scales(groups, members, label)
        for spec in own[members[0]]:
            name = label + spec.name if len(sets) > 1 else spec.name
            scale = label + spec.scale if spec.scale else ""
            merged.append(replace(spec, name=name, scale=scale))
            if len(sets) > 1:
                found.places[effect.name, name] = (spec.name, members)
    return tuple(merged)


def _largest_scales(groups: Groups, members: list[str], label: str = "") -> dict[str, float]:
    """Return the largest of each scale among some measurements, under a label."""
    found: dict[str, float] = {}
    for group in members:
        for name, value in groups[group].scales.items():
            found[label + name] = max(value, found.get(label + name, value))
    return found


def _shareable(base_model: MeasurementModel) -> dict[str, tuple[object, ...]]:
    """Return what other measurements may have in common with this one.

    Parameters, and what must agree for it.
    """
    bare = without_noise(base_model)
    if isinstance(bare, MapModel):
        return {"amplitude": ("map", bare.mode, bare.drive, bare.frequency)}
    if isinstance(bare, ResponseModel):
        return dict.fromkeys(("linewidth", "peak"), ("response", bare.mode))
    return {}


def _aligned(base_model: MeasurementModel, first: MeasurementModel, backwards: bool) -> Array:
    """Return the start with motion in phase with that of the first map.

    Under a cosine −θ and antiphase are the same.

    backwards: all of them in antiphase to that, which an asymmetric fringe can tell.
    """
    bare = without_noise(base_model)
    if not isinstance(bare, MapModel):
        return base_model.start
    own = dict(zip((spec.name for spec in base_model.base), base_model.start.tolist(), strict=True))
    phase = [spec.name for spec in base_model.base].index("motion_phase")
    reference = (
        first.start[phase] if isinstance(without_noise(first), MapModel) else own["motion_phase"]
    )
    if (np.cos(own["motion_phase"] - reference) < 0) != backwards:
        own |= bare.turned(own)
    return np.array(list(own.values()))
