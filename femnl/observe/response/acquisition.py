"""What a finite speed of sweeping leaves of earlier points: in the mode, and in the lock-in.

The drive rests at each frequency for a time T, steps to the next without a jump of its phase, and
the point is taken at the end of T.
"""

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array, ComplexArray

NEAR = 0.02
"""Deviation from a branch that is continued beyond its fold, in parts of it, up to which it decays
as a linear one: no motion rests there, and the misfit there only tells a fit which way to go.
"""
LEFT_OUT = 3e-6
"""Amplitude, in that of the linear motion at resonance, that a deviation may end wrong by where it
decays as a linear one.
"""
ORDER = 20
"""Terms of one step's power series."""
TERM = 1e-9
"""Largest size of its last terms."""
TURNS = 1e4
"""Phase and decay [rad] of one rest at most: a motion that turns more is nowhere but in the trials
of a fit.
"""
REST = 1e-6
"""Change in one time of decay, in parts of the amplitude, below which the motion is at rest."""
LONG = 20.0
"""Rest, in times of decay, after which no deviation is left."""


def settle(
    found: ComplexArray,
    steady: ComplexArray,
    delta: Array,
    stiffening: ComplexArray,
    rest: Array,
    begins: NDArray[np.bool_],
) -> None:
    """Write into `found` (n,) the amplitude at the end of each rest, in the order of time.

    db/ds = i((δ + a|b|² + i)b − 1), s = πwt: a small deviation from the steady b decays in closed
    form, a larger one, as after a jump, by steps of its power series.

    Args: steady b (n,) [parts of the linear amplitude at resonance]; delta δ, stiffening a (n,);
        rest (n,): πwT; begins (n,): whether a sweep begins there, at its steady amplitude.
    """
    series = np.zeros((3, ORDER + 1))
    for k in range(len(steady)):
        b = steady[k]
        if begins[k]:
            found[k] = b
            continue
        a = stiffening[k]
        y = found[k - 1]
        left = min(rest[k], LONG)
        # The motion turns less than that in one time of decay, wherever it is
        turns = abs(delta[k]) + 3 * abs(a) * max(abs(y), abs(b)) ** 2 + 1
        if not left * turns < TURNS:
            found[k] = b + (y - b) * np.exp(-left)
            continue
        rate = _close_to(b, delta[k], a)
        near = False
        if abs((delta[k] + a * abs(b) ** 2 + 1j) * b - 1) >= REST:
            # Beyond its fold a branch is continued, and nothing rests there
            near = rate.real > 0 and abs(y - b) <= NEAR * abs(b)
            rate = complex(0.0, 1.0)
        if not near:
            near, y, left = _approach(y, b, (delta[k], a), left, rate, series)
        found[k] = _decayed(y, b, (delta[k], a), left) if near else y


def _close_to(b: complex, delta: float, a: complex) -> complex:
    """Return how a small deviation from b decays: its slowest rate, and how far it swells before.

    Beside a state that does not last the rate is not above 0: there a deviation grows until it is
    no small one. Near a fold one swells before it decays.
    """
    x = b.real**2 + b.imag**2
    q = abs(a) * x
    turn = delta + 2 * a.real * x
    fast = np.sqrt(complex(q**2 - turn**2))
    swells = 1 + (abs(turn) + q) / max(abs(fast), 1e-3)
    return complex(1 + 2 * a.imag * x - fast.real, swells)


def _approach(
    y: complex, b: complex, flow: tuple[float, complex], left: float, rate: complex, series: Array
) -> tuple[bool, complex, float]:
    """Follow the motion from y for a time, or until it is close enough to b to decay as near it.

    What the closed form leaves out, ia(2b|ε|² + b*ε² + |ε|²ε), decays with the deviation ε: after a
    rest of L it is at most |a|(3|b||ε|² + |ε|³) min(L, 1/μ) e^{−μL}, μ the slowest rate of decay.

    Args: flow: δ and a. rate: see `_close_to`; without a positive real part nothing rests at b.
        series: room for `_expand`.
    Returns: whether it is as close as that, where it is by then, and the time that is left.
    """
    delta, a = flow
    slowest = rate.real
    while left > 0:
        if slowest > 0:
            off = abs(y - b)
            pull = abs(a) * off * (3 * abs(b) + off)
            kept = pull * off * np.exp(-slowest * left) * min(left, 1 / slowest)
            if kept * rate.imag**2 < LEFT_OUT:
                return True, y, left
        order, step = _expand(series, y, delta, a, left)
        # Settled, on another branch than the steady one here
        if abs(complex(series[0, 1], series[1, 1])) < REST * abs(y):
            break
        y = complex(series[0, order], series[1, order])
        for j in range(order - 1, -1, -1):
            y = y * step + complex(series[0, j], series[1, j])
        left -= step
    return False, y, left


