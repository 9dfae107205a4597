"""From fitted candidates to the verdict, by rules in order; the first that applies decides.

Evidence and held-out prediction must agree, and equals are reported as indistinguishable.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from femnl.core.diagnosis import Verdict
from femnl.diagnose.candidate import Candidate, Names, predict_held_out
from femnl.diagnose.rivals import CLEARLY, EVEN, equals
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.weighing import Weighed
from femnl.diagnose.worker_pool import Run, in_turn

UNTOUCHED = 1e-5
"""Part of a block's χ² by which a set that does not touch it may change it, by rounding."""


@dataclass(frozen=True)
class Judgement:
    """The verdict, and the rule that decided it.

    chosen: the candidate that the verdict rests on, the base where no cause is named; rivals of it;
    share: the probability of every candidate, by its names. inflation: factor on standard
    deviations of parameters, for what the chosen set leaves.
    """

    verdict: Verdict
    chosen: Candidate
    rivals: tuple[Candidate, ...]
    share: dict[Names, float]
    rule: str = ""
    inflation: float = 1.0

    @property
    def noisier(self) -> bool:
        """Whether all that the chosen set leaves is noise, larger than stated."""
        return self.rule in NOISE_IS_LARGER


Rule = Callable[[Weighed], Judgement | None]


def base_explains_the_data(weighed: Weighed) -> Judgement | None:
    """The base model is adequate: no cause is sought where noise suffices."""
    if weighed.base.p_value < THRESHOLDS.base_inadequate:
        return None
    return Judgement("adequate", weighed.base, (), weighed.prior_share)


def no_cause_is_worth_its_parameters(weighed: Weighed) -> Judgement | None:
    """The misfit is rare, but not too rare for chance, and no cause makes it likelier."""
    if not weighed.base.viable or _clearly_likelier(weighed):
        return None
    return Judgement("adequate", weighed.base, (), weighed.prior_share)


def noise_is_larger_than_stated(weighed: Weighed) -> Judgement | None:
    """All deviations look like noise of another size, and that is likelier than any cause.

    The rule holds only where no neighbours tell the noise: a spectrum has few data, each of its own
    kind.
    """
    base = weighed.base
    if not base.may_be_noisier:
        return None
    if any(c.weight > base.weight_if_noisier for c in weighed.viable):
        return None
    return Judgement("adequate", base, (), weighed.prior_share, inflation=base.factor)


def causes_take_up_most_of_the_deviation(weighed: Weighed) -> Judgement | None:
    """No set is exact, but some causes are beyond doubt: they take up most of what is wrong.

    Whatever the rest is: with a discrepancy of unknown size in every set they are in every likely
    one, and they improve the prediction of most blocks that were held out.
    """
    if weighed.viable:
        return None
    graded = weighed.graded
    best = graded.beyond_doubt
    if best is None or not _takes_up_most(best, weighed):
        return None
    return Judgement(
        "explained in part",
        best,
        (),
        graded.share,
        inflation=graded.inflation(best),
    )


def several_sets_take_up_most_of_the_deviation(weighed: Weighed) -> Judgement | None:
    """No set is exact, and one of several takes up most of what is wrong beyond doubt."""
    if weighed.viable:
        return None
    graded = weighed.graded
    sets = graded.left_in_part
    if not sets or not all(_takes_up_most(candidate, weighed) for candidate in sets):
        return None
    simplest = min(sets, key=lambda c: (len(c.names), c.result.vector.size))
    others = tuple(c for c in sets if c is not simplest)
    return Judgement(
        "ambiguous",
        simplest,
        others,
        graded.share,
        inflation=graded.inflation(simplest),
    )


def causes_explain_the_data_within_larger_noise(weighed: Weighed) -> Judgement | None:
    """No set explains the data within the stated noise, and one cause does within larger noise.

    The rule holds only where no neighbours tell the noise. Several causes in just the right ratio
    leave what looks like noise whatever the data: they are not named by this rule.
    """
    sets = weighed.noisier
    if weighed.viable or not sets:
        return None
    first, *others = sets
    verdict: Verdict = "ambiguous" if others else "explained"
    return Judgement(
        verdict, first, tuple(others), weighed.share_if_noisier, inflation=first.factor
    )


def no_set_explains_the_data(weighed: Weighed) -> Judgement | None:
    """No set of causes explains all data and predicts each part from the others."""
    if weighed.viable:
        return None
    return Judgement("unexplained", weighed.base, (), weighed.prior_share)


def no_set_is_likelier_than_the_base(weighed: Weighed) -> Judgement | None:
    """Sets explain the data, but each is as unlikely as that chance makes the base model miss them.

    The base model leaves too much for chance, and so what deviates is neither of them.
    """
    if _clearly_likelier(weighed):
        return None
    return Judgement("unexplained", weighed.base, (), weighed.prior_share)


