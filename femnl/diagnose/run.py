"""From a measurement file to a diagnosis."""

import hashlib
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from femnl.core.checkpoint import Checkpoint, remembered
from femnl.core.comparison import Comparison
from femnl.core.device import Model
from femnl.core.diagnosis import (
    Alternative,
    Bound,
    Diagnosis,
    FreeForm,
    Quality,
    Trial,
)
from femnl.core.effect import Effect
from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import Parameter
from femnl.core.kinds import function, kind_of
from femnl.core.processes import one_blas_thread
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.freeform import free_forms
from femnl.diagnose.joint import JointModel
from femnl.diagnose.measure_next import measure_next
from femnl.diagnose.noise_of_file import (
    Noise,
    first_noise,
    last_noise,
    told_glitches,
    told_noise,
)
from femnl.diagnose.pose_joint import pose_joint
from femnl.diagnose.search import refitted, search
from femnl.diagnose.sent import Sent, considered, received, sent
from femnl.diagnose.shares import remainder, shares
from femnl.diagnose.verdict import NOISE_IS_LARGER, Judgement, judge
from femnl.diagnose.worker_pool import Pose, Posed, Run, worker_pool
from femnl.effects import fingerprint
from femnl.fits.least_squares import FitResult
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import MeasurementModel, Named
from femnl.observe.noisy import FoundNoise, with_noise
from femnl.pipeline import measured_device

SEARCHES = 3
"""Searches at most: where the best set of causes shows other noise than was known, causes are
sought again with that.
"""
SHOWN = 1e-6
"""Probability below which alternatives are not listed."""


def diagnose(
    path: str | Path,
    geometry: str | None = None,
    effects: Iterable[Effect] | None = None,
    workers: int = 1,
) -> Diagnosis:
    """Say whether the simulation explains a measurement, and if not, which physical cause does.

    Args:
        path: a measurement file, version 1.x.
        geometry: name or path of a geometry to use instead of the file's own; a record of drive and
            output needs none.
        effects: the causes to consider; the whole library unless given.
        workers: processes that fit side by side, this one among them. A script that asks for more
            than one keeps what it runs under `if __name__ == "__main__"`, and effects of its own in
            a module, or in a folder that `femnl.effects.from_folder` reads.

    Returns: the diagnosis, see docs/reference/diagnosis-json.md; the same whatever the workers.
    Raises: MeasurementError, GeometryError, ConvergenceError, ParameterError.
    Valid: noise normal, of the standard deviation that the file states or the data show. Fits are
        kept in the user's cache until all are done: the same call after an interruption goes on
        where it stopped.
    """
    if workers < 1:
        raise ParameterError(f"workers: {workers} is none; give a whole number of at least 1")
    path = Path(path)
    tree, model = _opened(path, geometry)
    pool = considered(effects)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    # Thousands of matrices of a few dozen rows: threads gain nothing there, and beside other work
    # they wait for each other.
    with (
        remembered(digest, model, fingerprint(pool)) as checkpoint,
        one_blas_thread(),
        ExitStack() as helpers,
    ):
        posing = partial(_posed, path, geometry, sent(pool, workers))
        noise = _first_noise(posing, checkpoint)
        found: list[Candidate] = []
        for left in reversed(range(SEARCHES)):
            searching = _Searching(
                partial(posing, noise=noise), workers, helpers, checkpoint, noise
            )
            found, run = searching.searched(found)
            best = max(found, key=lambda candidate: candidate.weight)
            seen = last_noise(best.result, noise)
            if seen == noise or not left:
                break
            noise = seen
            helpers.close()  # they posed the model with other noise
        concluded = conclude(
            str(path), digest, found, (*tree.attrs.get("repairs", ()), *_notes(found)), run
        )
        larger = concluded.rule == NOISE_IS_LARGER
        factor = found[0].factor if larger else 1.0
        noisy = replace(
            concluded,
            excluded=told_glitches(best.result, noise),
            noise=told_noise(best.result, noise, factor),
        )
    return replace(noisy, geometry=geometry)


def _notes(found: list[Candidate]) -> tuple[str, ...]:
    return found[0].result.model.base_model.notes


def _first_noise(posing: Callable[..., Posed], checkpoint: Checkpoint) -> Noise:
    """Return the noise of each measurement before causes are sought."""
    model, effects = posing(checkpoint)
    if isinstance(model, JointModel):
        return {
            name: first_noise(group, group.usable_effects(effects), checkpoint)
            for name, group in model.groups.items()
        }
    return {"": first_noise(model, effects, checkpoint)}


