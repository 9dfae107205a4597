"""What a lab-file format is, and what all of them share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles.spec import Spec
from femnl.io.measurement import quantity

if TYPE_CHECKING:
    import xarray as xr

T = TypeVar("T")
PARTS = ("real", "imag", "amplitude", "magnitude", "phase")
"""Columns that make an amplitude."""
LARGEST = 2**30  # bytes of a file
SWEEP_VALUES = {
    "drive": "V",
    "direction": "",
    "x": "m",
    "y": "m",
    "harmonic": "",
    "time": "s",
    "duration": "s",
    "temperature": "K",
    "pressure": "Pa",
    "laser_power": "W",
    "voltage": "V",
}
"""What a sweep of a `response` may have one value of, with its unit."""
RMS = float(np.sqrt(2))  # amplitude over root mean square of a sine

Sweep = tuple[NDArray[np.float64], NDArray[np.complex128]]
Labels = dict[str, NDArray[np.float64] | None]
Groups: TypeAlias = "dict[str, xr.Dataset]"
Read = Callable[[Sequence[Path], Spec], tuple[Groups, list[str]]]


@dataclass(frozen=True)
class Format:
    """A format of lab files: its name, whether a file is of it, and how to read files of it.

    The higher priority wins.
    """

    name: str
    recognise: Callable[[Path], bool]
    read: Read
    priority: int = 0


def head(path: Path, size: int = 512) -> bytes:
    """Return the first bytes of a file. Raises: MeasurementError if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(size)
    except OSError as error:
        raise MeasurementError(
            f"{path}: cannot be read ({error.strerror}); check the path and its permissions"
        ) from None


def need_size(path: Path, remedy: str) -> None:
    """Refuse a file that is larger than any format allows. Raises: MeasurementError."""
    size = path.stat().st_size
    if size > LARGEST:
        raise MeasurementError(
            f"{path}: {size / 2**30:.1f} GiB, more than {LARGEST / 2**30:g}; {remedy}"
        )


def undamaged(path: Path, what: str, read: Callable[[], T]) -> T:
    """Run a library's reader on a file of a stranger.

    Raises: MeasurementError, which names the file and what it should be, in the place of anything
    that damage makes the reader stumble over: each has other exceptions, and none lists them.
    """
    try:
        return read()
    except Exception as error:
        raise MeasurementError(
            f"{path}: damaged, or not a {what} ({str(error)[:80]}); save it again"
        ) from error


def text_lines(path: Path) -> list[str]:
    """Return the lines of a text file of bounded size.

    Raises: MeasurementError if it is too large or not text.
    """
    need_size(path, "split it")
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise MeasurementError(f"{path}: not UTF-8 text; export it as UTF-8") from None


def refuse_lengths(columns: Mapping[str, NDArray[Any]], where: str) -> None:
    """Refuse columns of unequal length, and such without a row. Raises: MeasurementError."""
    parts = {name: columns[name].shape for name in PARTS if name in columns}
    if len(set(parts.values())) > 1:
        told = ", ".join(f"{name} has shape {shape}" for name, shape in parts.items())
        raise MeasurementError(f"{where}: parts of an amplitude differ: {told}; save them alike")
    plain = {name: len(values) for name, values in columns.items() if values.ndim == 1}
    if len(plain) < len(columns):  # arrays in the shape of the contract, which checks them
        return
    if len(set(plain.values())) > 1:
        told = ", ".join(f"{name} has {length}" for name, length in plain.items())
        raise MeasurementError(f"{where}: columns of unequal length: {told}; save them alike")
    if columns and not any(plain.values()):
        raise MeasurementError(f"{where}: no row of data; export it again")


def scalar_values(spec: Spec, names: dict[str, str], where: str) -> dict[str, float]:
    """Read the single numbers of the table [values] for the given names with their SI units."""
    found = {}
    for name, unit in names.items():
        if name in spec.values:
            value = spec.values[name]
            if isinstance(value, list):
                raise MeasurementError(f"{where}: values.{name} is a list; give one number for all")
            found[name] = quantity(value, unit, f"{where}: values.{name}")[0]
    return found


