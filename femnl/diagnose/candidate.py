"""A fitted set of causes: how well it explains the data, and what its residuals point to."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.special import logsumexp

from femnl.core.effect import Effect
from femnl.diagnose.adequacy import Adequacy, all_tests
from femnl.diagnose.part_of_data import in_part
from femnl.diagnose.score_tests import ScoreTest, score_tests, unlike
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.worker_pool import Job
from femnl.fits.least_squares import FitResult

Names = tuple[str, ...]
T = TypeVar("T")
MANY = 100_000
"""More score tests than are ever made of a model."""


@dataclass(frozen=True)
class Pointer:
    """An effect that residuals point to, and the values of its parameters from which fits start.

    gain: what it promises to take of χ² from the best of them.
    """

    effect: Effect
    shapes: tuple[dict[str, float], ...]
    gain: float


@dataclass(frozen=True)
class FirstTests:
    """Score tests that are made of a set before all others.

    Most sets leave what the base model points to, and all shapes of all effects take a hundred
    times longer than the one of each to which it points most.

    shapes: that one, by name of each effect. n_tests: of all shapes, for which a bound allows.
    worst: what speaks most against the base model, an effect or a pattern: most sets leave that.
    """

    shapes: dict[str, dict[str, float]]
    n_tests: int
    worst: str


@dataclass(frozen=True)
class Candidate:
    """A fitted set of causes.

    Its p-value, the score test that speaks most against it, and where its residuals point
    (None: not sought). p_value_scaled: that if its χ² is all noise, larger than stated; NaN where
    neighbours tell the noise. n_tests: score tests that were made.
    """

    result: FitResult
    p_value: float
    worst: str
    pointers: tuple[Pointer, ...] | None
    p_value_scaled: float = np.nan
    n_tests: int = 0

    @property
    def first_tests(self) -> FirstTests:
        """Those of what the set points to most."""
        shapes = {pointer.effect.name: pointer.shapes[0] for pointer in self.pointers or ()}
        return FirstTests(shapes, self.n_tests, self.worst)

    @property
    def factor(self) -> float:
        """Standard deviation over the stated one, if χ² is all noise."""
        return _factor(self.result)

    @property
    def names(self) -> Names:
        """Names of the causes, sorted."""
        return names_of(self.result)

    @property
    def weight(self) -> float:
        """Logarithm of evidence times prior odds."""
        return self.result.log_evidence + len(self.names) * float(np.log(THRESHOLDS.odds_per_cause))

    @property
    def stuck(self) -> list[str]:
        """Names of parameters at a bound, which speak against the set.

        One cause may end at its largest strength where smaller ones are as likely.
        """
        stuck = self.result.stuck
        if not stuck or len(self.names) > 1:
            return stuck
        allowed = self.result.allowed
        return [name for name in stuck if name not in allowed]

    @property
    def viable(self) -> bool:
        """Whether the set explains the data: adequate, with no parameter at a bound."""
        rare = THRESHOLDS.set_inadequate if self.names else THRESHOLDS.chance_excluded
        return self.p_value >= rare and not self.stuck

    @property
    def may_be_noisier(self) -> bool:
        """Whether what the set leaves is more than the stated noise, and may be larger noise."""
        return (
            self.p_value < THRESHOLDS.set_inadequate
            and self.p_value_scaled >= THRESHOLDS.base_inadequate
            and 1 < self.factor <= THRESHOLDS.largest_factor
            and not self.stuck
        )

    @property
    def weight_if_noisier(self) -> float:
        """The weight where the stated noise is wrong."""
        return weight_if_noisier(self.weight, self.result)

    @property
    def least_heldout(self) -> float:
        """p-value of data left out below which the set does not explain them.

        One cause is given the benefit of the doubt.
        """
        if len(self.names) <= 1:
            return THRESHOLDS.chance_excluded
        return THRESHOLDS.set_inadequate


def weight_if_noisier(weight: float, result: FitResult) -> float:
    """Return the logarithm of evidence times prior odds of a fit where the stated noise is wrong.

    The logarithm of s, the noise over the stated one, is normal:
    ∫ p(ln s) s^{−d} e^{−χ²/2s²} d ln s, d the degrees of freedom.

    Args: weight: what it is under the stated noise.
    """
    sizes = np.linspace(-4, 4, 401)
    step = sizes[1] - sizes[0]
    log_s = THRESHOLDS.factor_spread * sizes
    chi2 = result.chi2
    level = -0.5 * sizes**2 - result.degrees * log_s - chi2 / 2 * np.exp(-2 * log_s)
    marginal = float(logsumexp(level)) + float(np.log(step / np.sqrt(2 * np.pi)))
    return weight + chi2 / 2 + marginal + float(np.log(THRESHOLDS.wrong_noise_odds))


def criticise(
    result: FitResult, library: list[Effect], first: FirstTests | None = None
) -> Candidate:
    """Look at the residuals in every way, the effects that the model lacks included.

    Args: first: tests that come before all others, and end it where they refute the set.
    """
    others = _others(result, library)
    if first is not None:
        refuted = _refuted(result, others, first)
        if refuted is not None:
            return refuted
    found = score_tests(result, others)
    adequacy = Adequacy(result, found)
    p_value, worst = adequacy.p_value()
    pointers = tuple(_pointers(result, found, others))
    as_noise = np.nan
    if _noise_may_be_larger(result):
        as_noise = adequacy.p_value(_factor(result))[0]
    return Candidate(result, p_value, worst, pointers, as_noise, len(found))


def is_adequate(result: FitResult, library: list[Effect]) -> bool:
    """Whether a base model explains the data; patterns are tried first, effects only if need be."""
    bound, _ = Adequacy(result, score_tests(result, [])).bound(MANY)
    if bound < THRESHOLDS.base_inadequate:
        return False
    return criticise(result, library).p_value >= THRESHOLDS.base_inadequate


def glance(result: FitResult, library: list[Effect], first: FirstTests) -> Candidate:
    """Return a set with the p-value of the first tests alone."""
    others = _others(result, library)
    refuted = _refuted_by_worst(result, others, first)
    if refuted is not None:
        return refuted
    p_value, worst = Adequacy(result, _first_tests(result, others, first)).p_value()
    return Candidate(result, p_value, worst, None)


def looked_at(candidate: Candidate, library: list[Effect], whole: bool) -> Candidate:
    """Return a set with what its residuals point to.

    Args: whole: whether all data are asked; else a part of them is, where they are many, and a set
        that was refuted stays so.
    """
    part = candidate.result if whole else in_part(candidate.result)
    if part is candidate.result:
        return criticise(part, library) if candidate.pointers is None else candidate
    others = _others(part, library)
    pointers = tuple(_pointers(part, score_tests(part, others), others))
    return replace(candidate, pointers=pointers)


def _refuted(result: FitResult, others: list[Effect], first: FirstTests) -> Candidate | None:
    """Return a set that a few score tests refute; None where they do not.

    Its p-values are bounds, which allow for all tests.
    """
    if not _noise_may_be_larger(result):
        refuted = _refuted_by_worst(result, others, first)
        if refuted is not None:
            return refuted
    adequacy = Adequacy(result, _first_tests(result, others, first))
    p_value, worst = adequacy.bound(first.n_tests)
    as_noise = np.nan
    if _noise_may_be_larger(result):
        as_noise = adequacy.bound(first.n_tests, _factor(result))[0]
    if np.nanmax([p_value, as_noise]) >= THRESHOLDS.chance_excluded / 10:
        return None
    return Candidate(result, p_value, worst, None, as_noise)


def _refuted_by_worst(
    result: FitResult, others: list[Effect], first: FirstTests
) -> Candidate | None:
    """Return a set that is refuted by what speaks most against the base model; None where not.

    That is an effect, unless the set has it, or a pattern: then all patterns are tried.
    """
    told = [effect for effect in others if effect.name == first.worst]
    of_effect = first.worst in first.shapes
    tests = score_tests(result, told, first.shapes, patterns=not of_effect)
    worst = min(tests, key=lambda test: test.p_value, default=None)
    if worst is None:
        return None
    bound = worst.p_value * all_tests(first.n_tests)
    refuted = bound < THRESHOLDS.chance_excluded / 10
    return Candidate(result, bound, worst.name, None) if refuted else None


def _first_tests(result: FitResult, others: list[Effect], first: FirstTests) -> list[ScoreTest]:
    """Make the first tests of a fit: of each effect that it lacks, in the one shape told of it."""
    told = [effect for effect in others if effect.name in first.shapes]
    return score_tests(result, told, first.shapes)


def _others(result: FitResult, library: list[Effect]) -> list[Effect]:
    """Return the effects that a model lacks."""
    mine = {effect.name for effect in result.model.effects}
    return [effect for effect in library if effect.name not in mine]


def _noise_may_be_larger(result: FitResult) -> bool:
    """Whether what a model leaves may be noise, larger than stated.

    No neighbours tell the noise, and several causes leave what looks like noise whatever the data.
    """
    return not result.model.base_model.tells_noise and len(result.model.effects) <= 1


def scaled(result: FitResult) -> FitResult:
    """Return a fit whose noise is as large as its χ² says."""
    factor = _factor(result)
    return replace(result, residuals=result.residuals / factor, jacobian=result.jacobian / factor)


def _factor(result: FitResult) -> float:
    """Return the noise over the stated one, if χ² is all noise."""
    return max(float(np.sqrt(result.chi2 / result.degrees)), 1e-300)


def _pointers(result: FitResult, found: list[ScoreTest], library: list[Effect]) -> list[Pointer]:
    """Return the effects that promise most, and those whose tests are least likely by chance.

    Beside the base model alone, every effect is returned. There tangents tell least of where a
    cause leads, and an effect that resembles the right one must not be left out.
    """
    alone = not result.model.effects
    best: dict[str, list[ScoreTest]] = {}
    for test in sorted(found, key=lambda test: -test.gain):
        if test.effect is not None and (alone or test.gain > 0):
            best.setdefault(test.name, []).append(test)
    excess = result.chi2 - result.degrees
    promising = {
        name
        for i, name in enumerate(best)
        if alone
        or i < THRESHOLDS.fewest_effects
        or (i < THRESHOLDS.most_effects and best[name][0].gain > THRESHOLDS.least_gain * excess)
    }
    by_chance = sorted(best, key=lambda name: min(test.p_value for test in best[name]))
    promising.update(by_chance[: THRESHOLDS.surprising_effects])
    return [
        Pointer(e, tuple(test.values for test in unlike(best[e.name])), best[e.name][0].gain)
        for e in library
        if e.name in promising
    ]


def names_of(result: FitResult, *more: Effect) -> Names:
    """Return the names of a model's effects, and of more, sorted."""
    return tuple(sorted(effect.name for effect in (*result.model.effects, *more)))


def job(doing: str, names: Names, result: FitResult, find: Callable[[], T]) -> Job[T]:
    """Return a job on one model, and the line of progress that names it."""
    return Job(f"{result.model.base_model.kind}: {doing} {' + '.join(names)}", find)
