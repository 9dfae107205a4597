"""From fitted sets of causes to a diagnosis: the verdict, and all that it tells."""

import numpy as np

from femnl.core.comparison import Comparison
from femnl.core.diagnosis import (
    Alternative,
    Bound,
    Cause,
    Covariance,
    Diagnosis,
    FreeForm,
    Quality,
    Rival,
    Trial,
)
from femnl.core.effect import Effect
from femnl.core.fit import Parameter
from femnl.core.numbers import plain
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.contributions import contributions
from femnl.diagnose.equation_errors import equation_sd
from femnl.diagnose.freeform import free_forms
from femnl.diagnose.joint import JointModel
from femnl.diagnose.measure_next import measure_next
from femnl.diagnose.shares import remainder, shares
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.verdict import SPEAKS_AGAINST, Judgement, judge
from femnl.diagnose.worker_pool import Run
from femnl.observe.model import Named

SHOWN = 1e-6
"""Probability below which alternatives are not listed."""


def conclude(
    file: str,
    digest: str,
    found: list[Candidate],
    notes: tuple[str, ...],
    run: Run,
    considered: frozenset[str],
) -> Diagnosis:
    """Weigh what was fitted and put the verdict together.

    Args: file, digest: of the measurement. found: what was fitted, the base model first. notes:
        of the model and its effects. run: does what does not wait for each other. considered: names
        of the effects that were, or that the device cannot have.
    """
    judged = judge(found, run, considered)
    base = found[0]
    best = judged.chosen
    share = judged.share
    before = _quality(base)
    after = before if best is base else _quality(best)
    base_model = best.result.model.base_model
    joint = base_model.bought(best.result) if isinstance(base_model, JointModel) else ()
    listed = _alternatives(judged, found)
    left = best if judged.verdict == "explained in part" else base
    described = judged.verdict in ("explained in part", "unexplained")
    closest = _closest(found) if judged.verdict == "unexplained" else None
    forms = free_forms(left.result, run) if described else ()
    return Diagnosis(
        file=file,
        sha256=digest,
        verdict=judged.verdict,
        causes=best.names,
        probability=_probability(judged, base),
        parameters=_parameters(best, base, judged.inflation),
        alternatives=tuple(Alternative(c.names, share.get(c.names, 0.0)) for c in listed),
        p_value=base.p_value,
        where=_where(base, judged)
        + (_described(forms, before) if judged.verdict == "unexplained" else ""),
        before=before,
        after=after,
        measure_next=measure_next(judged, found),
        base_parameters=_parameters(base, base)["base"],
        trials=tuple(
            Trial(
                c.names,
                c.result.chi2,
                c.weight - base.weight,
                c.p_value,
                _against(c, found, judged),
            )
            for c in found
        ),
        notes=(*notes, *joint),
        sentences=tuple(effect.sentence for effect in best.result.model.effects),
        comparisons=_compare(base, best, closest),
        free_forms=forms,
        rule=judged.rule,
        bounds=_bounds(best),
        shares=shares(best, found, run),
        remainder=remainder(best, base, forms) if best.names else None,
        contributions=contributions(best, found) if best.names else None,
        explained=tuple(_cause(effect) for effect in best.result.model.effects),
        rivals=_rivals(judged),
        covariance=_covariance(best, judged.inflation),
        residuals=best.result.residuals,
        best_trial=() if closest is None else closest.names,
    )


def _alternatives(judged: Judgement, found: list[Candidate]) -> list[Candidate]:
    """Return the sets of causes that are listed as alternatives: first those beside the verdict.

    Where nothing explains the data, nothing is an alternative; the trials tell what was tried.
    """
    best = judged.chosen
    listed = [*((best,) if judged.verdict == "ambiguous" else ()), *judged.rivals]
    if judged.verdict == "unexplained":
        return listed
    by_weight = sorted(found[1:], key=lambda candidate: -candidate.weight)
    return listed + [
        candidate
        for candidate in by_weight
        if candidate not in listed
        and candidate is not best
        and judged.share.get(candidate.names, 0.0) > SHOWN
    ]


def _probability(judged: Judgement, base: Candidate) -> float:
    """Return the probability that the diagnosis states with its verdict.

    It is the p-value of the base model where that is adequate, what is missing from 1 where nothing
    explains the data, and else the share of the chosen set.
    """
    if judged.verdict == "adequate":
        return float(base.p_value_scaled if judged.noisier else base.p_value)
    if judged.verdict == "unexplained":
        return float(1 - base.p_value)
    return float(judged.share.get(judged.chosen.names, 0.0))


def _cause(effect: Effect) -> Cause:
    return Cause(effect.name, effect.sentence, effect.equation, effect.source, effect.limits)