def per_sweep(
    spec: Spec, name: str, unit: str, sweeps: int, where: str
) -> NDArray[np.float64] | None:
    """Read a value of the table [values], given once or as a list, one for each sweep."""
    if name not in spec.values:
        return None
    value = spec.values[name]
    numbers = [
        quantity(one, unit, f"{where}: values.{name}")[0]
        for one in (value if isinstance(value, list) else [value])
    ]
    if len(numbers) not in (1, sweeps):
        raise MeasurementError(
            f"{where}: values.{name} has {len(numbers)} entries for {sweeps} sweeps; give one, "
            "or one for each"
        )
    return np.broadcast_to(np.array(numbers), (sweeps,))


def direction_of(frequency: NDArray[np.float64]) -> int:
    """Return +1 for a sweep up, −1 for one down and 0 for neither, by the order of its points."""
    steps = np.diff(frequency)
    if np.all(steps >= 0):
        return 1
    return -1 if np.all(steps <= 0) else 0


def sweeps_to_response(
    sweeps: Sequence[Sweep],
    labels: Labels,
    spec: Spec,
    where: str,
    units: Mapping[str, str] | None = None,
) -> tuple[xr.Dataset, list[str]]:
    """Build a `response` from sweeps as they were taken.

    The order of the points gives the direction. Points are sorted, and short sweeps are filled with
    NaN.

    Args: sweeps: (frequency [Hz], amplitude [V]) in the order taken; labels: per-sweep arrays that
    the files give; spec: fills the rest; units: those of labels that are control variables of the
    file's own.
    Returns: the Dataset and notes on what was found.
    """
    points = max(f.size for f, _ in sweeps)
    frequency = np.full((len(sweeps), points), np.nan)
    volts = np.full((len(sweeps), points), np.nan * (1 + 1j))
    direction = np.zeros(len(sweeps))
    unplaced = 0
    for row, (f, v) in enumerate(sweeps):
        known = np.isfinite(f)
        unplaced += int(np.count_nonzero(~known))
        f = f[known]
        v = v[known]
        direction[row] = direction_of(f)
        order = np.argsort(f, kind="stable")
        frequency[row, : f.size] = f[order]
        volts[row, : f.size] = v[order]
    ups = np.count_nonzero(direction > 0)
    downs = np.count_nonzero(direction < 0)
    units = units or {}
    notes = [
        f"{where}: {len(sweeps)} sweeps, {ups} up and {downs} down, by the order of their points"
    ]
    if unplaced:
        notes.append(f"{where}: {unplaced} points without a frequency left out")
    given: Labels = dict.fromkeys(SWEEP_VALUES)
    by_order = direction if np.all(direction) else None
    given |= {"direction": None if "direction" in spec.values else by_order, **labels}
    if given["direction"] is None and "direction" not in spec.values:
        notes.append(
            f"{where}: {np.count_nonzero(direction == 0)} sweeps are neither up nor down, so "
            "direction is left out"
        )
    for name, unit in SWEEP_VALUES.items():
        if given[name] is None:
            given[name] = per_sweep(spec, name, unit, len(sweeps), where)
    harmonic = given.pop("harmonic")
    scalars = scalar_values(spec, {"noise_sd": "V", "wavelength": "m"}, where)
    mode = spec.values.get("mode")
    dataset = measurement.response(
        frequency,
        volts,
        harmonic=1 if harmonic is None else harmonic,
        mode=None if mode is None else str(mode),
        drive=given["drive"],
        direction=given["direction"],
        x=given["x"],
        y=given["y"],
        time=given["time"],
        duration=given["duration"],
        temperature=given["temperature"],
        pressure=given["pressure"],
        laser_power=given["laser_power"],
        voltage=given["voltage"],
        control={name: own for name, own in labels.items() if name in units and own is not None},
        units=units,
        **scalars,
    )
    if harmonic is None:
        notes.append(f"{where}: harmonic not given, taken as 1")
    return dataset, notes
