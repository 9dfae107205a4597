"""How well a fitted set of causes explains the data, and what its residuals point to."""

from dataclasses import replace

import numpy as np

from femnl.core.effect import Effect
from femnl.diagnose.adequacy import Adequacy, all_tests, is_refuted
from femnl.diagnose.candidate import Candidate, FirstTests, Pointer, factor_of
from femnl.diagnose.part_of_data import in_part
from femnl.diagnose.score_test import ScoreTest
from femnl.diagnose.score_tests import promising, score_tests, unlike
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.worker_pool import Run, in_turn
from femnl.fits.least_squares import FitResult

MANY = 100_000
"""More score tests than are ever made of a model."""


def criticise(
    result: FitResult,
    library: list[Effect],
    first: FirstTests | None = None,
    run: Run = in_turn,
) -> Candidate:
    """Look at the residuals in every way, the effects that the model lacks included.

    Args: first: tests that come before all others, and end it where they refute the set. run: makes
        the others side by side.
    """
    others = _others(result, library)
    if first is not None:
        refuted = _refuted(result, others, first)
        if refuted is not None:
            return refuted
    refuted_by_sum = is_refuted(result, MANY) and not _noise_may_be_larger(result)
    found = score_tests(result, others, starts_alone=refuted_by_sum, run=run)
    adequacy = Adequacy(result, found)
    p_value, worst = adequacy.p_value()
    pointers = tuple(_pointers(result, found, others))
    as_noise = np.nan
    if _noise_may_be_larger(result):
        as_noise = adequacy.p_value(factor_of(result))[0]
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

    Where data are many, a set that was refuted stays so.

    Args: whole: whether all data are asked; else a part of them is, where they are many.
    """
    result = candidate.result
    many = result.model.base_model.thinned is not None
    if not many or (whole and not is_refuted(result, MANY)):
        return criticise(result, library) if candidate.pointers is None else candidate
    seen = result if whole else in_part(result)
    others = _others(seen, library)
    tests = score_tests(seen, others, patterns=False, starts_alone=whole)
    return replace(candidate, pointers=tuple(_pointers(seen, tests, others)))


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
        as_noise = adequacy.bound(first.n_tests, factor_of(result))[0]
    if np.nanmax([p_value, as_noise]) >= THRESHOLDS.chance_excluded / 10:
        return None
    return Candidate(result, p_value, worst, None, as_noise)


def _refuted_by_worst(
    result: FitResult, others: list[Effect], first: FirstTests
) -> Candidate | None:
    """Return a set that is refuted by what speaks most against the base model; None where not.

    An effect is tested in the one shape told of it, and not of a set that has it. In the place of a
    pattern, all patterns are tested.
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


def _pointers(result: FitResult, found: list[ScoreTest], library: list[Effect]) -> list[Pointer]:
    """Return the effects that promise most, and those whose tests are least likely by chance.

    Beside the base model alone, every effect is returned.
    """
    alone = not result.model.effects
    best: dict[str, list[ScoreTest]] = {}
    for test in promising(result, found):
        best.setdefault(test.name, []).append(test)
    excess = result.chi2 - result.degrees
    pointing = {
        name
        for i, name in enumerate(best)
        if alone
        or i < THRESHOLDS.fewest_effects
        or (i < THRESHOLDS.most_effects and best[name][0].gain > THRESHOLDS.least_gain * excess)
    }
    by_chance = sorted(best, key=lambda name: min(test.p_value for test in best[name]))
    pointing.update(by_chance[: THRESHOLDS.surprising_effects])
    return [
        Pointer(e, tuple(test.values for test in unlike(best[e.name])), best[e.name][0].gain)
        for e in library
        if e.name in pointing
    ]
