"""What no library has, beside a known cause: a signal by kind of measurement, of no given size."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.blind.lab.bench import Array

BLOBS = 5
LINES = 3
HUM = 50.0
"""Hertz of the mains."""


def _pulls(bench: Any, rng: np.random.Generator) -> Array:
    """Pull one to three modes by something that is not in the model."""
    found = np.zeros(bench.count)
    which = rng.choice(bench.count, int(rng.integers(1, 4)), replace=False)
    found[which] = rng.standard_normal(len(which))
    return found


def _line(bench: Any, rng: np.random.Generator) -> Array:
    """Return an odd line, of second order in the drive: the slope of a Gaussian in frequency."""
    span = float(np.ptp(bench.frequency))
    centre = float(rng.choice(bench.frequency))
    x = (bench.frequency - centre) / (span * np.exp(rng.uniform(np.log(0.03), np.log(0.2))))
    turn = np.exp(1j * rng.uniform(-np.pi, np.pi))
    line = turn * (rng.uniform(-1, 1) + x) * np.exp(-(x**2) / 2)
    volts = np.outer(bench.drives**2, line)
    return np.stack([volts.real, volts.imag])


def _field(bench: Any, rng: np.random.Generator) -> Array:
    """Return a smooth random field over the film in the lowest harmonics, as of dust and haze."""
    half = bench.axis.max() / 1.2
    x, y = np.meshgrid(bench.axis / half, bench.axis / half)
    inside = np.maximum(1 - x**2, 0) * np.maximum(1 - y**2, 0)
    found = np.zeros((6, *x.shape), complex)
    for order in range(3):
        for _ in range(BLOBS):
            px, py = rng.uniform(-0.9, 0.9, 2)
            size = rng.uniform(0.15, 0.5)
            weight = complex(*rng.standard_normal(2)) / (1 + order) ** 2
            found[order] += weight * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * size**2))
    found = found * inside
    return np.stack([found.real, found.imag])


def _wander(bench: Any, rng: np.random.Generator) -> Array:
    """Let the frequency wander and jump on its own, in the order of acquisition, but not drift.

    What it drifts on the whole is taken off: a drift is a cause of the library.
    """
    steps = rng.standard_normal(bench.n)
    steps[rng.choice(bench.n, 2, replace=False)] *= 4
    walk = np.cumsum(steps)
    order = np.argsort(bench.control["time"]) if "time" in bench.control else np.arange(bench.n)
    place = np.arange(bench.n) if "time" not in bench.control else bench.control["time"][order]
    found = np.zeros(bench.n)
    found[order] = walk - np.polyval(np.polyfit(place, walk, 1), place)
    return found


def _tone(bench: Any, rng: np.random.Generator) -> Array:
    """Return a tone that is no harmonic of the drive, and comes and goes."""
    time = np.arange(bench.samples) / bench.rate
    frequency = bench.f0 * float(rng.choice([0.37, 0.61, 1.43, 1.71, 2.57]))
    rows = []
    for _ in range(bench.steps):
        turn = rng.uniform(-np.pi, np.pi)
        rows.append(rng.uniform(0.3, 1) * np.cos(2 * np.pi * frequency * time + turn))
    return np.array(rows)


def _hum(bench: Any, rng: np.random.Generator) -> Array:
    """Return the hum of the mains, with overtones."""
    time = np.arange(len(bench.drive) // 64) / 610.0
    found = np.zeros(len(time))
    for n in range(1, LINES + 1):
        turn = rng.uniform(-np.pi, np.pi)
        found += rng.uniform(0.3, 1) / n * np.cos(2 * np.pi * n * HUM * time + turn)
    return found


def _bump(bench: Any, rng: np.random.Generator) -> Array:
    """Let the gain of the readout rise or fall for a while, and step."""
    time = bench.time / bench.whole
    width = rng.uniform(0.04, 0.12)
    bump = np.exp(-0.5 * ((time - rng.uniform(0.2, 0.7)) / width) ** 2)
    step = rng.uniform(-0.7, 0.7) * (time > rng.uniform(0.2, 0.7))
    return np.asarray(bench.whitened(rng.choice([-1.0, 1.0]) * bump + step))


SIGNALS: dict[str, Callable[[Any, np.random.Generator], Array]] = {
    "spectrum": _pulls,
    "holes": _pulls,
    "response": _line,
    "map": _field,
    "series": _wander,
    "trace": _tone,
    "record": _hum,
    "decay": _bump,
}
"""What is unknown, in the shape of a bench's first noise."""


def flat(kind: str, signal: Array, count: int) -> Array:
    """Return a signal (in the shape of the noise) as `Bench.clean` gives data, (count,)."""
    if kind == "trace":
        signal = signal - signal.mean(axis=1, keepdims=True)
    found = np.zeros(count)
    found[: signal.size] = signal.ravel()
    return found
