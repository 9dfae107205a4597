"""Score tests: the causes and patterns to which the residuals of a fit point."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from femnl.core.effect import Effect, Values
from femnl.core.readout import Array
from femnl.diagnose.effect_tests import effect_tests
from femnl.diagnose.part_of_data import in_part
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
        would start, among all trial shapes; of a large map all take a fifth of a gigabyte. Of many
        data a part tells which these are, and only they are tested on all. run: tests effects side
        by side.
    """
    if not library and not patterns:
        return []
    own = _own_tangents(result)
    found = _of_patterns(result, own) if patterns else []
    base_model = result.model.base_model
    base, values = result.model.split(result.vector)
    others = [
        other
        for other in base_model.equivalent_solutions(base)
        if _same(result, result.model.pack(other, values))
    ]
    test: Callable[[Effect], list[ScoreTest]]
    if starts_alone:
        part = in_part(result)
        of_part = own if part is result else _own_tangents(part)
        test = partial(_starts, result, own, part, of_part, others)
    else:
        only = {name: [shape] for name, shape in shapes.items()} if shapes is not None else None
        test = partial(_of_effect, result, own, others, only)
    jobs = [
        Job(f"{base_model.kind}: testing {effect.name}", partial(test, effect))
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


def _own_tangents(result: FitResult) -> Array:
    """Return orthonormal tangents (n, p) of a model at its solution."""
    return np.asarray(np.linalg.qr(result.jacobian[:, result.free])[0])


def _of_effect(
    result: FitResult,
    own: Array,
    others: Sequence[Values],
    only: Mapping[str, Sequence[Values]] | None,
    effect: Effect,
) -> list[ScoreTest]:
    """Return the tests of an effect at the solution, and what is new at others.

    Args: own: orthonormal tangents (n, p) of the model. others: parameters of the base model that
        predict the same. only: by name of each effect, the shapes that are tested.
    """
    base, values = result.model.split(result.vector)
    shapes = None if only is None else only[effect.name]
    here = effect_tests(result, own, effect, base, values, shapes)
    found = list(here)
    for other in others:
        there = effect_tests(result, own, effect, other, values, shapes)
        found += [test for test in there if not _is_among(test, here)]
    return found


def _starts(
    result: FitResult,
    own: Array,
    part: FitResult,
    of_part: Array,
    others: Sequence[Values],
    effect: Effect,
) -> list[ScoreTest]:
    """Return the tests of an effect; those from which its fits would not start have no directions.

    Args: own, others: as `_of_effect`. part, of_part: the fit and its tangents as seen by the part
        of the data that chooses the starts; they alone are tested on all data.
    """
    found = _of_effect(part, of_part, others, None, effect)
    starts = unlike(promising(part, found))
    chosen = set(map(id, starts))
    left = [test.without_basis(len(result.residuals)) for test in found if id(test) not in chosen]
    if part is result or not starts:
        return [*starts, *left]
    shaping = [spec.name for spec in effect.parameters if not spec.strength]
    shapes = {tuple(test.values[name] for name in shaping): test.values for test in starts}
    return [*_of_effect(result, own, others, {effect.name: [*shapes.values()]}, effect), *left]


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
