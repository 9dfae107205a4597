"""Score tests: the causes and patterns to which the residuals of a fit point."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.special import chdtrc, erfc
from scipy.stats.qmc import Sobol

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.strength_slopes import Index, chord, tangents
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import FitResult
from femnl.observe.extended import ExtendedModel

T = TypeVar("T")
N_SHAPES = {0: 1, 1: 128, 2: 128, 3: 128}
"""Trial shapes of an effect with that many parameters that only shape it."""
AT_ONCE = 16
"""Shapes that are tried at once; more of them fill the memory where data are many."""
SECANT = 0.05
"""Part of the misfit that an effect's tangent spans where the misfit is large."""
VISIBLE = 1e-6
"""Part of an effect's tangent that must be left beside the model's own for the data to see it."""
SHAPES = 4
ALIKE = 0.98
"""Trial shapes of an effect that are starts of its fit, and the square of the cosine from which on
two are the same to the data.
"""
SAME = 1e-6
"""Largest difference of residuals up to which two places in a model predict the same."""


@dataclass(frozen=True)
class ScoreTest:
    """One direction (or a few) in which residuals may deviate.

    Gain in χ² from going there, its p-value, and where a fit would start.

    effect: None for a pattern. basis (q, n): orthonormal, free of the model's tangents. strengths,
    shape: linear estimate of the effect.
    """

    name: str
    effect: Effect | None
    basis: Array
    gain: float
    p_value: float
    values: dict[str, float]

    @property
    def whole(self) -> list[float]:
        """Values of those parameters that are whole numbers."""
        return [
            self.values[spec.name]
            for spec in (self.effect.parameters if self.effect else ())
            if spec.whole
        ]


def score_tests(
    result: FitResult,
    library: list[Effect],
    shapes: Mapping[str, Values] | None = None,
    *,
    patterns: bool = True,
) -> list[ScoreTest]:
    """Return every score test of the residuals.

    Each pattern of the model is tested once, and each effect at each of its trial shapes.

    Args: shapes: by name of each effect, values of its parameters; each is tested in this one
        shape. By default it is tested in all trial shapes. patterns: whether patterns are tested.
    """
    if not library and not patterns:
        return []
    own, _ = np.linalg.qr(result.jacobian[:, result.free])
    base_model = result.model.base_model
    found = []
    at = result.model.split(result.vector)
    named = base_model.residual_directions(result.model.effects, *at) if patterns else {}
    for name, direction in named.items():
        basis = _beside(own, direction[None])
        if len(basis):
            gain = float(np.sum((basis @ result.residuals) ** 2))
            found.append(
                ScoreTest(
                    name, None, basis, gain, float(chi_square_tail(np.array(gain), len(basis))), {}
                )
            )
    base, values = result.model.split(result.vector)
    others = [
        other
        for other in base_model.equivalent_solutions(base)
        if _same(result, result.model.pack(other, values))
    ]
    for effect in library:
        if effect.has_strength:
            here, *there = (
                _effect_tests(result, own, effect, place, values, shapes)
                for place in (base, *others)
            )
            found += here
            found += [
                test for elsewhere in there for test in elsewhere if not _is_among(test, here)
            ]
    return found


def _is_among(test: ScoreTest, others: list[ScoreTest]) -> bool:
    """Whether another test has the same gain and p-value.

    What an effect does alike at two equivalent solutions is one test.
    """
    known = np.reshape([(other.gain, other.p_value) for other in others], (-1, 2))
    same = np.isclose(known, (test.gain, test.p_value), rtol=1e-6, atol=0)
    return bool(same.all(axis=1).any())


