"""Is a model adequate? One p-value for all score tests, and the causes that they point to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, erfc
from scipy.stats import norm
from scipy.stats.qmc import Sobol

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import FitResult
from femnl.observe.model import ExtendedModel

N_DRAWS = 4000
"""Simulated sets of residuals that calibrate the p-value."""
N_SHAPES = {0: 1, 1: 128, 2: 128, 3: 128}
"""Trial shapes of an effect with that many parameters that only shape it."""
SECANT = 0.05
"""Part of the misfit that an effect's tangent spans where the misfit is large."""
CHORD = 0.02
"""Part of its range at which the size of a strength is tried that has no slope at zero."""
LEAST = 1e-11
MOST = 0.01
"""Steps of a strength at zero, in parts of its range."""
VISIBLE = 1e-6
"""Part of an effect's tangent that must be left beside the model's own for the data to see it."""
SAME = 1e-6
"""Largest difference of residuals up to which two places in a model predict the same."""
TAIL = 20
"""Simulated sets in the tail below which the p-value is extrapolated."""
CERTAIN = 1e-6
"""p-value, by Bonferroni's inequality, below which none is simulated."""
EXACT = 5000
"""Residuals up to which whole sets of them are drawn; beyond, only what tests see of them."""


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


def score_tests(result: FitResult, library: list[Effect]) -> list[ScoreTest]:
    """Return every score test of the residuals.

    Each pattern of the problem, and each effect at each of its trial shapes.
    """
    own, _ = np.linalg.qr(result.jacobian[:, result.free])
    base_model = result.model.base_model
    found = []
    for name, direction in base_model.residual_directions(
        result.model.effects, *result.model.split(result.vector)
    ).items():
        basis = _beside(own, direction[None])
        if len(basis):
            gain = float(np.sum((basis @ result.residuals) ** 2))
            found.append(
                ScoreTest(name, None, basis, gain, float(_tail(np.array(gain), len(basis))), {})
            )
    base, values = result.model.split(result.vector)
    others = [
        other
        for other in base_model.equivalent_solutions(base)
        if _same(result, result.model.pack(other, values))
    ]
    for effect in library:
        if any(spec.strength for spec in effect.parameters):
            here, *there = (
                _effect_tests(result, own, effect, place, values) for place in (base, *others)
            )
            found += here
            known = np.array([(test.gain, test.p_value) for test in here])
            for test in (test for elsewhere in there for test in elsewhere):
                if (
                    not np.isclose(known, (test.gain, test.p_value), rtol=1e-6, atol=0)
                    .all(axis=1)
                    .any()
                ):
                    found.append(test)  # what an effect does alike on either side is one test
    return found


def tangents_mislead(result: FitResult) -> bool:
    """Whether a base model is so far off that its tangents say little of where a cause leads."""
    return not result.model.effects and result.chi2 > THRESHOLDS.far_off**2 * result.degrees


def _same(result: FitResult, vector: Array) -> bool:
    """Whether a model predicts at another vector what it does at its own, but for rounding."""
    return bool(np.abs(result.model.residuals(vector) - result.residuals).max() < SAME)


