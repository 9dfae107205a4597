"""The state of a driven mode at every point of its sweeps, on either branch of its response."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Oscillator
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


class Balance(NamedTuple):
    """The first harmonic of a mode at every point (n,), as `branch_amplitudes` solves it."""

    delta: Array
    cubic: ComplexArray
    fifth: Array
    pulled: ComplexArray
    scale: Array
    order: float

    @property
    def bend(self) -> ComplexArray:
        """Part a (n,) of the bend that grows as the square of the motion."""
        return self.cubic + (self.pulled if self.order == 2 else 0)


def balance(mode: Oscillator, frequency: Array, linear: Array) -> Balance:
    """Return the balance of the first harmonic A [m], see `Oscillator`, by b = A f/(A₁F f₀).

    In these units it is that of a rotating wave, with δ = (f₀² − f²)/(f w).

    Args: frequency f (n,) of the drive [Hz]; linear A₁F (n,) [m]: the amplitude at resonance
        without nonlinearity.
    """
    f0 = mode.frequency
    ratio = f0 / frequency
    swing = linear * ratio
    per = 2 / mode.linewidth
    scale = swing**2 * (3 * f0 * abs(mode.alpha)) / (8 * mode.linewidth)
    return Balance(
        delta=per * (f0 * ratio - frequency) / 2,
        cubic=(
            per * ratio * 0.375 * f0 * mode.alpha * swing**2
            + 1j * np.maximum(mode.damping, 0) * swing**2 / 4
        ),
        fifth=per * ratio * 0.3125 * f0 * mode.quintic * swing**4,
        pulled=per * ratio * mode.pull * scale,
        scale=scale,
        order=mode.order,
    )


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