def _opened(path: Path, geometry: str | None) -> tuple[xr.DataTree, Model | None]:
    """Read a measurement, and the device that it is of; a record of an oscillator needs none."""
    tree = measurement.read(path)
    groups = [node.to_dataset() for node in tree.children.values()]
    bare = (
        geometry is None
        and tree.attrs.keys().isdisjoint(("model", "geometry"))
        and not any(kind_of(group).needs_device for group in groups)
    )
    return tree, None if bare else measured_device(tree.attrs, path, geometry)


def _posed(
    path: Path,
    geometry: str | None,
    chosen: list[Sent],
    checkpoint: Checkpoint | None,
    *,
    noise: Noise | None = None,
    backwards: bool = False,
) -> Posed:
    """Return the model that a file poses, and the effects that may explain its deviations.

    chosen: effects, as `sent` returns them. noise: what was found of it, by measurement; a single
    one has no name. backwards: see `pose_joint`.
    """
    effects = [received(effect) for effect in chosen]
    tree, model = _opened(path, geometry)
    found = noise or {}
    single = len(tree.children) == 1
    groups = {}
    for name, node in tree.children.items():
        bare = pose(name, node.to_dataset(), model, checkpoint)
        groups[name] = with_noise(bare, found.get("" if single else name, FoundNoise()))
    if len(groups) > 1:
        return pose_joint(groups, effects, backwards, checkpoint)
    (only,) = groups.values()
    return only, only.usable_effects(effects)


@dataclass(frozen=True)
class _Searching:
    """The search for causes of one measurement, or of several jointly.

    pose: poses the model and its effects. workers: processes that fit; helpers: ends them.
    noise: that the model has.
    """

    pose: Callable[..., Posed]
    workers: int
    helpers: ExitStack
    checkpoint: Checkpoint
    noise: Noise

    def searched(self, earlier: list[Candidate]) -> tuple[list[Candidate], Run]:
        """Fit what may explain the data.

        Args: earlier: what was found under another noise, if anything; where the best of it
            explains the data, it is fitted again and nothing is sought.
        Returns: what was fitted, and what does further jobs of that problem.
        """
        found, run = self._sought(self.pose, earlier)
        base_model = found[0].result.model.base_model
        if (
            not isinstance(base_model, JointModel)
            or any(candidate.viable for candidate in found)
            or "wavelength" not in base_model.scales
        ):
            return found, run
        # Which way the film moves at a phase of the drive is not known, and two wavelengths
        # together tell it.
        other = self._sought(partial(self.pose, backwards=True), [])
        return max(((found, run), other), key=lambda one: max(c.weight for c in one[0]))

    def _sought(self, pose: Pose, earlier: list[Candidate]) -> tuple[list[Candidate], Run]:
        mine = self.helpers.enter_context(worker_pool(pose, self.workers, self.checkpoint))
        model, library = mine.posed()
        if earlier and max(earlier, key=lambda c: c.weight).viable:
            return refitted(model, library, earlier, mine.run), mine.run
        if earlier:  # cut short once, so that this one begins with the noise that it showed
            return search(model, library, mine.run, self.checkpoint), mine.run
        return search(model, library, mine.run, self.checkpoint, self._differs), mine.run

    def _differs(self, result: FitResult) -> bool:
        """Whether what a fit leaves shows other noise than the model has."""
        return last_noise(result, self.noise) != self.noise


def pose(
    name: str, dataset: xr.Dataset, model: Model | None, checkpoint: Checkpoint | None = None
) -> MeasurementModel:
    """Return the model of a group of a measurement file, by its kind.

    Args: name: of the group. model: the device, None where no kind needs one. checkpoint: keeps the
    fits that this takes.
    Raises: MeasurementError for a kind that needs a device where there is none.
    """
    spec = kind_of(dataset)
    film = None if model is None else SimulatedFilm(model, spec.modes(dataset))
    if film is None and spec.needs_device:
        raise MeasurementError(f"{name}: a {spec.name} needs a device; give it with --geometry")
    posed: MeasurementModel = function(spec.pose)(dataset, film, checkpoint)
    return posed