def _expand(series: Array, y: complex, delta: float, a: complex, left: float) -> tuple[int, float]:
    """Write the power series of the motion from y: real and imaginary parts, and |y|².

    The flow is a polynomial in b and b*, so that each coefficient follows from those before it.

    Args: series (3, ORDER + 1), filled in. left: the longest step that is asked for.
    Returns: the order, and the step that keeps the last two terms below `TERM`.
    Source: A. Jorba and M. Zou, Exp. Math. 14, 99 (2005).
    """
    re, im, square = series[0], series[1], series[2]
    re[0] = y.real
    im[0] = y.imag
    power = 1.0
    last = np.inf
    for k in range(ORDER):
        square[k] = 0.0
        for j in range(k + 1):
            square[k] += re[j] * re[k - j] + im[j] * im[k - j]
        real = 0.0
        imag = 0.0
        for j in range(k + 1):
            real += square[j] * re[k - j]
            imag += square[j] * im[k - j]
        slope = a * complex(real, imag) + (delta + 1j) * complex(re[k], im[k])
        if k == 0:
            slope -= 1
        re[k + 1] = -slope.imag / (k + 1)
        im[k + 1] = slope.real / (k + 1)
        power *= left
        size = (abs(re[k + 1]) + abs(im[k + 1])) * power
        if max(size, last) < TERM:
            return k + 1, left
        last = size
    step = left
    for k in (ORDER - 1, ORDER):
        size = abs(re[k]) + abs(im[k])
        if size > 0:
            step = min(step, (TERM / size) ** (1 / k))
    return ORDER, step


def _decayed(y: complex, b: complex, flow: tuple[float, complex], left: float) -> complex:
    """Return where the motion from y beside b is after a time, by the flow linear around b.

    dε/ds = Pε + Qε*, P = i(δ + 2a|b|² + i), Q = iab².

    Args: flow: δ and a.
    """
    delta, a = flow
    x = abs(b) ** 2
    loss = 1 + 2 * a.imag * x  # P = −loss + i turn
    turn = delta + 2 * a.real * x
    q = 1j * a * b * b
    fast = np.sqrt(complex(abs(q) ** 2 - turn**2))
    even = (np.exp((fast - loss) * left) + np.exp((-fast - loss) * left)) / 2
    odd = np.exp(-loss * left) * left + 0j
    if abs(fast * left) > 1e-4:
        odd = (np.exp((fast - loss) * left) - np.exp((-fast - loss) * left)) / (2 * fast)
    off = y - b
    return complex(b + (even + odd * 1j * turn) * off + odd * q * np.conj(off))


def low_pass(
    found: ComplexArray, voltage: ComplexArray, rest: Array, poles: int, begins: NDArray[np.bool_]
) -> None:
    """Write into `found` (m, n) what a low pass of equal poles makes of steps, in order of time.

    Over a rest at the voltage v, y_j → v + e^{−u} Σ_i (y_i − v) u^{j−i}/(j−i)!, u = T/τ.

    Args: voltage (m, n) [V]; rest (n,): T/τ; poles: their number; begins (n,): whether a sweep
        begins there, with the filter settled.
    """
    state = np.zeros(poles, np.complex128)
    for row in range(len(voltage)):
        for k in range(len(rest)):
            v = voltage[row, k]
            if begins[k]:
                state[:] = v
            kept = np.exp(-rest[k])
            for j in range(poles - 1, -1, -1):
                total = 0j
                term = kept
                for back in range(j + 1):
                    total += (state[j - back] - v) * term
                    term *= rest[k] / (back + 1)
                state[j] = v + total
            found[row, k] = state[poles - 1]
