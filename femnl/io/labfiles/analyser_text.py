"""Ring-downs as a signal analyser in zero span writes them: a head, then power against time.

    % Sample ID: SP40-64
    % Frequency [Hz]: 1526617.9
    % Pressure [mBar]: 3.65e-06
    % Notes:
    % initial nonlinear damping
    % measurement data
    % time [s], power [dBm]
    0.012, -88.2127

The head has lines `% Key: value` or `% Key [unit]: value` in any order; lines after `% Notes:` that
have no key of this table belong to the notes. Its last line names the columns: time, and one of
power [dBm or dB], magnitude [V], or real [V] and imag [V]. Decibels are kept as they are: a decay
needs power only up to a factor. A stated quality factor is not data and is left out. A record over
frequency is a spectrum of noise power and no ring-down; its file is named and left out.
Source: the data published with the Ringdown-Processor (github.com/qpit/Ringdown-Processor).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles.base import Format, Groups, head, text_lines
from femnl.io.labfiles.levels import even_clock, refuse_times_that_go_back
from femnl.io.labfiles.spec import Spec
from femnl.io.measurement import quantity, to_si

if TYPE_CHECKING:
    import xarray as xr

_HEADING = re.compile(
    r"^%\s*(?:time|frequency)\s*\[[^\]\n]*\]\s*,\s*\w+\s*\[[^\]\n]*\]", re.MULTILINE | re.IGNORECASE
)
_COLUMN = re.compile(r"\s*(\w+)\s*\[([^\]]*)\]\s*")
_ENTRY = re.compile(r"%\s*([A-Za-z][\w ]*?)\s*(?:\[([^\]]*)\])?\s*:\s*(.*)")
_NUMBERS = {
    "frequency": ("frequency", "Hz"),
    "bandwidth": ("bandwidth", "Hz"),
    "resolution bandwidth": ("bandwidth", "Hz"),
    "temperature": ("temperature", "K"),
    "pressure": ("pressure", "Pa"),
}
_TEXTS = {
    "sample id": "sample",
    "mode id": "mode",
    "date and time": "date",
    "measurement id": "record",
}
_OTHER = ("measurement type", "quality factor", "notes")
_UNITS = {"magnitude": "V", "real": "V", "imag": "V", "time": "s"}
_DECIBELS = ("dbm", "db")
_HEAD_BYTES = 16384
_LEAST = 3  # rows without which there is nothing to import

Rows = NDArray[np.float64]


def _recognise(path: Path) -> bool:
    start = head(path, _HEAD_BYTES)
    if not start.lstrip(b"\xef\xbb\xbf").startswith(b"%"):
        return False
    return _HEADING.search(start.decode("utf-8", "replace")) is not None


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    groups: Groups = {}
    notes: list[str] = []
    for path in paths:
        lines = text_lines(path)
        at = next(row for row, line in enumerate(lines) if _HEADING.match(line))
        names = _columns(path, lines[at], at + 1)
        if "frequency" in names:
            notes.append(f"{path}: power against frequency, a spectrum and no ring-down; left out")
            continue
        name = _group_name(path, spec, len(paths))
        if name in groups:
            raise MeasurementError(f"{path}: a second file makes the group {name}; rename it")
        rows = _rows(path, lines, at + 1, list(names))
        groups[name] = _dataset(path, names, rows, _attributes(path, lines[:at], notes), notes)
    if not groups:
        raise MeasurementError(
            f"{paths[0]}: power against frequency, a spectrum and no ring-down; femnl imports "
            "records over time"
        )
    return groups, notes


def _group_name(path: Path, spec: Spec, files: int) -> str:
    """Name the group as the spec does where it names one, else by its file."""
    if files == 1 and "name" in spec.model_fields_set:
        return spec.name
    return re.sub(r"[^\w.-]+", "_", path.stem) or spec.name


def _columns(path: Path, line: str, number: int) -> dict[str, str]:
    """Return the unit of each column, by its name in small letters."""
    names: dict[str, str] = {}
    for place, cell in enumerate(line.lstrip("% ").split(","), start=1):
        found = _COLUMN.fullmatch(cell)
        if found is None:
            raise MeasurementError(
                f"{path}: line {number}, column {place}: heading {cell.strip()[:30]!r} is not "
                "'name [unit]'; correct it"
            )
        names[found[1].lower()] = found[2]
    return names


def _rows(path: Path, lines: list[str], first: int, names: list[str]) -> Rows:
    """Return the numbers (n, columns) below the heading.

    Raises: MeasurementError for damaged lines, for fewer than 3 rows, and for times that go back.
    """
    rows: list[list[float]] = []
    numbers: list[int] = []
    for number, line in enumerate(lines[first:], start=first + 1):
        if not line.strip() or line.startswith("%"):
            continue
        cells = line.split(",")
        if len(cells) != len(names):
            raise MeasurementError(
                f"{path}: line {number}, column {min(len(cells), len(names)) + 1}: "
                f"{len(cells)} numbers for the columns {', '.join(names)}; the line is damaged "
                "or cut off, correct or delete it"
            )
        rows.append([_number(path, number, place, cell) for place, cell in enumerate(cells, 1)])
        numbers.append(number)
    if len(rows) < _LEAST:
        raise MeasurementError(
            f"{path}: line {len(lines)}: only {len(rows)} rows of data; export the record again"
        )
    found = np.array(rows)
    refuse_times_that_go_back(
        found[:, names.index("time")], [f"{path}: line {number}" for number in numbers]
    )
    return found


def _number(path: Path, line: int, column: int, cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise MeasurementError(
            f"{path}: line {line}, column {column}: {cell.strip()[:30]!r} is not a number; "
            "correct it, or write nan"
        ) from None


def _dataset(
    path: Path,
    names: dict[str, str],
    rows: Rows,
    attributes: dict[str, str | float],
    notes: list[str],
) -> xr.Dataset:
    columns: dict[str, Rows] = {}
    for (name, unit), values in zip(names.items(), rows.T, strict=True):
        if name == "power" and unit.lower() in _DECIBELS:
            columns[name] = values
        elif name in _UNITS:
            columns[name] = to_si(values, unit, _UNITS[name], f"{path}: column {name}")
        else:
            notes.append(f"{path}: column {name} [{unit}] is not used")
    if columns.keys() <= {"time", "imag"}:
        given = ", ".join(f"{name} [{unit}]" for name, unit in names.items())
        raise MeasurementError(
            f"{path}: columns {given}: a ring-down needs power [dB or dBm], magnitude [V], or "
            "real [V] and imag [V]; name one so"
        )
    columns["time"], rounded = even_clock(columns["time"], str(path))
    notes += rounded
    return measurement.decay(**columns, attributes=attributes)


def _attributes(path: Path, lines: list[str], notes: list[str]) -> dict[str, str | float]:
    """Read the head: numbers in SI, texts, and the notes of whoever took the record."""
    found: dict[str, str | float] = {}
    said: list[str] = []
    in_notes = False
    for number, line in enumerate(lines, start=1):
        entry = _ENTRY.fullmatch(line.strip())
        key = entry[1].strip().lower() if entry else ""
        if entry is None or key not in (*_NUMBERS, *_TEXTS, *_OTHER):
            words = line.lstrip("% ").strip()
            if in_notes and words and words.lower() != "measurement data":
                said.append(words)
            continue
        in_notes = key == "notes"
        value = entry[3].strip()
        if in_notes and value:
            said.append(value)
        elif key in _TEXTS and value:
            found[_TEXTS[key]] = value
        elif key in _NUMBERS:
            name, unit = _NUMBERS[key]
            given = re.sub("(?i)bar$", "bar", entry[2] or unit)
            place = f"{path}: line {number}: {entry[1].strip()}"
            if value.lower() not in ("", "nan"):
                found[name] = quantity(f"{value} {given}", unit, place)[0]
    if said:
        found["notes"] = "; ".join(said)
    unknown = [key for key, value in found.items() if isinstance(value, float) and value <= 0]
    notes += [f"{path}: {name} is {found.pop(name):g}, taken as not known" for name in unknown]
    return found


FORMAT = Format("analyser text", _recognise, _read, priority=2)