def _effect_tests(
    result: FitResult, own: Array, effect: Effect, base: Values, values: Sequence[Values]
) -> list[ScoreTest]:
    """Try the effect at small strength in each of its shapes.

    At these values of the base parameters and of the model's effects.
    """
    wider = ExtendedModel(result.model.base_model, (*result.model.effects, effect))
    low, high = wider.bounds
    first = len(low) - len(effect.parameters)
    bounds = list(zip(effect.parameters, low[first:], high[first:], strict=True))
    shaping = [(spec, a, b) for spec, a, b in bounds if not spec.strength]
    strengths = [(spec, a, b) for spec, a, b in bounds if spec.strength]
    trials = (
        Sobol(len(shaping), rng=np.random.default_rng(0)).random(N_SHAPES[len(shaping)])
        if shaping
        else np.zeros((1, 0))
    )
    found = []
    steps = {spec.name: 1e-6 * b for spec, _, b in strengths}
    excess = float(result.residuals @ result.residuals) - len(result.residuals)
    target = max(0.1, SECANT * max(excess, 0.0) ** 0.5)
    for trial in trials:
        shape = {k.name: _at(k, a, b, t) for (k, a, b), t in zip(shaping, trial, strict=True)}
        zero = shape | {spec.name: 0.0 for spec, _, _ in strengths}

        def change(name: str, strength: float, idle: Values = zero) -> Array:
            at_strength = wider.pack(base, [*values, {**idle, name: strength}])
            return np.asarray(wider.residuals(at_strength) - result.residuals)

        tangents = np.stack(
            [
                _tangent(partial(change, spec.name), spec.name, steps, b, target)
                for spec, _, b in strengths
            ]
        )
        basis = _beside(own, tangents)
        if len(basis) == 0:  # of second order, or not to be seen at all
            tangents = np.stack(
                [_chord(partial(change, spec.name), a, b) for spec, a, b in strengths]
            )
            basis = _beside(own, tangents)
        if len(basis) == 0:
            continue
        free = tangents - (tangents @ own) @ own.T
        # What the priors know of strengths that hardly show
        known = np.diag([np.sqrt(12) / (b - a) for _, a, b in strengths])
        estimate = -np.linalg.lstsq(
            np.vstack([free.T, known]),
            np.append(result.residuals, np.zeros(len(known))),
            rcond=None,
        )[0]
        allowed = np.clip(estimate, [a for _, a, _ in strengths], [b for _, _, b in strengths])
        rest = result.residuals + allowed @ free
        gain = max(result.chi2 - float(rest @ rest), 0.0)
        named = shape | {
            spec.name: float(s) for (spec, _, _), s in zip(strengths, allowed, strict=True)
        }
        freely = float(np.sum((basis @ result.residuals) ** 2))
        found.append(
            ScoreTest(
                effect.name, effect, basis, gain, float(_tail(np.array(freely), len(basis))), named
            )
        )
    return found


def _at(spec: ParameterSpec, low: float, high: float, part: float) -> float:
    """Return the value at a part of a parameter's prior."""
    value = low * (high / low) ** part if spec.log else low + (high - low) * part
    return float(np.rint(value) if spec.whole else value)


def _tangent(
    change: Callable[[float], Array],
    name: str,
    steps: dict[str, float],
    high: float,
    target: float,
) -> Array:
    """Return the derivative of the residuals by one strength at zero.

    The step that did is kept for the next shape.

    An effect that grows as the square of its strength has none there: the larger the misfit, the
    longer the secant. Where modes exchange labels at once no step does: the direction of the jump
    is returned, and other shapes do not begin with the step that sought it.

    Args: change: of the residuals by a strength. name: of the strength. steps: by name, where to
        begin; changed. high: the largest strength. target: size of the change that a step makes.
    """
    step = steps[name]
    for _ in range(5):
        moved = change(step)
        size = float(np.linalg.norm(moved))
        used = step
        if 0.1 < size / target < 10:
            steps[name] = used
            break
        step = float(
            np.clip(
                step * np.clip(target / max(size, 1e-300), 1e-4, 1e4), LEAST * high, MOST * high
            )
        )
        if step == used:
            break
    return np.asarray(moved / used)


def _chord(change: Callable[[float], Array], low: float, high: float) -> Array:
    """Return the change of the residuals per strength at a finite strength."""
    step = CHORD * (high - max(low, 0.0))
    return np.asarray(change(step) / step)


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


def adequacy(result: FitResult, found: list[ScoreTest]) -> tuple[float, str]:
    """Return the calibrated p-value of a model, and the test that speaks most against it.

    The statistic is the smallest p-value of all tests: χ², every direction and effect, the largest
    outlier, and the correlation of neighbours. Its distribution follows from residuals simulated by
    the model itself: what white noise leaves beside the tangents.
    """
    seen = _p_values(result.residuals[None], result.degrees, found)[0]
    names = [*(test.name for test in found), "chi-square", "outlier", "neighbours"]
    k = int(np.argmin(seen))
    bound = float(seen[k]) * len(names)
    if bound < CERTAIN:
        return bound, names[k]
    rng = np.random.default_rng(20)
    drawn = (
        _simulated(result, found, rng)
        if len(result.residuals) <= EXACT
        else _simulated_large(result, found, rng)
    )
    smallest = np.sort(drawn.min(axis=1))
    below = int(np.searchsorted(smallest, seen[k], side="right"))
    if below >= TAIL:
        return below / N_DRAWS, names[k]
    # In the far tail the tests are as good as exclusive, so that p is proportional to the smallest
    # p-value.
    return float(min(1.0, seen[k] * TAIL / N_DRAWS / smallest[TAIL - 1])), names[k]