def conclude(
    file: str, digest: str, found: list[Candidate], notes: tuple[str, ...], run: Run
) -> Diagnosis:
    """Weigh what was fitted and put the verdict together."""
    judged = judge(found)
    base = found[0]
    best = judged.chosen
    share = judged.share
    before = _quality(base)
    after = before if best is base else _quality(best)
    base_model = best.result.model.base_model
    joint = base_model.bought(best.result) if isinstance(base_model, JointModel) else ()
    listed = [*((best,) if judged.verdict == "ambiguous" else ()), *judged.rivals]
    # Where nothing explains the data, nothing is an alternative; the trials tell what was tried
    if judged.verdict != "unexplained":
        listed += [
            c
            for c in sorted(found[1:], key=lambda c: -c.weight)
            if c not in listed and c is not best and share.get(c.names, 0.0) > SHOWN
        ]
    plausible = base.p_value_scaled if judged.noisier else base.p_value
    probability = {"adequate": plausible, "unexplained": 1 - base.p_value}.get(
        judged.verdict, share.get(best.names, 0.0)
    )
    left = best if judged.verdict == "explained in part" else base
    described = judged.verdict in ("explained in part", "unexplained")
    forms = free_forms(left.result, run) if described else ()
    return Diagnosis(
        file=file,
        sha256=digest,
        verdict=judged.verdict,
        causes=best.names,
        probability=float(probability),
        parameters=_parameters(best, judged.inflation),
        alternatives=tuple(Alternative(c.names, share.get(c.names, 0.0)) for c in listed),
        p_value=base.p_value,
        where=_where(base, judged)
        + (_described(forms, before) if judged.verdict == "unexplained" else ""),
        before=before,
        after=after,
        measure_next=measure_next(judged, found),
        base_parameters=_parameters(base)["base"],
        trials=tuple(
            Trial(c.names, c.result.chi2, c.weight - base.weight, c.p_value, _against(c))
            for c in found
        ),
        notes=(*notes, *joint),
        sentences=tuple(effect.sentence for effect in best.result.model.effects),
        comparisons=_compare(base, best),
        free_forms=forms,
        rule=judged.rule,
        bounds=_bounds(best),
        shares=shares(best, found, run),
        remainder=remainder(best, base, forms) if best.names else None,
    )


def _compare(base: Candidate, best: Candidate) -> tuple[Comparison, ...]:
    """Compare the data with the base model and with the one that the verdict rests on."""
    models = [_named(base, "base model")]
    models += [_named(best, " + ".join(best.names))] if best is not base else []
    return base.result.model.base_model.compare(models)


def _named(candidate: Candidate, name: str) -> Named:
    model = candidate.result.model
    return name, model.effects, *model.split(candidate.result.vector)


def _described(forms: tuple[FreeForm, ...], before: Quality) -> str:
    """Say which free form predicts held-out data best, if any does better than the base."""
    if not forms:
        return ""
    best = forms[0].quality.heldout_chi2_reduced
    if best >= before.heldout_chi2_reduced:
        return "; no extension of free form predicts data that it did not see"
    return (
        f"; {forms[0].sentence} predicts unseen data best (held-out χ² per datum "
        f"{before.heldout_chi2_reduced:.3g} → {best:.3g})"
    )


def _quality(candidate: Candidate) -> Quality:
    return Quality(
        candidate.result.chi2 / candidate.result.degrees,
        candidate.result.cross_validation.chi2_reduced,
    )


def _against(candidate: Candidate) -> tuple[str, ...]:
    reasons = [f"{name} ends at a bound" for name in candidate.result.stuck]
    if 0 < candidate.p_value < 1e-3 or candidate.p_value == 0:
        reasons.append(f"leaves a misfit ({candidate.worst})")
    return tuple(reasons)


def _where(base: Candidate, judged: Judgement) -> str:
    if judged.noisier:
        return (
            f"the data scatter {base.factor:.3g} times as much as their stated standard deviation; "
            "no deviation beyond such noise"
        )
    if judged.verdict == "adequate":
        return "no deviation from the base model beyond noise"
    return (
        f"{base.result.model.base_model.describe(base.result.residuals)}; most telling: "
        f"{base.worst}"
    )


def _parameters(candidate: Candidate, inflation: float = 1.0) -> dict[str, dict[str, Parameter]]:
    """Return values and standard deviations by owner and name, the latter larger by a factor."""
    sd = inflation * np.sqrt(np.diag(candidate.result.covariance))
    found: dict[str, dict[str, Parameter]] = {"base": {}}
    for (owner, spec), value, s in zip(
        candidate.result.model.parameters, candidate.result.vector, sd, strict=True
    ):
        common = abs(value) * candidate.result.model.base_model.systematic(spec.unit)
        number, spread = (np.rint(value), 0.0) if spec.whole else (value, np.hypot(s, common))
        found.setdefault(owner, {})[spec.name] = Parameter(
            spec.name, float(number), float(spread), spec.unit
        )
    return found


def _bounds(candidate: Candidate) -> tuple[Bound, ...]:
    model = candidate.result.model
    return tuple(
        Bound(owner, spec.name, float(low), float(high), spec.unit, spec.reason)
        for (owner, spec), low, high in zip(model.parameters, *model.bounds, strict=True)
        if owner != "base"
    )
