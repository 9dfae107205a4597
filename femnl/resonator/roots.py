"""Real roots of the Duffing amplitude equation, for whole arrays at once."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femnl.core.compiled import compiled
from femnl.core.readout import ComplexArray
from femnl.core.resonator import Array

Coefficients = tuple[float, complex, float, complex, float, float]
"""δ, c, q, p, scale and the power of a mode that its own amplitude stiffens; see `self_stiffened`.
"""

# Stiffening a in b = 1/(δ + a |b|² + i) at which the response first becomes vertical.
VERTICAL = 8 * np.sqrt(3) / 9
ROUNDS = 12
"""Iterations of the amplitude under a quintic term or a resonance of higher order, which settle
where these are small corrections of the cubic one.
"""
APART = 1.05
"""Ratio of squared amplitudes between which the equation is searched for a root where they do not
settle: roots closer than this are a fold, within what noise tells.
"""
SETTLED = 1e-10
"""Relative change of a squared amplitude at which they end."""
ALIKE = 1e-8
"""Relative difference of squared amplitudes below which two states are one."""
FAINT = 1e-6
"""Squared amplitude, in that of one linewidth of stiffening, from which on a resonance of any order
acts.
"""
NEAR = 0.25
"""Relative change of a squared amplitude up to which Newton's steps stay on its branch."""
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


def self_stiffened(
    x: Array,
    detuning: Array,
    stiffening: tuple[ComplexArray, Array, ComplexArray],
    scale: Array,
    order: float,
) -> None:
    """Bring the low and the high state, x (2, n), to where their own amplitude stiffens them.

    a(x) = c + q x + p (scale·x)^(order − 2), whose imaginary part is d: each x becomes the state of
    its branch at a(x), again and again until it stays. A branch that has ended is continued. Where
    x does not stay, it is the smallest or the largest root of x |δ + i + a(x) x|² = 1.

    Args: x (2, n): changed. detuning δ (n,). stiffening: c, q and p, each (n,). scale (n,). order.
    Source: steps after every second iteration by A. C. Aitken, Proc. R. Soc. Edinb. 46, 289 (1926).
    """
    compiled(_self_stiffened)(x, detuning, stiffening, scale, float(order - 2))


def _self_stiffened(
    x: Array,
    delta: Array,
    stiffening: tuple[ComplexArray, Array, ComplexArray],
    scale: Array,
    power: float,
) -> None:
    """Write the states (2, n), each after as many iterations as it needs.

    Where another mode pulls and both states are one, there may be others beyond it, which the cubic
    term alone does not have.
    """
    cubic, fifth, pulled = stiffening
    for i in range(len(delta)):
        coefficients = (delta[i], cubic[i], fifth[i], pulled[i], scale[i], power)
        for side in range(2):
            x[side, i] = _settled(x[side, i], coefficients, side)
        if pulled[i] != 0 and abs(x[1, i] - x[0, i]) <= ALIKE * x[0, i]:
            for side in range(2):
                x[side, i] = _outermost(coefficients, side, x[side, i])


def _settled(x: float, coefficients: Coefficients, side: int) -> float:
    """Return the state of a branch that steps from x come to, the outermost where to none."""
    delta, cubic, fifth, pulled, scale, power = coefficients
    near = _by_newton(x, coefficients, side)
    if not np.isnan(near):
        return near
    here = x
    earlier = here
    for step in range(ROUNDS):
        a = cubic + fifth * here + pulled * max(here * scale, FAINT) ** power
        found = _state(delta, a.real, a.imag, side)
        if abs(found - here) <= SETTLED * found:
            return found
        if step % 2:
            earlier, here = here, _beyond(earlier, here, found)
        else:
            earlier, here = here, found
    return _outermost(coefficients, side, np.nan)


