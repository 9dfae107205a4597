"""Score tests of a physical cause: what it does at small strength, in each of its shapes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.optimize import lsq_linear

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.score_test import ScoreTest, basis_of, left_beside, stored
from femnl.diagnose.spread import spread
from femnl.diagnose.strength_slopes import Index, chord, tangents
from femnl.fits.least_squares import FitResult
from femnl.observe.extended import ExtendedModel

T = TypeVar("T")
N_SHAPES = 128
"""Trial shapes of an effect with parameters that only shape it."""
AT_ONCE = 16
"""Shapes that are tried at once."""
RESIDUALS_AT_ONCE = 400_000
"""Residuals of all of them; more fill the memory where data are many."""
SECANT = 0.05
"""Part of the misfit that an effect's tangent spans where the misfit is large."""


@dataclass(frozen=True)
class _Range:
    """A parameter of an effect and its bounds."""

    spec: ParameterSpec
    low: float
    high: float


def effect_tests(
    result: FitResult,
    own: Array,
    effect: Effect,
    base: Values,
    values: Sequence[Values],
    shapes: Sequence[Values] | None,
) -> list[ScoreTest]:
    """Return the tests of an effect at small strength, one for each of its shapes that shows.

    Args: own: orthonormal tangents (n, p) of the model. base, values: the parameters of the base
        model and of the model's effects, at which the effect is tried. shapes: those that are
        tried; by default they are spread over what is possible.
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
    if shapes is None:
        tried = _trial_shapes(shaping)
    else:
        tried = [_shape_of(shaping, shape) for shape in shapes]
    none = {one.spec.name: 0.0 for one in strengths}
    # An effect may lead to another summation, which rounds otherwise than the model without it
    at_zero = wider.residuals(wider.pack(base, [*values, {**tried[0], **none}]))

    def change(mine: Sequence[Values], name: str, which: Index, strength: Array) -> Array:
        """Return what a strength (k,) in some of the shapes (k,) changes of the residuals."""
        vectors = [
            wider.pack(base, [*values, {**mine[k], **none, name: size}])
            for k, size in zip(which, strength, strict=True)
        ]
        return np.array(list(wider.residuals_of_each(np.array(vectors)))) - at_zero

    for mine in _portions(tried, len(result.residuals)):
        slopes = []
        for one in strengths:
            name = one.spec.name
            by_shape, steps[name] = tangents(
                partial(change, mine, name), len(mine), steps[name], one.high, target
            )
            slopes.append(by_shape)
        # Of all shapes at once: the model's own tangents are long, and each product reads them
        of_all = left_beside(own, np.concatenate(slopes)).reshape(len(slopes), len(mine), -1)
        for k, shape in enumerate(mine):
            free = of_all[:, k]
            basis = basis_of(free, np.stack([by_shape[k] for by_shape in slopes]))
            if len(basis) == 0:  # of second order, or not to be seen at all
                rows = np.stack(
                    [
                        chord(partial(change, [shape], one.spec.name), one.low, one.high)
                        for one in strengths
                    ]
                )
                free = left_beside(own, rows)
                basis = basis_of(free, rows)
            if len(basis):
                found.append(_effect_test(result, effect, shape, strengths, free, basis))
    return found


def _portions(shapes: list[T], n_residuals: int) -> Iterator[list[T]]:
    """Yield the shapes that are tried at once: the first alone, since it finds the steps."""
    at_once = min(AT_ONCE, max(RESIDUALS_AT_ONCE // n_residuals, 1))
    yield shapes[:1]
    for first in range(1, len(shapes), at_once):
        yield shapes[first : first + at_once]


def _trial_shapes(ranges: list[_Range]) -> list[dict[str, float]]:
    """Return values of the parameters that only shape an effect, spread over their ranges.

    An effect without any has one shape.
    """
    if not ranges:
        return [{}]
    parts = spread(N_SHAPES, len(ranges))
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
    # Along the basis, where all happens
    along = basis @ result.residuals
    moved = free @ basis.T
    slopes = np.vstack([moved.T, known])
    wanted = -np.append(along, np.zeros(len(known)))
    free_of_bounds = np.linalg.lstsq(slopes, wanted, rcond=None)[0]
    allowed = np.clip(free_of_bounds, low, high)
    if len(strengths) > 1 and not np.array_equal(allowed, free_of_bounds):
        # One at its bound changes what others do best; in parts of ranges, as units differ
        width = np.subtract(high, low)
        within = lsq_linear(slopes * width, wanted, (low / width, high / width))
        allowed = np.clip(within.x * width, low, high)
    rest = along + allowed @ moved
    square = float(along @ along)
    gain = max(square - float(rest @ rest), 0.0)
    named = shape | {
        one.spec.name: float(strength) for one, strength in zip(strengths, allowed, strict=True)
    }
    return ScoreTest(effect.name, effect, stored(basis), square, len(basis), gain, named)


def _at(spec: ParameterSpec, low: float, high: float, part: float) -> float:
    """Return the value at a part of a parameter's prior."""
    value = low * (high / low) ** part if spec.log else low + (high - low) * part
    return float(np.rint(value) if spec.whole else value)
