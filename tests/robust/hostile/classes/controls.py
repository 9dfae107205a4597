"""Fits that hold parameters, laws against free variables, records and decays of odd content."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tests.robust.hostile.classes.texts import word
from tests.robust.hostile.files import Array, drum, measurement, pick, resonance

NAMES = ["gate_voltage", "B", "tip_height", "x", "frequency", "time2", "data", "é", "a b", "_"]
UNITS = ["mV", "T", "kV/m", "degC", "1", "", "banana", "m^99", "1e400 m", "1/0", "kg^-1", "dB"]
VALUES = [
    "66.7",
    "66.7 Hz",
    "0",
    "-1",
    "1e300",
    "1e-300",
    "nan",
    "inf",
    "1e400 Hz",
    "3 kg",
    "3 Hz Hz",
    "1e",
    "",
    "=1",
    "1e6 Hz",
    "120 nm",
    "1 rad",
    "-1e-9",
]
PARAMETERS = {
    "response": ["linewidth", "frequency", "f0", "alpha", "amplitude", "delay", "quality_factor"],
    "series": ["slope", "offset", "exponent", "energy", "prefactor", "a", "value"],
    "spectrum": ["wave_speed", "stress", "bending", "aspect", "c"],
    "map": ["amplitude", "theta", "voltage", "x0", "y0", "scale", "angle", "amplitude[0]"],
    "trace": ["theta", "voltage", "amplitude", "offset", "damping", "k2", "mass", "k"],
    "decay": ["frequency", "quality_factor", "floor", "tau", "rate", "start", "level"],
}


def _own(rng: np.random.Generator, folder: Path, shape: tuple[int, ...]) -> None:
    """Add control variables of the file's own, of odd names, units, shapes and values."""
    with h5py.File(folder / "f.nc", "a") as file:
        file.attrs["femnl_measurement"] = pick(rng, ["1.2", "1.2", "1.2", "1.1", "1.3", "2"])
        node = file["data"]
        for _ in range(int(rng.integers(1, 4))):
            name = pick(rng, NAMES) if rng.random() < 0.8 else word(rng)
            name = name.replace("\x00", "").replace("/", "|") or "g"
            if name in node or name == ".":
                continue
            node[name] = _values(rng, shape)
            if rng.random() < 0.8:
                node[name].attrs["units"] = pick(rng, UNITS)


def _values(rng: np.random.Generator, shape: tuple[int, ...]) -> Any:
    way = int(rng.integers(10))
    if way == 0:
        return np.full(shape, pick(rng, [0.0, np.nan, 1e300, np.inf]))
    if way == 1:
        return np.linspace(0, 1, 2 * shape[0])
    if way == 2:
        return np.array([b"a"] * shape[0])
    if way == 3:
        return 1.0
    if way == 4:
        return np.arange(shape[0]) % 2 == 0
    if way == 5:
        return np.ones((*shape, 2)) * 1j
    return np.linspace(-3, 5, shape[0]) * pick(rng, [1.0, 1e-29, 1e29, 1e-300])


def _response(rng: np.random.Generator, folder: Path) -> list[str]:
    sweeps = int(pick(rng, [1, 3]))
    frequency, volts = resonance(rng)
    data = {
        "frequency": np.tile(frequency, (sweeps, 1)),
        "real": np.tile(volts.real, (sweeps, 1)),
        "imag": np.tile(volts.imag, (sweeps, 1)),
    }
    measurement(folder / "f.nc", "response", data, {"noise_sd": 1e-6})
    _own(rng, folder, (sweeps,))
    extra = [[], ["--each-sweep", "s.nc"], ["--modes", "2"], ["--linear"]]
    return [*_fixed(rng, "response"), *pick(rng, extra)]


def _series(rng: np.random.Generator, folder: Path) -> list[str]:
    points = int(pick(rng, [2, 12, 40]))
    data: dict[str, Any] = {"quality_factor": 1e5 / (1 + np.linspace(0, 3, points))}
    if rng.random() < 0.5:
        data["pressure"] = np.linspace(1, 100, points)
    measurement(folder / "f.nc", "series", data)
    _own(rng, folder, (points,))
    against = ["--against", str(pick(rng, [*NAMES, "pressure", "", word(rng).replace("\0", "")]))]
    law = ["--law", str(pick(rng, ["line", "power", "arrhenius", "x"]))]
    return [*_fixed(rng, "series"), *pick(rng, [[], against, against]), *law]


