"""Real roots of the Duffing amplitude equation, for whole arrays at once."""

import numpy as np
from numpy.typing import ArrayLike

from femnl.types.resonator import Array

MAX_STEPS = 4
# Residual of the normalised equation below which another Newton step only moves rounding errors.
EXACT = 1e-13


def duffing_roots(detuning: ArrayLike, stiffening: ArrayLike, damping: ArrayLike = 0.0) -> Array:
    """Return every steady squared amplitude x = |b|² of a normalised Duffing resonator, by rising x.

    b = 1 / (δ + a x + i (1 + d x)), hence x [(δ + a x)² + (1 + d x)²] = 1.

    Args:
        detuning: δ = 2(f₀ − f)/w.
        stiffening: a; (8√3/9)·α_y/α_c for a cubic stiffness.
        damping: d ≥ 0, the nonlinear damping at x = 1 relative to the linear one.

    Returns:
        (3, …) roots with the broadcast shape of the arguments; the last two are NaN where there is only one.
    Source: Viète's forms of a cubic's roots (Press et al., Numerical Recipes, 5.6). For one root in y = 1/x, where the cubic
        is monic for any a; for three roots in terms of the values at the two folds, free of the discriminant's cancellation.
    """
    delta, a, d = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (detuning, stiffening, damping)))
    p, q, s = a**2 + d**2, delta * a + d, delta**2 + 1
    third = s / 3
    spread = third**2 + 2 * q / 3
    half = third**3 + third * q + p / 2
    root = np.cbrt(half + np.copysign(np.sqrt(np.maximum(half**2 - spread**3, 0.0)), half))
    single = _polish(1 / np.maximum(third + root + spread / root, 1.0), delta, a, d)
    x = np.full((3, *delta.shape), np.nan)
    x[0] = single
    # 4q² − 3ps, multiplied out so that its large terms cancel exactly.
    square = delta**2 * (a**2 - 3 * d**2) + 8 * delta * a * d + d**2 - 3 * a**2
    folds = (square > 0) & (q < 0)
    if folds.any():
        x[:, folds] = _between_folds(single[folds], delta[folds], a[folds], d[folds], square[folds])
    return x


def _between_folds(single: Array, delta: Array, a: Array, d: Array, square: Array) -> Array:
    """Return three roots where the amplitude equation, which has two folds here, has the value 1 between them, else the single one."""
    p, q = a**2 + d**2, delta * a + d
    centre, reach = -2 * q / (3 * p), np.sqrt(square) / (3 * p)
    upper = centre + reach
    lower = (delta**2 + 1) / (3 * p * upper)
    above, below = (fold * ((delta + a * fold) ** 2 + (1 + d * fold) ** 2) - 1 for fold in (lower, upper))
    three = (above >= 0) & (below <= 0)
    angle = np.arctan2(np.sqrt(np.maximum(-below, 0.0)), np.sqrt(np.maximum(above, 0.0))) * (2 / 3)
    middle = centre + 2 * reach * np.cos(np.pi / 3 + angle)
    high = centre + 2 * reach * np.cos(np.pi / 3 - angle)
    x = np.full((3, len(p)), np.nan)
    x[0] = single
    x[:, three] = np.stack([1 / (p * middle * high), middle, high])[:, three]
    x[:, three] = _polish(x[:, three], delta[three], a[three], d[three])
    return x


def _polish(x: Array, delta: Array, a: Array, d: Array) -> Array:
    """Take Newton steps where they lower the residual, so that a root at a fold is left alone, until none gains much."""
    residual, slope = _excess(x, delta, a, d)
    for _ in range(MAX_STEPS):
        with np.errstate(invalid="ignore", divide="ignore"):
            new = x - residual / slope
        fresh, fresh_slope = _excess(new, delta, a, d)
        better = (np.abs(fresh) < np.abs(residual)) & (new > 0)
        x, residual, slope = np.where(better, new, x), np.where(better, fresh, residual), np.where(better, fresh_slope, slope)
        if not np.any(better & (np.abs(residual) > EXACT)):
            break
    return x


def _excess(x: Array, delta: Array, a: Array, d: Array) -> tuple[Array, Array]:
    """Return x |D|² − 1 and its derivative by x."""
    real, imag = delta + a * x, 1 + d * x
    square = real**2 + imag**2
    return x * square - 1, square + 2 * x * (real * a + imag * d)