def _by_newton(x: float, coefficients: Coefficients, side: int) -> float:
    """Return the state that Newton's steps from x come to on its branch; NaN where they leave it.

    x is a state of the constant stiffening c + p; where its branch has ended it is none. A branch
    rises in x |δ + i + a(x) x|² − 1 as long as it does not fold.
    """
    delta, cubic, fifth, pulled, scale, power = coefficients
    a = cubic + pulled
    if abs(x * ((delta + a.real * x) ** 2 + (1 + a.imag * x) ** 2) - 1) > SETTLED:
        return np.nan
    here = x
    for _ in range(ROUNDS):
        pull = pulled * max(here * scale, FAINT) ** power
        a = cubic + fifth * here + pull
        rise = a + fifth * here + power * pull * (here * scale > FAINT)
        real = delta + a.real * here
        imag = 1 + a.imag * here
        square = real * real + imag * imag
        slope = square + 2 * here * (real * rise.real + imag * rise.imag)
        step = (1 - here * square) / slope
        if slope <= 0 or abs(here + step - x) > NEAR * x:
            return np.nan
        here += step
        if abs(step) <= SETTLED * here:
            return np.nan if _ends(delta, a.real, a.imag, here, side) else here
    return np.nan


def _excess(x: float, coefficients: Coefficients) -> float:
    """Return x |δ + i + a(x) x|² − 1, which is 0 at a state."""
    delta, cubic, fifth, pulled, scale, power = coefficients
    a = cubic + fifth * x + pulled * max(x * scale, FAINT) ** power
    return float(x * ((delta + a.real * x) ** 2 + (1 + a.imag * x) ** 2) - 1)


def _outermost(coefficients: Coefficients, side: int, known: float) -> float:
    """Return the smallest (side 0) or the largest (1) squared amplitude of a state.

    It is the `known` one where that lies in the stride that first meets a root.

    No damping is negative, so that all lie up to 1, and from where the largest |δ + i + a x|², that
    at x = 1 with all terms in phase, makes the least of x.
    """
    delta, cubic, fifth, pulled, scale, power = coefficients
    most = abs(delta) + 1 + abs(cubic) + abs(fifth) + abs(pulled) * max(scale, FAINT) ** power
    least = 1 / most**2
    here = 1.0 if side else least
    before = here
    sign = 1.0 if side else -1.0
    while least <= here <= 1 and sign * _excess(here, coefficients) > 0:
        before = here
        stride = _without_root(here, coefficients, side)
        here = here / stride if side else here * stride
    low, high = min(here, before), max(here, before)
    return known if low <= known <= high else _root_between(low, high, coefficients)


def _without_root(x: float, coefficients: Coefficients, side: int) -> float:
    """Return a ratio of squared amplitudes up to which, from x on, there is no root but a fold.

    With B the largest |d(a x)/dx| up to X, the larger end of a stride x…x(1 + s) with s ≤ 1,
    √x |δ + i + a x|, which is 1 at a root, changes along it by at most
    s (3 B X^(3/2) + √x |δ + i + a x|)/2.
    """
    _, cubic, fifth, pulled, scale, power = coefficients
    square = _excess(x, coefficients) + 1
    top = x if side else 2 * x
    bend = abs(cubic) + 2 * abs(fifth) * top
    bend += (1 + power) * abs(pulled) * max(scale * top, FAINT) ** power
    change = 1.5 * top**1.5 * bend + np.sqrt(square) / 2
    return float(max(APART, 1 + min(1.0, abs(1 - np.sqrt(square)) / change)))


def _root_between(
    low: float,
    high: float,
    coefficients: Coefficients,
) -> float:
    """Return the root between two squared amplitudes, by bisection."""
    rising = _excess(high, coefficients) > 0
    while high - low > SETTLED * high:
        middle = 0.5 * (low + high)
        if (_excess(middle, coefficients) > 0) == rising:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def _beyond(first: float, second: float, third: float) -> float:
    """Return where a sequence goes whose differences fall by one factor, if it goes anywhere."""
    change = third - second
    bend = change - (second - first)
    if bend == 0 or abs(change) >= abs(second - first):
        return third
    limit = third - change * change / bend
    return limit if limit > 0 else third


def continued(
    x: Array, detuning: ArrayLike, stiffening: ArrayLike, damping: ArrayLike
) -> NDArray[np.bool_]:
    """Return where the low or the high state x (2, …) has ended, and continue it there.

    Past its fold x is continued by the real part of the complex pair of roots.

    Args: x: changed; both are the single root where there is but one. Others: as `duffing_roots`.
    """
    ended = np.zeros(x.shape, dtype=bool)
    delta, a, d = (
        np.broadcast_to(np.asarray(v, dtype=float), x.shape[1:]).ravel()
        for v in (detuning, stiffening, damping)
    )
    compiled(_continued)(x.reshape(2, -1), ended.reshape(2, -1), delta, a, d)
    return ended