def only_set_predicts_no_better(weighed: Weighed) -> Judgement | None:
    """The one set left predicts held-out data no better than the base model: no explanation."""
    if weighed.rivals or weighed.predicts_better_than_base:
        return None
    return Judgement("unexplained", weighed.base, (), weighed.share)


def fewer_causes_may_suffice(weighed: Weighed) -> Judgement | None:
    """A set explains the data, but a cause of it may only make up for another's equation.

    Or it acts on one datum alone, which tells no cause from another.

    The rule holds only where every rival has all causes of the smaller set that may suffice.
    """
    graded = weighed.graded
    sets = graded.may_suffice(weighed.best)
    if not sets:
        return None
    first, *more = sets
    if not all(set(first.names) <= set(rival.names) for rival in weighed.rivals):
        return None
    beside = (rival for rival in weighed.rivals if rival not in sets)
    others = (*more, weighed.best, *beside)
    return Judgement("ambiguous", first, others, graded.share, inflation=graded.inflation(first))


def one_set_stands_alone(weighed: Weighed) -> Judgement | None:
    """One set explains the data, and no other may be right."""
    if weighed.rivals:
        return None
    return Judgement("explained", weighed.best, (), weighed.share)


def several_sets_are_left(weighed: Weighed) -> Judgement | None:
    """Several sets may be right; the simplest of those as likely as the best gives the name."""
    best = weighed.best
    near = [c for c in weighed.rivals if best.weight - c.weight < EVEN or equals(c, best)]
    simplest = min([best, *near], key=lambda c: (len(c.names), c.result.vector.size, -c.weight))
    others = tuple(c for c in (best, *weighed.rivals) if c is not simplest)
    return Judgement("ambiguous", simplest, others, weighed.share)


RULES: tuple[Rule, ...] = (
    base_explains_the_data,
    no_cause_is_worth_its_parameters,
    noise_is_larger_than_stated,
    causes_take_up_most_of_the_deviation,
    several_sets_take_up_most_of_the_deviation,
    causes_explain_the_data_within_larger_noise,
    no_set_explains_the_data,
    no_set_is_likelier_than_the_base,
    only_set_predicts_no_better,
    fewer_causes_may_suffice,
    one_set_stands_alone,
    several_sets_are_left,
)
"""In this order; the last one always applies."""


def _words(rule: Rule) -> str:
    """Return what a rule says, as its name has it."""
    return rule.__name__.replace("_", " ")


NOISE_IS_LARGER = frozenset(
    _words(rule)
    for rule in (noise_is_larger_than_stated, causes_explain_the_data_within_larger_noise)
)
"""Rules by which what the chosen set leaves is noise, larger than stated."""
SPEAKS_AGAINST = {
    _words(no_set_explains_the_data): "is no likelier than an unknown deviation",
    _words(no_set_is_likelier_than_the_base): "is hardly likelier than the base model",
    _words(only_set_predicts_no_better): "predicts unseen data no better than the base model",
}
"""By rules that leave the data unexplained, what speaks against sets that fit them."""


def judge(
    found: list[Candidate], run: Run = in_turn, considered: frozenset[str] = frozenset()
) -> Judgement:
    """Return the verdict of the first rule that applies; the first candidate is the base model.

    considered: names of the effects that were, or that the device cannot have.
    """
    weighed = Weighed(found, run, considered)
    for rule in RULES:
        judgement = rule(weighed)
        if judgement is not None:
            return replace(judgement, rule=_words(rule))
    raise AssertionError("the last rule always applies")


def _clearly_likelier(weighed: Weighed) -> bool:
    """Whether a set that explains the data is clearly likelier than the base model."""
    return any(c.weight > weighed.base.weight + CLEARLY for c in weighed.viable)


def _takes_up_most(candidate: Candidate, weighed: Weighed) -> bool:
    """Whether a set takes up most of the held-out excess χ², in blocks that hold most of the data.

    The α of a simulated film is a block of its own, but hardly counts beside a sweep. What a set
    does not touch, as another measurement of the file, does not count.
    """
    predict_held_out([weighed.base.result, candidate.result], weighed.run)
    before = weighed.base.result.cross_validation
    after = candidate.result.cross_validation
    sizes = np.array(before.sizes)
    excess = np.array(before.squares) - sizes
    taken = np.array(before.squares) - np.array(after.squares)
    if taken.sum() < weighed.graded.least_share(candidate) * excess.sum():
        return False
    touched = np.abs(taken) > UNTOUCHED * np.array(before.squares)
    telling = touched & (excess > 0)
    if not telling.any():
        return False
    better = np.average(taken[telling] > 0, weights=sizes[telling])
    return bool(better >= THRESHOLDS.most_blocks)
