"""The state of a driven mode at every point of its sweeps, on either branch of its response."""

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array, ComplexArray
from femnl.observe.response.branches import duffing_branches

SIDES = np.arange(2)
"""Indices of the low and the high branch."""
ROUNDS = 12
"""Iterations of the amplitude under a quintic term or a resonance of higher order, small
corrections of the cubic one.
"""
SETTLED = 1e-6
"""Relative change of a squared amplitude at which they end."""
FAINT = 1e-6
"""Squared amplitude, in that of one linewidth of stiffening, from which on a resonance of any order
acts.
"""


def follow(
    chosen: NDArray[np.int64],
    measured: ComplexArray,
    both: ComplexArray,
    spans: NDArray[np.int64],
    first: int,
) -> None:
    """Write into `chosen` (n,) the branch of `both` (2, n) that each measured point is on.

    spans (n_sweeps, 3): start, stop, and whether a sweep begins on the branch `first` and
    jumps once.
    """
    last = 1 - first
    for k in range(len(spans)):
        start = spans[k, 0]
        stop = spans[k, 1]
        jump = start
        left = 0.0
        least = 0.0
        for i in range(start, stop):
            gain = abs(measured[i] - both[first, i]) ** 2 - abs(measured[i] - both[last, i]) ** 2
            chosen[i] = first if gain <= 0 else last
            left += gain
            if left < least:
                jump = i + 1
                least = left
        if spans[k, 2]:
            chosen[start:jump] = first
            chosen[jump:stop] = last


def branch_amplitudes(
    delta: Array,
    cubic: ComplexArray,
    fifth: Array,
    pulled: ComplexArray,
    scale: Array,
    order: float,
) -> ComplexArray:
    """Return b = 1/(δ + i + a x), x = |b|², on the low and the high branch, (2, n).

    a(x) = cubic + fifth·x + pulled·(scale·x)^(order − 2) is evaluated at the present amplitude,
    iteration by iteration.
    """
    a = cubic + pulled
    x = duffing_branches(delta, a.real, a.imag, continued=True).x
    if np.any(fifth) or (np.any(pulled) and order != 2):
        for _ in range(ROUNDS):
            a = cubic + fifth * x + pulled * np.maximum(x * scale, FAINT) ** (order - 2)
            # Both at once: row s of branch s continues from x[s].
            before = x
            x = duffing_branches(delta, a.real, a.imag, continued=True).x[SIDES, SIDES]
            if np.all(np.abs(x - before).max(axis=1) < SETTLED * np.abs(x).max(axis=1)):
                break
    return np.asarray(1 / (delta + a.real * x + 1j * (1 + a.imag * x)))


def shifted(branch: NDArray[np.int64], later: int) -> NDArray[np.int64]:
    """Return the branches (n,) of one sweep with its jump a few points later."""
    place = np.clip(np.arange(len(branch)) - later, 0, len(branch) - 1)
    return branch[place]
