"""The slow flow of a driven mode and of one that it drives, in steps of time."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from tests.blind.lab.bench import Array, Values

Complex = NDArray[np.complex128]
STEPS = 40_000
STRIDE = 0.05
SETTLED = 1e-6
"""Most Runge–Kutta steps at each point of a sweep, in units of the amplitude's decay time, and the
change in a step of that size that ends them.

Just past a fold a state lingers: a point that were taken there would be on no branch.
"""
STABLE = 1.0
"""Most phase in a Runge–Kutta step: beyond 2.8 such steps grow without end."""
IMPLICIT = 3
"""Rounds in which an implicit step is found."""
FINE = 0.2
"""Phase in one step of a mode that does not settle."""


def softening(base: Values, hidden: dict[str, Values], drive: float) -> float:
    """What a restoring force of second order adds to α.

    8/3 of the shift of the free oscillation of k = 1, u + κ₂u², over A².
    """
    kappa = hidden.get("quadratic_stiffness", {}).get("kappa2", 0.0) * base["peak"] * drive
    if kappa == 0:
        return 0.0
    shift = []
    for size in (1.0, -1.0):  # from either turning point: what is odd in the amplitude drops out
        ends = np.roots([kappa / 3 * size, 0.5, 0.0, -(0.5 + kappa / 3 * size)])
        low = float(ends[np.argmin(np.abs(ends + 1))].real)
        psi = np.pi * (np.arange(64) + 0.5) / 64
        u = (1 + low) / 2 + (1 - low) / 2 * np.cos(psi)
        # (1 − u)(u − low) is a factor of the energy that is left, and cancels against that of the
        # substitution.
        rest = 0.5 + kappa / 3 * size * (u + 1 + low)
        shift.append(1 / np.mean(1 / np.sqrt(2 * rest)) - 1)
    return float(8 / 3 * np.mean(shift) / (base["peak"] * drive) ** 2)


@cache
def compiled() -> Callable[..., None]:
    """Return `_settle` as machine code."""
    return numba.njit(error_model="numpy")(_settle)


class Flow(NamedTuple):
    """The slow flow of each point, (n,): see `_settle`."""

    delta: Array
    cubic: Array
    quintic: Array
    loss: Array
    drive: Complex
    turn: Complex
    coupling: Array
    power: NDArray[np.int64]
    rest: Array
    septic: Array
    more_loss: Array


def _settle(a: Complex, b: Complex, coupled: bool, flow: Flow) -> None:
    """Step every a (n,) in time until none changes any more.

    da/ds = −i (drive − a (δ + cubic|a|² + quintic|a|⁴ + septic|a|⁶ + i (1 + loss|a|² + more|a|⁴))).

    By Runge–Kutta steps; coupled to a mode b at p times the drive, db/ds = i (b turn + g aᵖ), and +
    i g a*^{p−1} b in da/ds, by the implicit midpoint rule, which keeps the fast turning of that
    mode stable. The amplitude of b counts so that its own g is the same.
    """
    delta, cubic, quintic, loss, drive, turn, coupling, power, rest, septic, more_loss = flow
    steps = np.empty(len(a))
    for i in range(len(a)):
        reach = abs(delta[i]) + 3 * abs(cubic[i]) * abs(drive[i]) ** 2 + 1
        fine = np.ceil(rest[i] * reach / FINE)
        stride = STRIDE if coupled else min(STRIDE, STABLE / reach)
        steps[i] = rest[i] / fine if fine < np.inf else stride
    largest = np.abs(drive).max()
    for n in range(STEPS):
        change = 0.0
        for i in range(len(a)):
            h = steps[i]
            if (n + 0.5) * h > rest[i]:
                continue
            before = a[i]
            if coupled:
                last = before
                other = b[i]
                for _ in range(IMPLICIT):
                    middle = (before + last) / 2
                    x = middle.real**2 + middle.imag**2
                    loss_here = loss[i] + more_loss[i] * x
                    lower = coupling[i] * (middle if power[i] == 2 else middle * middle)
                    own = (
                        0.5j
                        * h
                        * (
                            delta[i]
                            + x * (cubic[i] + (quintic[i] + septic[i] * x) * x)
                            + 1j * (1 + loss_here * x)
                        )
                    )
                    last = (
                        before * (1 + own)
                        - 1j * h * (drive[i] - np.conj(lower) * (b[i] + other) / 2)
                    ) / (1 - own)
                    other = (b[i] * (1 + 0.5j * h * turn[i]) + 1j * h * lower * middle) / (
                        1 - 0.5j * h * turn[i]
                    )
                a[i] = last
                b[i] = other
            else:
                rate = 0j
                total = 0j
                for stage in range(4):
                    here = before + (0.0 if stage == 0 else h if stage == 3 else h / 2) * rate
                    x = here.real**2 + here.imag**2
                    loss_here = loss[i] + more_loss[i] * x
                    rate = -1j * (
                        drive[i]
                        - here
                        * (
                            delta[i]
                            + x * (cubic[i] + (quintic[i] + septic[i] * x) * x)
                            + 1j * (1 + loss_here * x)
                        )
                    )
                    total += rate if stage in (0, 3) else 2 * rate
                a[i] = before + h / 6 * total
            if n % 10 == 9:
                change = max(change, abs(a[i] - before) * STRIDE / h)
        if n % 10 == 9 and change < SETTLED * largest:
            return