def _continued(x: Array, ended: NDArray[np.bool_], delta: Array, a: Array, d: Array) -> None:
    """Continue x (2, n) where a branch has ended, and mark it there."""
    for i in range(len(delta)):
        single = x[0, i]
        if x[1, i] != single:
            continue
        for side in range(2):
            if _ends(delta[i], a[i], d[i], single, side):
                ended[side, i] = True
                x[side, i] = _pair(delta[i], a[i], d[i], single)


def _state(delta: float, a: float, d: float, side: int) -> float:
    """Return the low (0) or the high (1) state, or its continuation where it has ended."""
    low, _, high = _roots_at(delta, a, d)
    if not np.isnan(high):
        return _polished(high if side else low, delta, a, d)
    single = _polished(low, delta, a, d)
    return _pair(delta, a, d, single) if _ends(delta, a, d, single, side) else single


def _ends(delta: float, a: float, d: float, single: float, side: int) -> bool:
    """Whether the low or the high state has ended where there is a single root."""
    square, q = _discriminant(delta, a, d)
    # Below the critical stiffening no branch ends.
    if not (abs(a) > VERTICAL and square > 0 and q < 0):
        return False
    return bool((single > -2 * q / (3 * (a * a + d * d))) == (side == 0))


def _pair(delta: float, a: float, d: float, single: float) -> float:
    """Return the real part of the complex pair of roots beside a single one."""
    return -(delta * a + d) / (a * a + d * d) - single / 2


def _discriminant(delta: float, a: float, d: float) -> tuple[float, float]:
    """Return a square that is above 0 where the states have folds, and q = δa + d."""
    # 4q² − 3ps, multiplied out so that its large terms cancel exactly.
    square = delta * delta * (a * a - 3 * d * d) + 8 * delta * a * d + d * d - 3 * a * a
    return square, delta * a + d


def _solve(x: Array, delta: Array, a: Array, d: Array) -> None:
    """Write the roots (3, n) at every point."""
    for i in range(len(delta)):
        x[0, i], x[1, i], x[2, i] = _roots_at(delta[i], a[i], d[i])
        x[0, i] = _polished(x[0, i], delta[i], a[i], d[i])
        if not np.isnan(x[2, i]):
            x[1, i] = _polished(x[1, i], delta[i], a[i], d[i])
            x[2, i] = _polished(x[2, i], delta[i], a[i], d[i])


def _roots_at(delta: float, a: float, d: float) -> tuple[float, float, float]:
    """Return the roots at one point by rising x, but for rounding; NaN where there is none."""
    p = a * a + d * d
    square, q = _discriminant(delta, a, d)
    s = delta * delta + 1
    third = s / 3
    spread = third * third + 2 * q / 3
    half = third * third * third + third * q + p / 2
    root = np.cbrt(
        half + np.copysign(np.sqrt(max(half * half - spread * spread * spread, 0.0)), half)
    )
    single = 1 / max(third + root + spread / root, 1.0)
    if not (square > 0 and q < 0):
        return single, np.nan, np.nan
    centre = -2 * q / (3 * p)
    reach = np.sqrt(square) / (3 * p)
    upper = centre + reach
    lower = s / (3 * p * upper)
    above = lower * ((delta + a * lower) ** 2 + (1 + d * lower) ** 2) - 1
    below = upper * ((delta + a * upper) ** 2 + (1 + d * upper) ** 2) - 1
    # The equation has the value 1 between its folds, too
    if not (above >= 0 and below <= 0):
        return single, np.nan, np.nan
    angle = np.arctan2(np.sqrt(-below), np.sqrt(above)) * (2 / 3)
    middle = centre + 2 * reach * np.cos(np.pi / 3 + angle)
    high = centre + 2 * reach * np.cos(np.pi / 3 - angle)
    return 1 / (p * middle * high), middle, high


def _polished(x: float, delta: float, a: float, d: float) -> float:
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
