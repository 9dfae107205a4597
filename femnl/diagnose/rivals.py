"""How one set of causes stands against another, and against causes that nobody knows."""

import numpy as np
from scipy.special import logsumexp

from femnl.diagnose.candidate import Candidate
from femnl.diagnose.freeform import fitted_forms
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import CrossValidation

PEAK = 8.0
STEPS = 400
SHORTEST = 1e-9
"""Widths about the likeliest scatter, steps and the shortest of them, of a sum over ln s."""
EVEN = float(np.log(THRESHOLDS.even_odds))
"""Logarithm of the odds up to which a set is no less likely than another."""
CLEARLY = float(np.log(THRESHOLDS.clear_odds))
"""Logarithm of the odds by which a set must be likelier than another to be clearly so."""


def may_imitate(candidate: Candidate) -> bool:
    """Whether several causes explain all data within noise, where no set may be named for that.

    In just the right ratio several causes imitate what the library lacks, and held-out data show
    it. If one cause explains all data but no held-out block within noise, its equation is inexact.
    """
    return len(candidate.names) > 1 and candidate.viable


def scatter_evidence(base: Candidate) -> float:
    """Return the log evidence, with prior odds, that a combination of causes must outdo.

    It is that of deviations at random, of unknown size and cause.

    Residuals of s times their σ, ln s uniform from 0 to that of the largest scatter: over the base
    model it is the mean of s^{−d} exp(χ²/2 (1 − 1/s²)).
    """
    chi2 = base.result.chi2
    d = base.result.degrees
    largest = float(np.log(THRESHOLDS.largest_scatter))
    # Narrow about s² = χ²/d where that is more than 1, and else at the end
    peak = 0.5 * float(np.log(chi2 / d)) + np.linspace(-PEAK, PEAK, STEPS) / np.sqrt(2 * d)
    grid = np.concatenate([[0.0], np.geomspace(SHORTEST, largest, STEPS), peak])
    log_s = np.unique(np.clip(grid, 0.0, largest))
    level = chi2 / 2 * -np.expm1(-2 * log_s) - d * log_s
    steps = np.gradient(log_s)
    steps[[0, -1]] /= 2
    gain = float(logsumexp(level, b=steps / largest))
    return base.weight + gain + 2 * float(np.log(THRESHOLDS.odds_per_cause))


def free_form_evidence(base: Candidate) -> float:
    """Return the log evidence, with prior odds, of the free form that suits best: an unknown cause.

    No set may be far behind it.

    Several causes together, or one that fits badly, can imitate a cause that is missing, but not as
    simply as its own form.
    """
    return max((s.log_evidence for s in fitted_forms(base.result)), default=-np.inf) + 2 * float(
        np.log(THRESHOLDS.odds_per_cause)
    )


def equals(candidate: Candidate, best: Candidate) -> bool:
    """Whether a set with no more parameters leaves about the same χ² as the best."""
    fewer = candidate.result.vector.size <= best.result.vector.size
    return fewer and candidate.result.chi2 - best.result.chi2 < THRESHOLDS.equal_chi2


def may_be_right(candidate: Candidate, best: Candidate) -> bool:
    """Whether a set with fewer or more causes than the best may be the right one.

    One with fewer, whose fit is rare but not too rare for chance: more causes fit more anyway, and
    are not the clearer for it. One with more, where the fit of the best is doubtful.
    """
    if best.weight - candidate.weight > EVEN or candidate.stuck:
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


def likelier_if_inexact(candidate: Candidate, best: Candidate) -> bool:
    """Whether one cause explains all data and is clearly likelier than the best viable set.

    That it predicts a block badly may be chance, or that its equation is inexact. A set that the
    data make less likely does not stand alone for that.
    """
    clearly = candidate.weight > best.weight + CLEARLY
    return len(candidate.names) == 1 and candidate.viable and clearly


def _least_p(candidate: Candidate) -> float:
    """Return the smaller p-value, of all data or of held-out data."""
    return min(candidate.p_value, candidate.result.cross_validation.p_value)


def contradicted(best: Candidate, others: list[Candidate]) -> bool:
    """Whether another set predicts unseen data clearly better.

    Not in one block alone, as where chance struck or where there is but one, but on the whole.
    Whether one cause more than in the best set is worth its parameters is for the evidence to say.
    """
    for other in (c for c in others if not set(best.names) < set(c.names)):
        gains = np.subtract(
            other.result.cross_validation.densities, best.result.cross_validation.densities
        )
        if len(gains) < 2:
            return False
        error = np.sqrt(len(gains)) * np.std(gains, ddof=1)
        if np.sum(gains) > THRESHOLDS.contradicting_errors * error:
            return True
    return False


def predicts_better(one: CrossValidation, other: CrossValidation) -> bool:
    """Whether one prediction of held-out data is better, by χ² or by density.

    Either way round where they disagree: it rules out only what is worse by both.
    """
    return one.chi2_reduced < other.chi2_reduced or one.density > other.density
