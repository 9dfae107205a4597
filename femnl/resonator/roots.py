"""Real roots of the Duffing amplitude equation, for whole arrays at once."""

import numpy as np
from numpy.typing import ArrayLike

from femnl.types.resonator import Array


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
    x = np.full((3, *delta.shape), np.nan)
    x[0] = 1 / np.maximum(third + root + spread / root, 1.0)
    # 4q² − 3ps, multiplied out so that its large terms cancel exactly.
    square = delta**2 * (a**2 - 3 * d**2) + 8 * delta * a * d + d**2 - 3 * a**2
    folds = (square > 0) & (q < 0)
    if folds.any():
        x[:, folds] = _between_folds(x[:, folds], delta[folds], a[folds], d[folds], square[folds])
    for _ in range(3):
        x = _polish(x, delta, a, d)
    return x


def _between_folds(x: Array, delta: Array, a: Array, d: Array, square: Array) -> Array:
    """Fill in three roots where the amplitude equation, which has two folds here, has the value 1 between them."""
    p, q = a**2 + d**2, delta * a + d
    centre, reach = -2 * q / (3 * p), np.sqrt(square) / (3 * p)
    upper = centre + reach
    lower = (delta**2 + 1) / (3 * p * upper)
    above, below = (fold * ((delta + a * fold) ** 2 + (1 + d * fold) ** 2) - 1 for fold in (lower, upper))
    three = (above >= 0) & (below <= 0)
    angle = np.arctan2(np.sqrt(np.maximum(-below, 0.0)), np.sqrt(np.maximum(above, 0.0))) * (2 / 3)
    middle = centre + 2 * reach * np.cos(np.pi / 3 + angle)
    high = centre + 2 * reach * np.cos(np.pi / 3 - angle)
    return np.where(three, np.stack([1 / (p * middle * high), middle, high]), x)


def _polish(x: Array, delta: Array, a: Array, d: Array) -> Array:
    """Take one Newton step where it lowers the residual, so that a root at a fold is left alone."""
    real, imag = delta + a * x, 1 + d * x
    square = real**2 + imag**2
    residual = x * square - 1
    with np.errstate(invalid="ignore", divide="ignore"):
        new = x - residual / (square + 2 * x * (real * a + imag * d))
        better = np.abs(new * ((delta + a * new) ** 2 + (1 + d * new) ** 2) - 1) < np.abs(residual)
    return np.where(better & (new > 0), new, x)
