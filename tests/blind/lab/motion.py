"""Motions that maps and traces see: a mode that drifts past its drive, and one that is bent."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tests.blind.lab.bench import Array

DWELL = 0.05
"""Time [s] that a point of a map takes, row by row."""
PARTS = 16
"""Steps in which the motion is followed while a point is measured."""


@lru_cache(maxsize=64)
def drifting(
    count: int, detuning: float, drift: float, linewidth: float, inexact: float = 0.0
) -> NDArray[np.complex128]:
    """Amplitude at points taken one after the other, of a mode that drifts past its drive.

    Ȧ = −πw((1 + 2iδ)A − F), followed in time; steady and one in the middle of all. detuning δ there
    and drift over all, in linewidths w [Hz]; inexact: what is curved of it, of its size.
    """
    step = DWELL / PARTS
    time = (np.arange(count * PARTS) + 0.5) / PARTS - 0.5
    place = time / (count - 1) - 0.5
    rate = 1 + 2j * (detuning + drift * (place + inexact * (4 * place**2 - 1)))
    steady = (1 + 2j * detuning) / rate
    keep = np.exp(-np.pi * linewidth * step * rate)
    found = np.empty(count * PARTS, complex)
    now = steady[0]
    for n in range(len(found)):
        now = steady[n] + (now - steady[n]) * keep[n]
        found[n] = now
    return np.asarray(found.reshape(count, PARTS).mean(axis=1))


@lru_cache(maxsize=64)
def bent(kappa: float, samples: int) -> Array:
    """One period of ü + u + κu² = 0 in units of its first harmonic, whose phase is zero.

    κ in those units.

    By Runge–Kutta steps from one turning point to the next: the way back is the way there.
    """
    start = 1.0
    half = np.pi
    for _ in range(8):
        u, v = _orbit(kappa, start, half, samples)
        # Where it turns, v = 0
        half += v[samples // 2] / (u[samples // 2] * (1 + kappa * u[samples // 2]))
        start /= float(2 * np.mean(u * np.cos(2 * np.pi * np.arange(samples) / samples)))
    return _orbit(kappa, start, half, samples)[0]


def _orbit(kappa: float, start: float, half: float, samples: int) -> tuple[Array, Array]:
    """Displacement and velocity at even steps of a period of twice `half`."""
    steps = 8
    h = 2 * half / samples / steps
    state = np.array([start, 0.0])
    kept = []

    def rate(s: Array) -> Array:
        return np.array([s[1], -s[0] * (1 + kappa * s[0])])

    for n in range(samples // 2 * steps + 1):
        if n % steps == 0:
            kept.append(state)
        one = rate(state)
        two = rate(state + h / 2 * one)
        three = rate(state + h / 2 * two)
        state = state + h / 6 * (one + 2 * two + 2 * three + rate(state + h * three))
    u, v = np.array(kept).T
    back = slice(-2, 0, -1)
    return np.concatenate([u, u[back]]), np.concatenate([v, -v[back]])
