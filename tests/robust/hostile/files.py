"""Files of the hostile cases: measurement files as a stranger's program writes them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
T = TypeVar("T")
UNITS = {
    "frequency": "Hz",
    "frequency_sd": "Hz",
    "real": "V",
    "imag": "V",
    "magnitude": "V",
    "voltage": "V",
    "drive_voltage": "V",
    "drive": "V",
    "x": "m",
    "y": "m",
    "time": "s",
    "duration": "s",
    "pressure": "Pa",
    "temperature": "K",
    "laser_power": "W",
    "drive_frequency": "Hz",
    "power": "dB",
}
"""Units that the contract states, of the datasets that have one."""
FILM = """name = "drum"
[outline]
kind = "circle"
diameter = "100 um"
[film]
thickness = "100 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
[readout]
gap = "3226.25 nm"
"""
"""A small drum, whose modes take a second."""


def measurement(
    path: Path,
    kind: str,
    data: Mapping[str, Any],
    attributes: Mapping[str, Any] | None = None,
    root: Mapping[str, Any] | None = None,
    group: str = "data",
) -> None:
    """Write a measurement file without any check of its content."""
    with h5py.File(path, "a") as file:
        file.attrs["femnl_measurement"] = "1.1"
        for key, value in (root or {}).items():
            file.attrs[key] = value
        node = file.create_group(group)
        node.attrs["kind"] = kind
        for key, value in (attributes or {}).items():
            node.attrs[key] = value
        for key, values in data.items():
            node[key] = values
            if key in UNITS:
                node[key].attrs["units"] = UNITS[key]


def pick(rng: np.random.Generator, choices: Sequence[T]) -> T:
    """Return one of some choices."""
    return choices[int(rng.integers(len(choices)))]


def resonance(rng: np.random.Generator, points: int = 120) -> tuple[Array, Array]:
    """Return frequencies and complex amplitudes of a plain resonance with noise."""
    frequency = np.linspace(1e6, 1.001e6, points)
    volts = 1e-3 * 20 / (frequency - 1.0005e6 + 20j)
    return frequency, volts + 1e-6 * (rng.normal(size=points) + 1j * rng.normal(size=points))


def drum(folder: Path, text: str = FILM) -> str:
    """Write the geometry of the drum, and return its name."""
    (folder / "drum.toml").write_text(text, encoding="utf-8")
    return "drum.toml"
