"""Data without a scale: constant, zero, subnormal and vast values, and errors of such size."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.robust.hostile.files import Array, drum, measurement, pick, resonance

BEYOND = [5e-324, 1e-300, -1e-300, 1e-160, 1e150, 1e300, -1e300, 1.79e308]
WITHIN = [0.0, 0.0, 1.0, -1.0, 1e-29, 1e-12, -1e-12, 1e12, 1e29, -1e29, np.nan]
LEVELS = [*BEYOND, *WITHIN, *WITHIN]
SD = [0.0, 5e-324, 1e-300, 1e-12, 1.0, 1e300, 1.79e308, np.nan, np.inf, -1.0]

SIZES = [5e-324, 1e300, 1e-29, 1e-12, 1e-3, 1.0, 1.0, 1e12, 1e29]


def values(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return an array of a hostile scale."""
    level = pick(rng, LEVELS)
    way = int(rng.integers(7))
    found = np.full(shape, level)
    if way == 1:
        found = found * (1 + 1e-16 * rng.normal(size=shape))
    elif way == 2:
        found.flat[int(rng.integers(found.size))] = pick(rng, LEVELS)
    elif way == 3:
        found = np.where(rng.random(shape) < 0.5, level, pick(rng, LEVELS))
    elif way == 4:
        found = rng.normal(size=shape) * level
    elif way == 5:
        found = np.array([pick(rng, LEVELS) for _ in range(found.size)]).reshape(shape)
    elif way == 6:
        found = np.where(rng.random(shape) < 0.3, np.nan, found)
    return np.asarray(found)


