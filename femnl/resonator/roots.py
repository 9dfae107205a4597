"""Real roots of the Duffing amplitude equation, for whole arrays at once."""

import numpy as np
from numpy.typing import ArrayLike

from femnl.core.compiled import compiled
from femnl.core.resonator import Array

MAX_STEPS = 4
# Residual of the normalised equation below which another Newton step only moves rounding errors.
EXACT = 1e-13


def duffing_roots(detuning: ArrayLike, stiffening: ArrayLike, damping: ArrayLike = 0.0) -> Array:
    """Return every steady squared amplitude x = |b|² of a normalised Duffing resonator.

    By rising x.

    b = 1 / (δ + a x + i (1 + d x)), hence x [(δ + a x)² + (1 + d x)²] = 1.

    Args:
        detuning: δ = 2(f₀ − f)/w.
        stiffening: a; (8√3/9)·α_y/α_c for a cubic stiffness.
        damping: d ≥ 0, the nonlinear damping at x = 1 relative to the linear one.

    Returns:
        (3, …) roots with the broadcast shape of the arguments; the last two are NaN where there is
        only one.
    Source: Viète's forms of a cubic's roots (Press et al., Numerical Recipes, 5.6). For one root in
        y = 1/x, where the cubic is monic for any a; for three roots in terms of the values at the
        two folds, free of the discriminant's cancellation.
    """
    delta, a, d = np.broadcast_arrays(
        *(np.asarray(v, dtype=float) for v in (detuning, stiffening, damping))
    )
    x = np.full((3, delta.size), np.nan)
    compiled(_solve)(x, delta.ravel(), a.ravel(), d.ravel())
    return x.reshape(3, *delta.shape)


def _solve(x: Array, delta: Array, a: Array, d: Array) -> None:
    """Write the roots (3, n) at every point."""

    def polished(x: float, delta: float, a: float, d: float) -> float:
        """Take Newton steps where they lower the residual x |D|² − 1, until none gains much.

        So a root at a fold is left alone.
        """
        real = delta + a * x
        imag = 1 + d * x
        square = real * real + imag * imag
        left = x * square - 1
        for _ in range(MAX_STEPS):
            new = x - left / (square + 2 * x * (real * a + imag * d))
            real = delta + a * new
            imag = 1 + d * new
            square = real * real + imag * imag
            fresh = new * square - 1
            if not (abs(fresh) < abs(left) and new > 0):
                break
            x = new
            left = fresh
            if abs(left) <= EXACT:
                break
        return x

    for i in range(len(delta)):
        e = delta[i]
        b = a[i]
        c = d[i]
        p = b * b + c * c
        q = e * b + c
        s = e * e + 1
        third = s / 3
        spread = third * third + 2 * q / 3
        half = third * third * third + third * q + p / 2
        root = np.cbrt(
            half + np.copysign(np.sqrt(max(half * half - spread * spread * spread, 0.0)), half)
        )
        x[0, i] = polished(1 / max(third + root + spread / root, 1.0), e, b, c)
        # 4q² − 3ps, multiplied out so that its large terms cancel exactly.
        square = e * e * (b * b - 3 * c * c) + 8 * e * b * c + c * c - 3 * b * b
        if not (square > 0 and q < 0):
            continue
        centre = -2 * q / (3 * p)
        reach = np.sqrt(square) / (3 * p)
        upper = centre + reach
        lower = s / (3 * p * upper)
        above = lower * ((e + b * lower) ** 2 + (1 + c * lower) ** 2) - 1
        below = upper * ((e + b * upper) ** 2 + (1 + c * upper) ** 2) - 1
        if above >= 0 and below <= 0:  # the equation has the value 1 between its folds, too
            angle = np.arctan2(np.sqrt(-below), np.sqrt(above)) * (2 / 3)
            middle = centre + 2 * reach * np.cos(np.pi / 3 + angle)
            high = centre + 2 * reach * np.cos(np.pi / 3 - angle)
            x[0, i] = polished(1 / (p * middle * high), e, b, c)
            x[1, i] = polished(middle, e, b, c)
            x[2, i] = polished(high, e, b, c)
