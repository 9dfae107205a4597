"""From fitted candidates to the verdict.

Evidence and held-out prediction must agree, ties are told as ties.
"""

from dataclasses import dataclass

import numpy as np

from femnl.core.diagnosis import Verdict
from femnl.diagnose.candidate import DOUBTFUL, FALSE_ALARMS, HOPELESS, PER_CAUSE, Candidate
from femnl.diagnose.freeform import fitted_forms
from femnl.fits.least_squares import CrossValidation

CLEAR = 0.99
"""Posterior probability from which on one set of causes is told alone: a wrong one is to be told in
less than one of a hundred files.
"""
ODDS = float(np.log(19))
"""Logarithm of odds up to which a set of causes is no less likely than another, for all that is
known of priors.
"""
TIE = 4.0
"""Difference in χ² up to which a set with no more parameters does as well, whatever the priors'
widths say.
"""
CONTRADICTED = 2.0
"""Standard errors by which a rival's logarithm of the density of unseen data must exceed the best
set's to contradict the evidence.
"""
SCATTERED = 1e3
"""Largest deviations of unknown cause, in σ, that are allowed for."""
RIVALS = 3
"""Rivals of the best, whose held-out prediction is computed as well."""


@dataclass(frozen=True)
class Judgement:
    """The verdict.

    With the candidate chosen (the base where none is), its rivals, and the probability of every
    candidate.
    """

    verdict: Verdict
    chosen: Candidate
    rivals: tuple[Candidate, ...]
    share: dict[tuple[str, ...], float]


def judge(found: list[Candidate]) -> Judgement:
    """Weigh what was fitted; the first candidate is the base model."""
    base = found[0]
    tried = found[1:]
    weights = np.array([c.weight for c in found])
    shares = np.exp(weights - weights.max())
    share = {c.names: float(s) for c, s in zip(found, shares / shares.sum(), strict=True)}
    if base.p_value >= FALSE_ALARMS:
        return Judgement("adequate", base, (), share)
    # A set is no explanation with a cause in it that the evidence does not ask for.
    worth = [
        c
        for c in tried
        if not any(set(o.names) < set(c.names) and o.weight >= c.weight for o in tried)
    ]
    likely = [c for c in worth if c.viable]
    if any(len(c.names) > 1 or c.p_value < DOUBTFUL for c in likely):
        smooth = _smooth(base) - ODDS
        likely = [
            c
            for c in likely
            if c.weight > smooth and (len(c.names) == 1 or c.weight > _scatter(base))
        ]
    # What fits all the data together, but not each part by what the others say, is bent to them and
    # no cause.
    viable = [
        c
        for c in sorted(likely, key=lambda c: -c.weight)[: 1 + RIVALS]
        if c.result.cross_validation.p_value >= c.least
    ]
    if base.viable and all(c.weight <= base.weight for c in viable):
        # Rare, but not too rare for chance, and no cause is worth its parameters
        return Judgement("adequate", base, (), share)
    if not viable:
        return Judgement("unexplained", base, (), share)
    best = viable[0]
    doubted = [c for c in tried if c not in viable and _doubted(c, best)]
    total = sum(share[c.names] for c in (*viable, *doubted))
    share |= {c.names: share[c.names] / total for c in (*viable, *doubted)}
    rivals = [c for c in viable[1:] if share[c.names] > (1 - CLEAR) / 2 or _ties(c, best)] + doubted
    if not rivals and len(viable) > 1 and _contradicted(best, viable[1:]):
        rivals = viable[1:]
    if not rivals and not _predicts_better(
        best.result.cross_validation, base.result.cross_validation
    ):
        # Evidence speaks for a set that predicts unseen data no better than the base model: that
        # explains nothing.
        if len(viable) == 1:
            return Judgement("unexplained", base, (), share)
        rivals = viable[1:]
    if not rivals:
        return Judgement("explained", best, (), share)
    near = [best, *(c for c in rivals if best.weight - c.weight < ODDS or _ties(c, best))]
    simplest = min(near, key=lambda c: (len(c.names), c.result.vector.size, -c.weight))
    return Judgement(
        "ambiguous", simplest, tuple(c for c in (best, *rivals) if c is not simplest), share
    )