def positive(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return hostile values of the only sign that a file may have."""
    found = np.abs(values(rng, shape))
    return np.where(found == 0, pick(rng, [1e-300, 1e-29, 1.0]), found)


def signal(rng: np.random.Generator, plain: Array) -> Array:
    """Return a sound signal of a vast or tiny scale, or values that are none."""
    if rng.random() < 0.5:
        return values(rng, plain.shape)
    with np.errstate(all="ignore"):
        return np.asarray(plain * pick(rng, LEVELS) / pick(rng, [1.0, 1e-3, 1e25]))


def axis(rng: np.random.Generator, count: int, low: float, high: float) -> Array:
    """Return positions that rise evenly, stand still, or lie far apart."""
    way = int(rng.integers(25))
    if way == 0:
        return np.full(count, low)
    if way == 1:
        return low + np.arange(count) * 5e-324
    if way == 2:
        return np.linspace(low, 1e300, count)
    return np.linspace(low, high, count)


def attributes(rng: np.random.Generator, names: list[str]) -> dict[str, Any]:
    """Return some attributes, vast and tiny ones among them."""
    usual = [1e-29, 1e-6, 1e-3, 1.0, 1e6, 1e29]
    odd = rng.random() < 0.1
    return {name: pick(rng, SD if odd else usual) for name in names if rng.random() < 0.5}


Build = Callable[[np.random.Generator], tuple[dict[str, Any], dict[str, Any]]]


def _response(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    sweeps = int(rng.integers(1, 4))
    points = int(pick(rng, [1, 3, 8, 60, 60, 60, 200]))
    frequency = np.tile(axis(rng, points, 1e6, 1.001e6), (sweeps, 1))
    data = {"frequency": frequency}
    if rng.random() < 0.2:
        data["magnitude"] = np.abs(values(rng, frequency.shape))
    else:
        plain = np.tile(resonance(rng, points)[1], (sweeps, 1))
        data["real"] = signal(rng, plain.real)
        data["imag"] = signal(rng, plain.imag)
    for name in ("drive", "temperature", "pressure", "time", "duration"):
        if rng.random() < 0.25:
            data[name] = values(rng, (sweeps,))
    if rng.random() < 0.3:
        data["direction"] = np.ones(sweeps)
    return data, attributes(rng, ["noise_sd"])


def _map(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    nx, ny = (int(pick(rng, [1, 2, 7, 15, 15, 21])) for _ in range(2))
    harmonics = int(rng.integers(1, 4))
    shape = (harmonics, ny, nx)
    data = {
        "x": axis(rng, nx, -5e-5, 5e-5),
        "y": axis(rng, ny, -5e-5, 5e-5),
        "harmonic": np.arange(1, harmonics + 1),
        "real": values(rng, shape),
        "imag": values(rng, shape),
    }
    given = attributes(rng, ["noise_sd", "drive", "drive_frequency"])
    return data, given | ({"wavelength": 632.8e-9} if rng.random() < 0.8 else {})


def _trace(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    steps = int(rng.integers(1, 4))
    samples = int(pick(rng, [2, 64, 600, 1000, 4000]))
    data = {"time": axis(rng, samples, 0.0, samples * 1e-7)}
    tone = np.sin(2 * np.pi * 1e6 * np.arange(samples) * 1e-7) * np.exp(-np.arange(samples) / 300)
    data["voltage"] = signal(rng, np.tile(tone, (steps, 1)))
    if rng.random() < 0.85:
        data["drive_frequency"] = (
            np.abs(values(rng, (steps,))) if rng.random() < 0.5 else np.full(steps, 1e6)
        )
    if rng.random() < 0.3:
        data["drive_voltage"] = values(rng, (steps, samples))
    return data, attributes(rng, ["noise_sd", "x", "y"]) | (
        {"wavelength": 632.8e-9} if rng.random() < 0.5 else {}
    )


def _series(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    points = int(pick(rng, [1, 3, 12, 12, 40]))
    control = pick(rng, ["pressure", "temperature", "laser_power", "drive", "time", "voltage"])
    data = {
        control: axis(rng, points, 1.0, 300.0) if rng.random() < 0.7 else values(rng, (points,))
    }
    for name in pick(rng, [["frequency"], ["quality_factor"], ["frequency", "quality_factor"]]):
        data[name] = positive(rng, (points,))
        if rng.random() < 0.5:
            data[f"{name}_sd"] = np.full(points, pick(rng, SIZES))
    return data, attributes(rng, ["noise_sd"])


def _spectrum(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    modes = int(pick(rng, [1, 2, 5, 12]))
    good = 3.4e6 * np.sqrt(np.arange(1, modes + 1))
    data = {
        "frequency": good if rng.random() < 0.5 else positive(rng, (modes,)),
        "frequency_sd": np.full(modes, pick(rng, SIZES)),
    }
    if rng.random() < 0.3:
        data["quality_factor"] = positive(rng, (modes,))
    return data, {}


def _decay(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    points = int(pick(rng, [3, 40, 100, 400]))
    data = {"time": axis(rng, points, 0.0, 10.0)}
    if rng.random() < 0.6:
        data["power"] = signal(rng, -np.linspace(40, 90, points) + rng.normal(size=points))
    else:
        data["magnitude"] = np.abs(signal(rng, np.exp(-np.linspace(0, 5, points))))
    return data, attributes(rng, ["frequency", "bandwidth", "pressure", "temperature"])


KINDS: dict[str, tuple[Build, list[list[str]]]] = {
    "response": (_response, [[], ["--as", "overview"], ["--linear"], ["--modes", "2"]]),
    "map": (_map, [[], ["--fringe", "free"], ["--fringe", "multilayer"]]),
    "trace": (_trace, [[], ["--as", "ring-down"], ["--as", "oscillator"], ["--as", "envelope"]]),
    "series": (_series, [[], ["--law", "power"], ["--law", "arrhenius"]]),
    "spectrum": (_spectrum, [[]]),
    "decay": (_decay, [[]]),
}


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Write a measurement without a scale, and ask a command for it."""
    kind = pick(rng, list(KINDS))
    build, options = KINDS[kind]
    data, given = build(rng)
    root = {"geometry": drum(folder)} if rng.random() < 0.8 else {}
    measurement(folder / "f.nc", kind, data, given, root)
    command = pick(rng, ["show", "fit", "fit", "fit", "diagnose"])
    if command == "show":
        return ["show", "f.nc"]
    if command == "diagnose":
        return ["diagnose", "f.nc", "--workers", "1", *pick(rng, [["--json"], [], []])]
    out = pick(rng, [["--json"], ["--out", "o"], []])
    return ["fit", "f.nc", *pick(rng, options), *out]
