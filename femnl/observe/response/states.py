"""The state of a driven mode at every point of its sweeps, on either branch of its response."""

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array, ComplexArray
from femnl.observe.response.branches import duffing_branches
from femnl.resonator.roots import FAINT, self_stiffened


def follow(
    chosen: NDArray[np.int64],
    measured: ComplexArray,
    both: ComplexArray,
    spans: NDArray[np.int64],
    starts: NDArray[np.int64],
) -> None:
    """Write into `chosen` (n,) the branch of `both` (2, n) that each measured point is on.

    spans (n_sweeps, 3): start, stop, and whether a sweep jumps once, from one of the branches
    `starts` (n_sweeps, k), where the data say.
    """
    for k in range(len(spans)):
        start = spans[k, 0]
        stop = spans[k, 1]
        nearest = np.inf
        for first in starts[k]:
            last = 1 - first
            jump = start
            left = 0.0
            for i in range(start, stop):
                left += abs(measured[i] - both[last, i]) ** 2
            least = left
            for i in range(start, stop):
                gain = (
                    abs(measured[i] - both[first, i]) ** 2 - abs(measured[i] - both[last, i]) ** 2
                )
                if not spans[k, 2]:
                    chosen[i] = first if gain <= 0 else last
                left += gain
                if left < least:
                    jump = i + 1
                    least = left
            # Where data or states are no numbers, too, a branch is written
            if spans[k, 2] and not least >= nearest:
                chosen[start:jump] = first
                chosen[jump:stop] = last
                nearest = least


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
        self_stiffened(x, delta, (cubic, fifth, pulled), scale, order)
        a = cubic + fifth * x + pulled * np.maximum(x * scale, FAINT) ** (order - 2)
    return np.asarray(1 / (delta + a.real * x + 1j * (1 + a.imag * x)))
