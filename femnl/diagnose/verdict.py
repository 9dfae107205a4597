"""From fitted candidates to the verdict, by rules in order; the first that applies decides.

Evidence and held-out prediction must agree, and equals are reported as indistinguishable.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from femnl.core.diagnosis import Verdict
from femnl.diagnose.candidate import Candidate, Names
from femnl.diagnose.discrepancy import discrepancy, log_evidence
from femnl.diagnose.freeform import fitted_forms
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import CrossValidation

EVEN = float(np.log(THRESHOLDS.even_odds))
"""Logarithm of the odds up to which a set is no less likely than another."""


@dataclass(frozen=True)
class Judgement:
    """The verdict, and the rule that decided it.

    chosen: the candidate that the verdict rests on, the base where no cause is named; rivals of it;
    share: the probability of every candidate, by its names.
    """

    verdict: Verdict
    chosen: Candidate
    rivals: tuple[Candidate, ...]
    share: dict[Names, float]
    rule: str = ""

    @property
    def noisier(self) -> bool:
        """Whether the noise is larger than the file states, and explains all deviations."""
        return self.rule == NOISE_IS_LARGER


@dataclass(frozen=True)
class Weighed:
    """Fitted candidates, the base model first, with what the rules ask of them."""

    found: list[Candidate]

    @property
    def base(self) -> Candidate:
        """The base model."""
        return self.found[0]

    @cached_property
    def prior_share(self) -> dict[Names, float]:
        """Evidence times prior odds of every candidate, in parts of their sum."""
        weights = np.array([c.weight for c in self.found])
        shares = np.exp(weights - weights.max())
        total = shares.sum()
        return {c.names: float(s / total) for c, s in zip(self.found, shares, strict=True)}

    @cached_property
    def likely(self) -> list[Candidate]:
        """Sets that explain all data together, the most likely first.

        Each of their causes is worth its parameters. Several causes, or one that fits badly, must
        also outdo a smooth form of unknown cause, and several causes deviations at random: in just
        the right ratio they imitate what the library lacks.
        """
        tried = self.found[1:]
        worth = [
            c
            for c in tried
            if not any(set(o.names) < set(c.names) and o.weight >= c.weight for o in tried)
        ]
        likely = [c for c in worth if c.viable]
        if any(len(c.names) > 1 or c.p_value < THRESHOLDS.set_doubtful for c in likely):
            smooth = _smooth(self.base) - EVEN
            likely = [
                c
                for c in likely
                if c.weight > smooth and (len(c.names) == 1 or c.weight > _scatter(self.base))
            ]
        return sorted(likely, key=lambda c: -c.weight)

    @cached_property
    def viable(self) -> list[Candidate]:
        """Those of the likeliest sets that predict each part of the data from the others.

        What fits all data together, but no part by what the others say, is bent to them, no cause.
        """
        nearest = self.likely[: 1 + THRESHOLDS.most_rivals]
        return [c for c in nearest if c.result.cross_validation.p_value >= c.least_heldout]

    @property
    def best(self) -> Candidate:
        """The most likely viable set."""
        return self.viable[0]

    @cached_property
    def doubted(self) -> list[Candidate]:
        """Sets that differ from the best by some causes, and may be right for all that is known."""
        return [c for c in self.found[1:] if c not in self.viable and _may_be_right(c, self.best)]

    @cached_property
    def share(self) -> dict[Names, float]:
        """Probability of every candidate; those that may be right share the whole."""
        possible = [c.names for c in (*self.viable, *self.doubted)]
        total = sum(self.prior_share[names] for names in possible)
        return self.prior_share | {names: self.prior_share[names] / total for names in possible}

    @cached_property
    def rivals(self) -> list[Candidate]:
        """Sets that keep the best from being named alone: first those that are likely enough.

        Where there are none, all viable ones, if they predict held-out data better than the best,
        or if the best predicts it no better than the base model.
        """
        others = self.viable[1:]
        unlikely = (1 - THRESHOLDS.named_alone) / 2
        near = [c for c in others if self.share[c.names] > unlikely or _equals(c, self.best)]
        if near or self.doubted:
            return near + self.doubted
        if _contradicted(self.best, others) or not self.predicts_better_than_base:
            return others
        return []

    @cached_property
    def graded(self) -> dict[Names, float]:
        """Probability of every candidate with a discrepancy of unknown size in each of them."""
        best = min(self.found, key=lambda c: c.result.chi2)
        allowed = discrepancy(self.base.result, best.result)
        odds = float(np.log(THRESHOLDS.odds_per_cause))
        weights = np.array(
            [log_evidence(c, self.base, allowed) + len(c.names) * odds for c in self.found]
        )
        shares = np.exp(weights - weights.max())
        return {c.names: float(s) for c, s in zip(self.found, shares / shares.sum(), strict=True)}

    @cached_property
    def beyond_doubt(self) -> Candidate | None:
        """The causes that every likely set has in common, None where there are none.

        The largest fitted set of them.
        """
        inclusion: dict[str, float] = {}
        for names, share in self.graded.items():
            for name in names:
                inclusion[name] = inclusion.get(name, 0.0) + share
        sure = {name for name, share in inclusion.items() if share >= THRESHOLDS.least_inclusion}
        sets = [
            c
            for c in self.found[1:]
            if set(c.names) <= sure and not c.result.stuck and self.each_counts(c)
        ]
        return max(sets, key=lambda c: (len(c.names), self.graded[c.names]), default=None)

    def each_counts(self, candidate: Candidate) -> bool:
        """Whether every one of several causes takes up more than what inexact equations miss."""
        least = THRESHOLDS.least_share_each * (self.base.result.chi2 - self.base.result.degrees)
        fewer = [
            c
            for c in self.found
            if set(c.names) < set(candidate.names) and len(c.names) == len(candidate.names) - 1
        ]
        return len(candidate.names) == 1 or all(
            c.result.chi2 - candidate.result.chi2 >= least for c in fewer
        )

    @cached_property
    def predicts_better_than_base(self) -> bool:
        """Whether the best set predicts held-out data better than the base model."""
        return _predicts_better(
            self.best.result.cross_validation, self.base.result.cross_validation
        )


Rule = Callable[[Weighed], Judgement | None]


def base_explains_the_data(weighed: Weighed) -> Judgement | None:
    """The base model is adequate: no cause is sought where noise suffices."""
    if weighed.base.p_value < THRESHOLDS.base_inadequate:
        return None
    return Judgement("adequate", weighed.base, (), weighed.prior_share)


def no_cause_is_worth_its_parameters(weighed: Weighed) -> Judgement | None:
    """The misfit is rare, but not too rare for chance, and no cause makes it likelier."""
    if not weighed.base.viable or any(c.weight > weighed.base.weight for c in weighed.viable):
        return None
    return Judgement("adequate", weighed.base, (), weighed.prior_share)


def noise_is_larger_than_stated(weighed: Weighed) -> Judgement | None:
    """All deviations look like noise of another size, and that is likelier than any cause.

    Only where no neighbours tell the noise: a spectrum has few data, of which each is its own.
    """
    base = weighed.base
    if not base.p_value_scaled >= THRESHOLDS.base_inadequate:
        return None
    if not 1 < base.factor <= THRESHOLDS.largest_factor:
        return None
    if any(c.weight > _wrong_noise(base) for c in weighed.viable):
        return None
    return Judgement("adequate", base, (), weighed.prior_share)


def causes_take_up_most_of_the_deviation(weighed: Weighed) -> Judgement | None:
    """No set is exact, but some causes are beyond doubt: they take up most of what is wrong.

    Whatever the rest is: with a discrepancy of unknown size in every set they are in every likely
    one, and they improve the prediction of most blocks that were held out.
    """
    best = weighed.beyond_doubt
    if weighed.viable or best is None or not _takes_up_most(best, weighed.base):
        return None
    return Judgement("explained in part", best, (), weighed.graded)


def no_set_explains_the_data(weighed: Weighed) -> Judgement | None:
    """No set of causes explains all data and predicts each part from the others."""
    if weighed.viable:
        return None
    return Judgement("unexplained", weighed.base, (), weighed.prior_share)


def only_set_predicts_no_better(weighed: Weighed) -> Judgement | None:
    """The one set left predicts held-out data no better than the base model: no explanation."""
    if weighed.rivals or weighed.predicts_better_than_base:
        return None
    return Judgement("unexplained", weighed.base, (), weighed.share)


def one_set_stands_alone(weighed: Weighed) -> Judgement | None:
    """One set explains the data, and no other may be right."""
    if weighed.rivals:
        return None
    return Judgement("explained", weighed.best, (), weighed.share)


def several_sets_are_left(weighed: Weighed) -> Judgement | None:
    """Several sets may be right; the simplest of those as likely as the best gives the name."""
    best = weighed.best
    near = [c for c in weighed.rivals if best.weight - c.weight < EVEN or _equals(c, best)]
    simplest = min([best, *near], key=lambda c: (len(c.names), c.result.vector.size, -c.weight))
    others = tuple(c for c in (best, *weighed.rivals) if c is not simplest)
    return Judgement("ambiguous", simplest, others, weighed.share)


NOISE_IS_LARGER = noise_is_larger_than_stated.__name__.replace("_", " ")
RULES: tuple[Rule, ...] = (
    base_explains_the_data,
    no_cause_is_worth_its_parameters,
    noise_is_larger_than_stated,
    causes_take_up_most_of_the_deviation,
    no_set_explains_the_data,
    only_set_predicts_no_better,
    one_set_stands_alone,
    several_sets_are_left,
)
"""In this order; the last one always applies."""


def judge(found: list[Candidate]) -> Judgement:
    """Return the verdict of the first rule that applies; the first candidate is the base model."""
    weighed = Weighed(found)
    for rule in RULES:
        judgement = rule(weighed)
        if judgement is not None:
            return replace(judgement, rule=_words(rule))
    raise AssertionError("the last rule always applies")


def _words(rule: Rule) -> str:
    """Return what a rule says, as its name has it."""
    return rule.__name__.replace("_", " ")


def _scatter(base: Candidate) -> float:
    """Return the log evidence that a combination of causes must outdo.

    That of deviations at random, of unknown size and cause, times their prior odds.

    Residuals of s times their σ, s with a uniform prior in its logarithm: χ²/2 − (d/2)(ln χ²/d + 1)
    over the base model.
    """
    chi2 = base.result.chi2
    d = base.result.degrees
    size = float(np.log(np.sqrt(np.pi / d) / np.log(THRESHOLDS.largest_scatter)))
    return (
        base.weight
        + (chi2 - d) / 2
        - d / 2 * float(np.log(chi2 / d))
        + size
        + 2 * float(np.log(THRESHOLDS.odds_per_cause))
    )


def _smooth(base: Candidate) -> float:
    """Return the log evidence of one unknown cause, the free form that suits best.

    Times its prior odds; no set may be far behind it.

    Several causes together, or one that fits badly, can imitate a cause that is missing, but not as
    simply as its own form.
    """
    return max((s.log_evidence for s in fitted_forms(base.result)), default=-np.inf) + 2 * float(
        np.log(THRESHOLDS.odds_per_cause)
    )


def _wrong_noise(base: Candidate) -> float:
    """Return the log evidence of the base model under noise of another size, times its prior odds.

    ln s of the noise over the stated one is normal: ∫ p(ln s) s^{−d} e^{−χ²/2s²} d ln s, d the
    degrees of freedom.
    """
    sizes = np.linspace(-4, 4, 401)
    step = sizes[1] - sizes[0]
    log_s = THRESHOLDS.factor_spread * sizes
    chi2 = base.result.chi2
    level = -0.5 * sizes**2 - base.result.degrees * log_s - chi2 / 2 * np.exp(-2 * log_s)
    marginal = float(logsumexp(level)) + float(np.log(step / np.sqrt(2 * np.pi)))
    return base.weight + chi2 / 2 + marginal + float(np.log(THRESHOLDS.wrong_noise_odds))


def _takes_up_most(candidate: Candidate, base: Candidate) -> bool:
    """Whether a set takes up most of the held-out excess χ², in most blocks."""
    before = base.result.cross_validation
    after = candidate.result.cross_validation
    excess = np.array(before.squares) - np.array(before.sizes)
    taken = np.array(before.squares) - np.array(after.squares)
    if taken.sum() < THRESHOLDS.least_share * excess.sum():
        return False
    telling = excess > 0
    return bool(np.mean(taken[telling] > 0) >= THRESHOLDS.most_blocks)


def _equals(candidate: Candidate, best: Candidate) -> bool:
    """Whether a set with no more parameters leaves about the same χ² as the best."""
    fewer = candidate.result.vector.size <= best.result.vector.size
    return fewer and candidate.result.chi2 - best.result.chi2 < THRESHOLDS.equal_chi2


def _may_be_right(candidate: Candidate, best: Candidate) -> bool:
    """Whether a set with fewer or more causes than the best may be the right one.

    One with fewer, whose fit is rare but not too rare for chance: more causes fit more anyway, and
    are not the clearer for it. One with more, where the fit of the best is doubtful.
    """
    if best.weight - candidate.weight > EVEN or candidate.result.stuck:
        return False
    names = set(candidate.names)
    own = set(best.names)
    if names < own:
        return _least_p(candidate) >= THRESHOLDS.chance_excluded
    return (
        names > own
        and best.p_value < THRESHOLDS.set_doubtful
        and _least_p(candidate) >= candidate.least_heldout
    )


def _least_p(candidate: Candidate) -> float:
    """Return the smaller p-value, of all data or of held-out data."""
    return min(candidate.p_value, candidate.result.cross_validation.p_value)


def _contradicted(best: Candidate, others: list[Candidate]) -> bool:
    """Whether another set predicts unseen data clearly better.

    Not in one block alone, as where chance struck, but on the whole. Whether one cause more than in
    the best set is worth its parameters is for the evidence to say.
    """
    for other in (c for c in others if not set(best.names) < set(c.names)):
        gains = np.subtract(
            other.result.cross_validation.densities, best.result.cross_validation.densities
        )
        error = np.sqrt(len(gains)) * np.std(gains, ddof=1)
        if np.sum(gains) > THRESHOLDS.contradicting_errors * error:
            return True
    return False


def _predicts_better(one: CrossValidation, other: CrossValidation) -> bool:
    return one.chi2_reduced < other.chi2_reduced or one.density > other.density


def measure_next(judged: Judgement, found: list[Candidate]) -> str:
    """Name the measurement that best separates what is left, with the number of σ."""
    best = judged.chosen
    others = [c for c in sorted(found, key=lambda c: -c.weight) if c is not best]
    rivals = judged.rivals or tuple(others[:1])
    if not rivals and judged.verdict == "adequate":
        return (
            "nothing is left to separate: the base model explains these data and no "
            "extension was needed"
        )
    if not rivals:
        return "no cause of the library acts on these data: measure another quantity of this device"
    rival = rivals[0]
    one = " + ".join(best.names) or "the base model"
    other = " + ".join(rival.names) or "the base model"
    if judged.verdict == "explained":
        worse = float(np.sqrt(max(rival.result.chi2 - best.result.chi2, 0.0)))
        return (
            f"nothing is left to separate: the next best explanation, {other}, is {worse:.3g}σ "
            "worse on these data"
        )
    theirs = _predicted_measurements(rival)
    separation = {
        phrase: float(np.linalg.norm(predicted - theirs[phrase]))
        for phrase, predicted in _predicted_measurements(best).items()
    }
    phrase = max(separation, key=lambda key: separation[key])
    if separation[phrase] < 1:
        return (
            f"no further measurement of this kind separates {one} from {other} (at most "
            f"{separation[phrase]:.2g}σ): use another kind"
        )
    return f"measure {phrase}: it separates {one} from {other} by {separation[phrase]:.3g}σ"


def _predicted_measurements(
    candidate: Candidate,
) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    model = candidate.result.model
    base, values = model.split(candidate.result.vector)
    return model.base_model.candidate_measurements(model.effects, base, values)