def unlike(found: list[ScoreTest]) -> list[ScoreTest]:
    """Return the best score tests of one effect that point to different places.

    Mirror images and neighbours point to the same. Those of other whole numbers come first: no fit
    leads from one to the next.

    Args: found: the best first.
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


@dataclass(frozen=True)
class _Range:
    """A parameter of an effect and its bounds."""

    spec: ParameterSpec
    low: float
    high: float


def _effect_tests(
    result: FitResult,
    own: Array,
    effect: Effect,
    base: Values,
    values: Sequence[Values],
    shapes: Mapping[str, Values] | None,
) -> list[ScoreTest]:
    """Return the tests of an effect at small strength, one for each of its shapes that shows.

    Args: own: orthonormal tangents (n, p) of the model. base, values: the parameters of the base
        model and of the model's effects, at which the effect is tried. shapes: as `score_tests`.
    """
    wider = ExtendedModel(result.model.base_model, (*result.model.effects, effect))
    low, high = wider.bounds
    first = len(low) - len(effect.parameters)
    ranges = [
        _Range(spec, float(a), float(b))
        for spec, a, b in zip(effect.parameters, low[first:], high[first:], strict=True)
    ]
    strengths = [one for one in ranges if one.spec.strength]
    excess = float(result.residuals @ result.residuals) - len(result.residuals)
    target = max(0.1, SECANT * max(excess, 0.0) ** 0.5)
    steps = {one.spec.name: 1e-6 * one.high for one in strengths}
    found = []
    shaping = [one for one in ranges if not one.spec.strength]
    tried = _trial_shapes(shaping) if shapes is None else [_shape_of(shaping, shapes[effect.name])]
    none = {one.spec.name: 0.0 for one in strengths}

    def change(mine: Sequence[Values], name: str, which: Index, strength: Array) -> Array:
        """Return what a strength (k,) in some of the shapes (k,) changes of the residuals."""
        vectors = [
            wider.pack(base, [*values, {**mine[k], **none, name: size}])
            for k, size in zip(which, strength, strict=True)
        ]
        return np.array(list(wider.residuals_of_each(np.array(vectors)))) - result.residuals

    for mine in _portions(tried):
        slopes = []
        for one in strengths:
            name = one.spec.name
            by_shape, steps[name] = tangents(
                partial(change, mine, name), len(mine), steps[name], one.high, target
            )
            slopes.append(by_shape)
        for k, shape in enumerate(mine):
            rows = np.stack([by_shape[k] for by_shape in slopes])
            basis = _beside(own, rows)
            if len(basis) == 0:  # of second order, or not to be seen at all
                rows = np.stack(
                    [
                        chord(partial(change, [shape], one.spec.name), one.low, one.high)
                        for one in strengths
                    ]
                )
                basis = _beside(own, rows)
            if len(basis):
                free = rows - (rows @ own) @ own.T
                found.append(_effect_test(result, effect, shape, strengths, free, basis))
    return found


def _portions(shapes: list[T]) -> Iterator[list[T]]:
    """Yield the shapes that are tried at once: the first alone, since it finds the steps."""
    yield shapes[:1]
    for first in range(1, len(shapes), AT_ONCE):
        yield shapes[first : first + AT_ONCE]


def _trial_shapes(ranges: list[_Range]) -> list[dict[str, float]]:
    """Return values of the parameters that only shape an effect, spread over their ranges.

    An effect without any has one shape.
    """
    if not ranges:
        return [{}]
    parts = Sobol(len(ranges), rng=np.random.default_rng(0)).random(N_SHAPES[len(ranges)])
    return [
        {one.spec.name: _at(one.spec, one.low, one.high, part) for one, part in pairs}
        for pairs in (list(zip(ranges, row, strict=True)) for row in parts)
    ]


def _shape_of(ranges: list[_Range], values: Values) -> dict[str, float]:
    """Return the values, among others, of the parameters that only shape an effect."""
    return {one.spec.name: float(values[one.spec.name]) for one in ranges}


def _effect_test(
    result: FitResult,
    effect: Effect,
    shape: dict[str, float],
    strengths: list[_Range],
    free: Array,
    basis: Array,
) -> ScoreTest:
    """Return the test of an effect of one shape.

    Its gain is that of the strengths of least χ² within their bounds, in the linear approximation.

    Args: free (k, n): derivatives of the residuals by the strengths, less what the model's own
        tangents reach. basis (q, n): orthonormal, of the space that they span.
    """
    low = [one.low for one in strengths]
    high = [one.high for one in strengths]
    # What the priors know of strengths that hardly show
    known = np.diag(np.sqrt(12) / np.subtract(high, low))
    estimate = -np.linalg.lstsq(
        np.vstack([free.T, known]),
        np.append(result.residuals, np.zeros(len(known))),
        rcond=None,
    )[0]
    allowed = np.clip(estimate, low, high)
    rest = result.residuals + allowed @ free
    gain = max(result.chi2 - float(rest @ rest), 0.0)
    named = shape | {
        one.spec.name: float(strength) for one, strength in zip(strengths, allowed, strict=True)
    }
    explained = np.array(float(np.sum((basis @ result.residuals) ** 2)))
    p_value = float(chi_square_tail(explained, len(basis)))
    return ScoreTest(effect.name, effect, basis, gain, p_value, named)


def _at(spec: ParameterSpec, low: float, high: float, part: float) -> float:
    """Return the value at a part of a parameter's prior."""
    value = low * (high / low) ** part if spec.log else low + (high - low) * part
    return float(np.rint(value) if spec.whole else value)


def _beside(own: Array, tangents: Array) -> Array:
    """Return an orthonormal basis of what the tangents reach that the model itself does not."""
    size = np.linalg.norm(tangents, axis=1, keepdims=True)
    unit = tangents / np.where(size > 0, size, 1)
    free = unit - (unit @ own) @ own.T
    # Most are, and a decomposition of so long a row takes longer than the predictions
    if len(free) == 1:
        strength = np.linalg.norm(free, axis=1)
        return np.asarray(free[strength > np.sqrt(VISIBLE)] / strength)
    _, strength, right = np.linalg.svd(free, full_matrices=False)
    return np.asarray(right[strength > np.sqrt(VISIBLE)])


def chi_square_tail(square: Array, degrees: int) -> Array:
    """Return the probability of a larger χ², by closed forms where there are any."""
    if degrees == 1:
        return np.asarray(erfc(np.sqrt(square / 2)))
    return np.asarray(np.exp(-square / 2) if degrees == 2 else chdtrc(degrees, square))