def _scatter(base: Candidate) -> float:
    """Return the log evidence that a combination of causes must outdo.

    That of deviations at random, of unknown size and cause, times their prior odds.

    Residuals of s times their σ, s with a uniform prior in its logarithm: χ²/2 − (d/2)(ln χ²/d + 1)
    over the base model.
    """
    chi2 = base.result.chi2
    d = base.result.degrees
    size = float(np.log(np.sqrt(np.pi / d) / np.log(SCATTERED)))
    return (
        base.weight
        + (chi2 - d) / 2
        - d / 2 * float(np.log(chi2 / d))
        + size
        + 2 * float(np.log(PER_CAUSE))
    )


def _smooth(base: Candidate) -> float:
    """Return the log evidence of one unknown cause, the free form that suits best.

    Times its prior odds; no set may be far behind it.

    Several causes together, or one that fits badly, can imitate a cause that is missing, but not as
    simply as its own form.
    """
    return max((s.log_evidence for s in fitted_forms(base.result)), default=-np.inf) + 2 * float(
        np.log(PER_CAUSE)
    )


def _ties(candidate: Candidate, best: Candidate) -> bool:
    fewer = candidate.result.vector.size <= best.result.vector.size
    return fewer and candidate.result.chi2 - best.result.chi2 < TIE


def _doubted(candidate: Candidate, best: Candidate) -> bool:
    """Return whether a set with fewer or more causes than the best may be the right one.

    For all that chance and evidence say.

    One with fewer, whose fit is rare but not too rare for chance: more causes fit more anyway, and
    are not the clearer for it. One with more, where the fit of the best is doubtful.
    """
    if best.weight - candidate.weight > ODDS or candidate.result.stuck:
        return False
    names = set(candidate.names)
    own = set(best.names)
    if names < own:
        return min(candidate.p_value, candidate.result.cross_validation.p_value) >= HOPELESS
    return (
        names > own
        and best.p_value < DOUBTFUL
        and min(candidate.p_value, candidate.result.cross_validation.p_value) >= candidate.least
    )


def _contradicted(best: Candidate, others: list[Candidate]) -> bool:
    """Whether another set predicts unseen data clearly better.

    Not in one block alone, as where chance struck, but on the whole.

    Whether a cause more than in the best set is worth it, is for the evidence to say.
    """
    for other in (c for c in others if not set(best.names) < set(c.names)):
        gains = np.subtract(
            other.result.cross_validation.densities, best.result.cross_validation.densities
        )
        if np.sum(gains) > CONTRADICTED * np.sqrt(len(gains)) * np.std(gains, ddof=1):
            return True
    return False


def _predicts_better(one: CrossValidation, other: CrossValidation) -> bool:
    return one.chi2_reduced < other.chi2_reduced or one.density > other.density


def measure_next(judged: Judgement, found: list[Candidate]) -> str:
    """Name the measurement that best separates what is left, with the number of σ."""
    best = judged.chosen
    others = [c for c in sorted(found, key=lambda c: -c.weight) if c is not best]
    rivals = judged.rivals or tuple(others[:1])
    if not rivals:
        return (
            "nothing is left to separate: the base model explains these data and no "
            "extension was needed"
        )
    rival = rivals[0]
    separation = {}
    for phrase, predicted in _experiments(best).items():
        separation[phrase] = float(np.linalg.norm(predicted - _experiments(rival)[phrase]))
    names = [" + ".join(c.names) or "the base model" for c in (best, rival)]
    if judged.verdict in ("explained", "unexplained") and not judged.rivals:
        apart = float(np.sqrt(max(rival.result.chi2 - best.result.chi2, 0.0)))
        if judged.verdict == "explained":
            return (
                f"nothing is left to separate: the next best explanation, {names[1]}, is "
                f"{apart:.3g}σ worse on these data"
            )
    phrase = max(separation, key=lambda key: separation[key])
    if separation[phrase] < 1:
        most = f"at most {separation[phrase]:.2g}σ"
        return (
            f"no further measurement of this kind separates {names[0]} from {names[1]} "
            f"({most}): use another kind"
        )
    return f"measure {phrase}: it separates {names[0]} from {names[1]} by {separation[phrase]:.3g}σ"


def _experiments(
    candidate: Candidate,
) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    model = candidate.result.model
    base, values = model.split(candidate.result.vector)
    return model.base_model.candidate_measurements(model.effects, base, values)
