"""A fitted set of causes, with what was found of how well it explains the data."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.special import logsumexp

from femnl.core.effect import Effect
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.worker_pool import Job, Run
from femnl.fits.least_squares import CrossValidation, FitResult

Names = tuple[str, ...]
T = TypeVar("T")


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
        return factor_of(self.result)

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
    def saturated(self) -> bool:
        """Whether the set has as many parameters as data: how well it fits then says nothing."""
        return self.result.vector.size >= len(self.result.residuals)

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


def scaled(result: FitResult) -> FitResult:
    """Return a fit whose noise is as large as its χ² says."""
    factor = factor_of(result)
    return replace(result, residuals=result.residuals / factor, slopes=result.slopes / factor)


def factor_of(result: FitResult) -> float:
    """Return the noise over the stated one, if χ² is all noise."""
    return max(float(np.sqrt(result.chi2 / result.degrees)), 1e-300)


def names_of(result: FitResult, *more: Effect) -> Names:
    """Return the names of a model's effects, and of more, sorted."""
    return tuple(sorted(effect.name for effect in (*result.model.effects, *more)))


def job(doing: str, names: Names, result: FitResult, find: Callable[[], T]) -> Job[T]:
    """Return a job on one model, and the line of progress that names it."""
    return Job(f"{result.model.base_model.kind}: {doing} {' + '.join(names)}", find, names)


def predict_held_out(results: Iterable[FitResult], run: Run) -> None:
    """Let fits predict the data that they leave out, side by side, where that is not known yet."""
    todo = [result for result in {id(r): r for r in results}.values() if not result.predicted]
    jobs = [Job("predicting held-out data", partial(_predicted, result)) for result in todo]
    for result, seen in zip(todo, run(jobs), strict=True):
        result.keep_predicted(seen)


def _predicted(result: FitResult) -> CrossValidation:
    return result.cross_validation