def _record(rng: np.random.Generator, folder: Path) -> list[str]:
    samples = int(pick(rng, [20, 2_000]))
    drive = rng.normal(size=samples)
    out = np.convolve(drive, np.exp(-np.arange(20) / 5) * np.cos(np.arange(20)))[:samples]
    voltage = _spoilt(rng, out)
    data = {
        "time": np.arange(samples) * 1e-3,
        "voltage": voltage[None],
        "drive_voltage": _spoilt(rng, drive)[None],
    }
    measurement(folder / "f.nc", "trace", data)
    parts = ["0:10", "10:0", "0:99999", "5:6", ":", "-1:5", "0:2000", "1e3:2e3"]
    held = ["--held-out", str(pick(rng, parts))]
    return [*_fixed(rng, "trace"), "--as", "oscillator", *pick(rng, [[], held])]


def _decay(rng: np.random.Generator, folder: Path) -> list[str]:
    points = int(pick(rng, [5, 300]))
    time = np.linspace(0, 100, points)
    power = np.logaddexp(-40 - 2 * time, -110) + rng.normal(size=points)
    data = {"time": time, "power": _spoilt(rng, power)}
    given = {"frequency": pick(rng, [1e6, 0.0, -1.0, 1e-29]), "bandwidth": pick(rng, [1.0, 0.0])}
    measurement(folder / "f.nc", "decay", data, given)
    return _fixed(rng, "decay")


def _map(rng: np.random.Generator, folder: Path) -> list[str]:
    place = np.linspace(-5e-5, 5e-5, 15)
    shape = np.cos(np.pi * place[:, None] / 1e-4) * np.cos(np.pi * place / 1e-4)
    real = np.stack([shape, shape**2]) + 1e-3 * rng.normal(size=(2, 15, 15))
    data = {"x": place, "y": place, "harmonic": [1, 2], "real": real, "imag": 0 * real}
    root = {"geometry": drum(folder)}
    measurement(folder / "f.nc", "map", data, {"wavelength": 632.8e-9}, root)
    return [*_fixed(rng, "map"), *pick(rng, [[], ["--fringe", "free"], ["--mode", "3"]])]


def _spectrum(rng: np.random.Generator, folder: Path) -> list[str]:
    frequency = np.array([3.4e6, 5.4e6, 7.3e6, 7.8e6])
    data = {"frequency": frequency, "frequency_sd": np.full(4, 10.0)}
    given = {"wave_speed": pick(rng, [600.0, 0.0, -1.0, 1e29]), "wave_speed_sd": 1.0}
    measurement(folder / "f.nc", "spectrum", data, given, {"geometry": drum(folder)})
    return _fixed(rng, "spectrum")


def _spoilt(rng: np.random.Generator, plain: Array) -> Array:
    """Return a signal with a part that a recorder spoilt."""
    way = int(rng.integers(6))
    found = plain.copy()
    if way == 0:
        found[: found.size // 2] = np.nan
    elif way == 1:
        found[:] = found[0]
    elif way == 2:
        found[int(rng.integers(found.size))] = pick(rng, [1e29, np.inf, -1e300])
    elif way == 3:
        found = np.round(found)
    return found


def _fixed(rng: np.random.Generator, kind: str) -> list[str]:
    """Return options that hold parameters of a fit, of the kind or of none."""
    names: Sequence[str] = PARAMETERS[kind]
    words = []
    for _ in range(int(rng.integers(3))):
        name = pick(rng, names) if rng.random() < 0.8 else word(rng).replace("\0", "")[:2_000]
        words += ["--fix", f"{name}={pick(rng, VALUES)}"]
    return words


def make(rng: np.random.Generator, folder: Path) -> list[str]:
    """Write a measurement with controls of its own, and ask a command for it."""
    makers = [_response, _response, _series, _series, _record, _decay, _map, _spectrum]
    options = makers[int(rng.integers(len(makers)))](rng, folder)
    if rng.random() < 0.2:
        return pick(rng, [["show", "f.nc"], ["diagnose", "f.nc", "--workers", "1"]])
    return ["fit", "f.nc", *options, *pick(rng, [[], ["--json"], ["--out", "o"]])]