def _rivals(judged: Judgement) -> tuple[Rival, ...]:
    """Return the other sets between which the data do not decide, with what is not named yet."""
    if judged.verdict != "ambiguous":
        return ()
    told = set(judged.chosen.names)
    found = []
    for candidate in judged.rivals:
        effects = candidate.result.model.effects
        more = tuple(_cause(effect) for effect in effects if effect.name not in told)
        told |= set(candidate.names)
        found.append(Rival(candidate.names, judged.share.get(candidate.names, 0.0), more))
    return tuple(found)


def _closest(found: list[Candidate]) -> Candidate | None:
    """Return the set of causes of highest evidence, for a reader to see what it leaves.

    One that is not saturated, if there is any.
    """
    return max(found[1:], key=lambda c: (not c.saturated, c.weight), default=None)


def _compare(base: Candidate, best: Candidate, closest: Candidate | None) -> tuple[Comparison, ...]:
    """Compare the data with the base model and with the one that the verdict rests on.

    Where nothing explains the data, the best trial takes the place of the latter.
    """
    models = [_named(base, "base model")]
    if best is not base:
        models.append(_named(best, " + ".join(best.names)))
    if closest is not None:
        models.append(_named(closest, f"best trial: {' + '.join(closest.names)}"))
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
        f"{plain(before.heldout_chi2_reduced, 3)} → {plain(best, 3)})"
    )


def _quality(candidate: Candidate) -> Quality:
    return Quality(
        candidate.result.chi2 / candidate.result.degrees,
        candidate.result.cross_validation.chi2_reduced,
    )


def _against(candidate: Candidate, found: list[Candidate], judged: Judgement) -> tuple[str, ...]:
    """Say what stands against a set; where nothing explains the data, something does."""
    result = candidate.result
    reasons = [f"{name} ends at a bound" for name in candidate.stuck]
    if candidate.p_value < THRESHOLDS.chance_excluded:
        reasons.append(f"leaves a misfit ({candidate.worst})")
    if not candidate.names:
        return tuple(reasons)
    if candidate.saturated:
        data = np.count_nonzero(result.model.base_model.blocks >= 0)
        reasons.append(f"has {result.vector.size} parameters for {data} data")
    if result.predicted and result.cross_validation.p_value < candidate.least_heldout:
        reasons.append("misses data that it was not fitted to")
    if not reasons and judged.rule in SPEAKS_AGAINST:
        fewer = any(
            set(other.names) < set(candidate.names) and other.weight >= candidate.weight
            for other in found[1:]
        )
        reasons.append("fewer causes do as well" if fewer else SPEAKS_AGAINST[judged.rule])
    return tuple(reasons)


def _where(base: Candidate, judged: Judgement) -> str:
    if judged.noisier:
        beside = f" beside {' + '.join(judged.chosen.names)}" if judged.chosen.names else ""
        return (
            f"the data scatter {judged.chosen.factor:.3g} times as much as their stated standard "
            f"deviation{beside}; no deviation beyond such noise"
        )
    if judged.verdict == "adequate":
        return "no deviation from the base model beyond noise"
    return (
        f"{base.result.model.base_model.describe(base.result.residuals)}; most telling: "
        f"{base.worst}"
    )


def _parameters(
    candidate: Candidate, base: Candidate, inflation: float = 1.0
) -> dict[str, dict[str, Parameter]]:
    """Return values and standard deviations by owner and name.

    Args: inflation: a factor on standard deviations by the data.
    """
    model = candidate.result.model
    sd = inflation * np.sqrt(np.diag(candidate.result.covariance))
    rows = zip(
        model.parameters, candidate.result.vector, sd, equation_sd(candidate, base), strict=True
    )
    found: dict[str, dict[str, Parameter]] = {"base": {}}
    for (owner, spec), value, s, moved in rows:
        common = abs(value) * model.base_model.systematic(spec.unit)
        exact = Parameter(spec.name, float(np.rint(value)), 0.0, spec.unit)
        fitted = Parameter(
            spec.name, float(value), float(np.hypot(s, common)), spec.unit, float(moved)
        )
        found.setdefault(owner, {})[spec.name] = exact if spec.whole else fitted
    return found


def _covariance(candidate: Candidate, inflation: float) -> Covariance:
    """Return the covariance of all parameters but whole numbers, larger by a factor squared."""
    fitted = candidate.result.model.parameters
    kept = [k for k, (_, spec) in enumerate(fitted) if not spec.whole]
    return Covariance(
        tuple(fitted[k][0] for k in kept),
        tuple(fitted[k][1].name for k in kept),
        inflation**2 * candidate.result.covariance[np.ix_(kept, kept)],
    )


def _bounds(candidate: Candidate) -> tuple[Bound, ...]:
    model = candidate.result.model
    return tuple(
        Bound(owner, spec.name, float(low), float(high), spec.unit, spec.reason)
        for (owner, spec), low, high in zip(model.parameters, *model.bounds, strict=True)
        if owner != "base"
    )
