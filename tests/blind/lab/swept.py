"""What a detector, a piezo beside the mode and a lock-in make of sweeps, sampled or stepped."""

import numpy as np

from tests.blind.lab.bench import Array, Values
from tests.blind.lab.laws import rounded

Complex = np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
FIRST = 2 * np.pi * np.arange(64) / 64
"""Phases at which the signal of the fringe is sampled."""
CLIPPED = 2 * np.pi * (np.arange(720) + 0.5) / 720
"""Phases at which a clipped signal is sampled."""
SUBSTEPS = 100
"""Steps of time of a filter, a point."""


def fringe(motion: Complex, z: Array) -> Complex:
    """Return motion times the first harmonic of sin(z cos φ), sampled, over that of z cos φ."""
    first = 2 * np.mean(np.sin(z[..., None] * np.cos(FIRST)) * np.cos(FIRST), axis=-1)
    return np.asarray(
        motion * np.where(z > 1e-3, first / np.maximum(z, 1e-300), 1 - z**2 / 8), complex
    )


def clipped(volts: Complex, part: float, low: float, much: float = 0.0) -> Complex:
    """Clip sampled sinusoids (n_sweeps, n_points) at a part below the largest of all.

    low: the lower rail in units of the upper one; much: see `laws.rounded`.
    """
    found = volts.copy()
    limit = (1 - part) * np.abs(volts).max()
    strong = np.abs(volts) > (limit / 2 if much else limit)
    size = np.abs(volts[strong])
    cut = rounded(size[:, None] * np.cos(CLIPPED), limit, low, much)
    found[strong] *= 2 * np.mean(cut * np.cos(CLIPPED), axis=1) / size
    return found


def late(volts: Complex, detuning: Array, tau: float) -> Complex:
    """Return what a lock-in takes from sinusoids that come late, sampled in time."""
    turn = 2 * np.pi * detuning * tau
    first = 2 * np.mean(np.cos(FIRST - turn[:, None]) * np.exp(-1j * FIRST), axis=-1)
    return np.asarray(volts * first, complex)


def oscillator(frequency: Array, centre: float, width: float) -> Complex:
    """Return the motion of an oscillator at a centre and of a width [Hz], largest 1 at resonance.

    ẍ + 2πw ẋ + (2πf_p)²x = F, of second order in f.
    """
    answer = 1 / (centre**2 - frequency**2 + 1j * frequency * width)
    return np.asarray(answer * centre * width, complex)


def filtered(volts: Complex, direction: Array, values: Values) -> Complex:
    """Return the output of a chain of RC stages, in time steps by the midpoint rule.

    left: what one stage has left of a step after one point, e^{−T/τ}.
    """
    tau = -1 / np.log(values["left"])
    found = np.empty_like(volts)
    sweeps = np.arange(len(volts))
    points = volts.shape[1]
    order = np.where(direction[:, None] > 0, np.arange(points), np.arange(points)[::-1])
    state = np.repeat(volts[sweeps, order[:, 0]][:, None], round(values["poles"]), axis=1)
    # Fine enough for the stage itself
    count = max(SUBSTEPS, int(10 / tau))
    for k in range(points):
        now = volts[sweeps, order[:, k]][:, None]
        for _ in range(count):
            before = np.concatenate([now, state[:, :-1]], axis=1)
            half = state + (before - state) / (2 * tau * count)
            before = np.concatenate([now, half[:, :-1]], axis=1)
            state = state + (before - half) / (tau * count)
        found[sweeps, order[:, k]] = state[:, -1]
    return found
