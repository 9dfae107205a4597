"""What a finite speed of sweeping leaves of earlier points: in the mode, and in the lock-in.

The drive rests at each frequency for a time T, steps to the next without a jump of its phase, and
the point is taken at the end of T.
"""

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array, ComplexArray

NEAR = 0.02
"""Deviation from the steady amplitude, in parts of it, up to which it decays as a linear one."""
STRIDE = 0.1
"""Phase and decay [rad] in one Runge–Kutta step of a larger one."""
REST = 1e-6
"""Change in one time of decay, in parts of the amplitude, below which the motion is at rest."""
LONG = 20.0
"""Rest, in times of decay, after which no deviation is left."""
MANY = 2_000
"""Steps from which on it is asked whether a rest may end early."""
MOST = 100_000
"""Steps of one rest at most."""


def settle(
    found: ComplexArray,
    steady: ComplexArray,
    delta: Array,
    stiffening: ComplexArray,
    rest: Array,
    begins: NDArray[np.bool_],
) -> None:
    """Write into `found` (n,) the amplitude at the end of each rest, in the order of time.

    db/ds = i((δ + a|b|² + i)b − 1), s = πwt: a small deviation ε from the steady b decays by
    dε/ds = Pε + Qε*, P = i(δ + 2a|b|² + i), Q = iab², in closed form; a larger one, as after a
    jump, by Runge–Kutta steps.

    Args: steady b (n,) [parts of the linear amplitude at resonance]; delta δ, stiffening a (n,);
        rest (n,): πwT; begins (n,): whether a sweep begins there, at its steady amplitude.
    """
    for k in range(len(steady)):
        b = steady[k]
        if begins[k]:
            found[k] = b
            continue
        a = stiffening[k]
        y = found[k - 1]
        x = abs(b) ** 2
        left = rest[k]
        loss = 1 + 2 * a.imag * x  # P = −loss + i turn
        turn = delta[k] + 2 * a.real * x
        q = 1j * a * b * b
        fast = np.sqrt(complex(abs(q) ** 2 - turn**2))
        # Beside a steady state that does not last a deviation grows until it is no small one
        lasting = fast.real < loss
        linear = abs(a) * max(abs(y) ** 2, x) < NEAR
        near = lasting and (linear or abs(y - b) <= NEAR * abs(b))
        if not near and left > LONG:
            left = LONG
        rate = abs(delta[k]) + 3 * abs(a) * max(abs(y) ** 2, x) + 1
        # A motion that turns so often is nowhere but in the trials of a fit
        if not near and not left * rate < STRIDE * MOST:
            found[k] = b + (y - b) * np.exp(-left)
            continue
        count = int(left * rate / STRIDE) + 1
        h = left / count
        # What rests long comes near long before the end; but beyond its fold a branch is
        # continued, and nothing rests there
        ends_early = count > MANY and abs((delta[k] + a * x + 1j) * b - 1) < REST
        while not near and left > h / 2:
            one = 1j * ((delta[k] + a * abs(y) ** 2 + 1j) * y - 1)
            z = y + h / 2 * one
            two = 1j * ((delta[k] + a * abs(z) ** 2 + 1j) * z - 1)
            z = y + h / 2 * two
            three = 1j * ((delta[k] + a * abs(z) ** 2 + 1j) * z - 1)
            z = y + h * three
            four = 1j * ((delta[k] + a * abs(z) ** 2 + 1j) * z - 1)
            y = y + h / 6 * (one + 2 * two + 2 * three + four)
            left -= h
            near = lasting and ends_early and abs(y - b) <= NEAR * abs(b)
            if count > MANY and abs(one) < REST * abs(
                y
            ):  # settled, on another branch than the steady one here
                break
        if not near:
            found[k] = y
            continue
        off = y - b
        even = (np.exp((fast - loss) * left) + np.exp((-fast - loss) * left)) / 2
        odd = np.exp(-loss * left) * left + 0j
        if abs(fast * left) > 1e-4:
            odd = (np.exp((fast - loss) * left) - np.exp((-fast - loss) * left)) / (2 * fast)
        found[k] = b + (even + odd * 1j * turn) * off + odd * q * np.conj(off)


def low_pass(
    found: ComplexArray, voltage: ComplexArray, rest: Array, poles: int, begins: NDArray[np.bool_]
) -> None:
    """Write into `found` (n,) what a low pass of equal poles makes of steps, in the order of time.

    Over a rest at the voltage v, y_j → v + e^{−u} Σ_i (y_i − v) u^{j−i}/(j−i)!, u = T/τ.

    Args: voltage (n,) [V]; rest (n,): T/τ; poles: their number; begins (n,): whether a sweep begins
        there, with the filter settled.
    """
    state = np.zeros(poles, np.complex128)
    for k in range(len(voltage)):
        v = voltage[k]
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
        found[k] = state[poles - 1]