def _tail(square: Array, degrees: int | NDArray[np.int64]) -> Array:
    """Probability of a larger χ², by closed forms where there are any.

    It is asked for a million times.
    """
    if np.ndim(degrees):
        return np.stack(
            [
                _tail(column, int(d))
                for column, d in zip(square.T, np.asarray(degrees), strict=True)
            ],
            axis=1,
        )
    if degrees == 1:
        return np.asarray(erfc(np.sqrt(square / 2)))
    return np.asarray(np.exp(-square / 2) if degrees == 2 else chdtrc(degrees, square))


def _p_values(residuals: Array, degrees: int, found: list[ScoreTest]) -> Array:
    """Return the p-values of every test, (m, n_tests + 3).

    The last three are those of χ², of the largest outlier and of the neighbours' correlation.
    """
    n = residuals.shape[1]
    columns = [*_tested(residuals, found).T]
    columns.append(_tail(np.sum(residuals**2, axis=1), degrees))
    largest = np.abs(residuals).max(axis=1) * np.sqrt(n / degrees)
    # Data without noise: the logarithm of 0 is what it should be
    with np.errstate(divide="ignore"):
        columns.append(-np.expm1(n * np.log1p(-2 * norm.sf(largest))))
    neighbours = np.abs(np.sum(residuals[:, 1:] * residuals[:, :-1], axis=1)) / np.sqrt(n)
    columns.append(2 * norm.sf(neighbours))
    return np.stack(columns, axis=1)


def _tested(residuals: Array, found: list[ScoreTest]) -> Array:
    """Return the p-values (m, n_tests) of score tests alone."""
    if not found:
        return np.empty((len(residuals), 0))
    # In one product: a long row is read once for all tests
    squares = (residuals @ np.concatenate([test.basis for test in found]).T) ** 2
    sizes = np.array([len(test.basis) for test in found])
    return _tail(np.add.reduceat(squares, np.cumsum(sizes) - sizes, axis=1), sizes)


def _simulated(result: FitResult, found: list[ScoreTest], rng: np.random.Generator) -> Array:
    """Draw residuals as white noise beside the model's tangents, and test them.

    They are ranked as the data are.
    """
    own, _ = np.linalg.qr(result.jacobian[:, result.free])
    noise = rng.standard_normal((N_DRAWS, len(result.residuals)))
    for ranked in result.model.base_model.ranked:
        ranked.rank(result.residuals, noise)
    return _p_values(noise - (noise @ own) @ own.T, result.degrees, found)


def _simulated_large(result: FitResult, found: list[ScoreTest], rng: np.random.Generator) -> Array:
    """The same for long data, drawn in the space that the tests span.

    Outlier and neighbours are as good as independent of it.
    """
    basis = np.concatenate([test.basis for test in found])
    values, vectors = np.linalg.eigh(basis @ basis.T)
    kept = values > 1e-10
    drawn = rng.standard_normal((N_DRAWS, int(kept.sum())))
    squares = (drawn @ (vectors[:, kept] * np.sqrt(values[kept])).T) ** 2
    ends = np.cumsum([len(test.basis) for test in found])
    sizes = np.diff(ends, prepend=0)
    tested = _tail(np.add.reduceat(squares, ends - sizes, axis=1), sizes)
    total = np.sum(drawn**2, axis=1) + rng.chisquare(result.degrees - int(kept.sum()), N_DRAWS)
    return np.column_stack([tested, _tail(total, result.degrees), rng.uniform(size=(N_DRAWS, 2))])
