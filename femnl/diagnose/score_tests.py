"""Score tests: the causes and patterns to which the residuals of a fit point."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from femnl.core.effect import Effect, Values
from femnl.core.readout import Array
from femnl.diagnose.effect_tests import effect_tests
from femnl.diagnose.score_test import ScoreTest, basis_of, left_beside, stored
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.worker_pool import Job, Run, in_turn
from femnl.fits.least_squares import FitResult

SHAPES = 4
ALIKE = 0.98
"""Trial shapes of an effect that are starts of its fit, and the square of the cosine from which on
two are the same to the data.
"""
SAME = 1e-6
"""Largest difference of residuals up to which two places in a model predict the same."""


def score_tests(
    result: FitResult,
    library: list[Effect],
    shapes: Mapping[str, Values] | None = None,
    *,
    patterns: bool = True,
    starts_alone: bool = False,
    run: Run = in_turn,
) -> list[ScoreTest]:
    """Return every score test of the residuals.

    Each pattern of the model is tested once, and each effect at each of its trial shapes.

    Args: shapes: by name of each effect, values of its parameters; each is tested in this one
        shape. By default it is tested in all trial shapes. patterns: whether patterns are tested.
        starts_alone: whether only those tests keep their directions from which fits of an effect
        would start; of a large map all take a fifth of a gigabyte. run: tests effects side by side.
    """
    if not library and not patterns:
        return []
    own, _ = np.linalg.qr(result.jacobian[:, result.free])
    found = _of_patterns(result, own) if patterns else []
    base_model = result.model.base_model
    base, values = result.model.split(result.vector)
    others = [
        other
        for other in base_model.equivalent_solutions(base)
        if _same(result, result.model.pack(other, values))
    ]
    jobs = [
        Job(
            f"{base_model.kind}: testing {effect.name}",
            partial(_of_effect, result, own, effect, others, shapes, starts_alone),
        )
        for effect in library
        if effect.has_strength
    ]
    return [*found, *(test for tests in run(jobs) for test in tests)]


def _of_patterns(result: FitResult, own: Array) -> list[ScoreTest]:
    """Return the test of each pattern of the model's residuals.

    Args: own: orthonormal tangents (n, p) of the model.
    """
    base, values = result.model.split(result.vector)
    named = result.model.base_model.residual_directions(result.model.effects, base, values)
    found = []
    for name, direction in named.items():
        basis = basis_of(left_beside(own, direction[None]), direction[None])
        if len(basis):
            square = float(np.sum((basis @ result.residuals) ** 2))
            found.append(ScoreTest(name, None, stored(basis), square, len(basis), square, {}))
    return found


def _of_effect(
    result: FitResult,
    own: Array,
    effect: Effect,
    others: Sequence[Values],
    shapes: Mapping[str, Values] | None,
    starts_alone: bool,
) -> list[ScoreTest]:
    """Return the tests of an effect at the solution, and what is new at others.

    Args: own, shapes: as `effect_tests`. others: parameters of the base model that predict the
        same. starts_alone: as `score_tests`.
    """
    base, values = result.model.split(result.vector)
    here = effect_tests(result, own, effect, base, values, shapes)
    found = list(here)
    for other in others:
        there = effect_tests(result, own, effect, other, values, shapes)
        found += [test for test in there if not _is_among(test, here)]
    if not starts_alone:
        return found
    starts = set(map(id, unlike(promising(result, found))))
    return [test if id(test) in starts else test.without_basis() for test in found]


def _is_among(test: ScoreTest, others: list[ScoreTest]) -> bool:
    """Whether another test has the same gain and p-value.

    What an effect does alike at two equivalent solutions is one test.
    """
    known = np.reshape([(other.gain, other.p_value) for other in others], (-1, 2))
    same = np.isclose(known, (test.gain, test.p_value), rtol=1e-6, atol=0)
    return bool(same.all(axis=1).any())


def promising(result: FitResult, found: list[ScoreTest]) -> list[ScoreTest]:
    """Return the tests of effects from which fits may start, the best first.

    Beside the base model alone all may: there tangents tell least of where a cause leads, and an
    effect that resembles the right one must not be left out.
    """
    alone = not result.model.effects
    mine = [t for t in found if t.effect is not None and (alone or t.gain > 0)]
    return sorted(mine, key=lambda test: -test.gain)


def unlike(found: list[ScoreTest]) -> list[ScoreTest]:
    """Return the best score tests of one effect that point to different places.

    Mirror images and neighbours point to the same. Those of other whole numbers come first: no fit
    leads from one to the next.

    Args: found: the best first. One that `score_tests` left without directions is none of them.
    """
    kept: list[ScoreTest] = []
    choices: list[list[float]] = []
    first: list[ScoreTest] = []
    later: list[ScoreTest] = []
    for test in found:
        (later if test.whole in choices else first).append(test)
        choices.append(test.whole)
    for test in [*first, *later]:
        if all(
            test.whole != other.whole
            or np.sum((test.basis @ other.basis.T) ** 2) < ALIKE * len(test.basis)
            for other in kept
        ):
            kept.append(test)
        if len(kept) == SHAPES:
            break
    return kept


def tangents_mislead(result: FitResult) -> bool:
    """Whether a base model is so far off that its tangents say little of where a cause leads."""
    return not result.model.effects and result.chi2 > THRESHOLDS.far_off**2 * result.degrees


def _same(result: FitResult, vector: Array) -> bool:
    """Whether a model predicts at another vector what it does at its own, but for rounding."""
    return bool(np.abs(result.model.residuals(vector) - result.residuals).max() < SAME)
