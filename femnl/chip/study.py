"""Study files of a chip: its devices, where they are, what they are, and what was measured."""

import csv
import re
import tomllib
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from femnl.chip.measured import measured
from femnl.core.errors import ParameterError, one_line
from femnl.io.measurement.units import quantity

FEWEST = 4
"""Devices below which there is no chip to speak of."""
LIKE = 0.02
"""Gap of the logarithm of frequency between two designs, where a file states no designs: films of
one chip differ by less from edge to edge, designs mostly by more."""
MOST = 2000
"""More devices than this are taken for a mistake: the model takes time ∝ n³."""


class Strict(BaseModel):
    """Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Columns(Strict):
    """Names of the columns of a table; those that a table does not have are left out."""

    device: str = "device"
    mode: str = "mode"
    frequency: str = "frequency"
    frequency_sd: str = "frequency_sd"
    quality_factor: str = "quality_factor"
    quality_factor_sd: str = "quality_factor_sd"
    design: str = "design"
    x: str = "x"
    y: str = "y"


class Table(Strict):
    """A table of numbers: CSV with a head, in SI units.

    chip: how the names of the devices begin that are on this chip; the rest of the name is kept.
    """

    file: str
    chip: str = ""
    columns: Columns = Columns()


class Positions(Strict):
    """Places read from the devices' names: a regular expression with the groups x and y."""

    pattern: str
    pitch: str | float = 1.0


class Mode(Strict):
    """One mode of a device."""

    mode: str = "1"
    frequency: str | float
    frequency_sd: str | float = 0.0
    quality_factor: float | None = None
    quality_factor_sd: float = 0.0


class Device(Strict):
    """One device: numbers, or a measurement file with spectra, responses or decays."""

    name: str
    design: str = ""
    position: Annotated[list[str | float], Field(min_length=2, max_length=2)] | None = None
    measurement: str | None = None
    modes: list[Mode] = []


class Design(Strict):
    """A design; geometry: a name or a file beside the study, for the film's own numbers."""

    geometry: str


class StudyFile(Strict):
    """A study file."""

    name: str
    table: Table | None = None
    positions: Positions | None = None
    design: dict[str, Design] = {}
    device: list[Device] = []


@dataclass(frozen=True)
class Number:
    """A number measured several times or once: median, and standard deviation of that.

    repeats: how often.
    """

    value: float
    sd: float
    repeats: int = 1


@dataclass(frozen=True)
class Member:
    """A device of a chip. place [m, or steps of the grid], NaN where it is not known.

    frequency [Hz], quality: by mode.
    """

    name: str
    design: str
    place: tuple[float, float]
    frequency: dict[str, Number] = field(default_factory=dict)
    quality: dict[str, Number] = field(default_factory=dict)


@dataclass(frozen=True)
class Chip:
    """A chip. geometries: of designs, by name. notes: what was assumed. unit: of places."""

    name: str
    members: tuple[Member, ...]
    geometries: dict[str, str]
    notes: tuple[str, ...]
    unit: str = "m"


def read_chip(path: Path) -> Chip:
    """Read a study file and everything that it names.

    Raises: ParameterError, MeasurementError: one line that names file, key, value and remedy.
    """
    study = _parse(path)
    notes: list[str] = []
    found: dict[str, _Readings] = defaultdict(_Readings)
    if study.table is not None:
        _read_table(path.parent / study.table.file, study.table, found)
    for device in study.device:
        _read_device(path, device, found[device.name])
    unit = "m"
    if study.positions is not None:
        unit = _place(path, study.positions, found)
    if not FEWEST <= len(found) <= MOST:
        raise ParameterError(
            f"{path}: {len(found)} devices; a chip has {FEWEST} to {MOST}; "
            "check table.chip, or add [[device]] tables"
        )
    members = [readings.member(name) for name, readings in found.items()]
    members = _with_designs(members, notes)
    geometries = {name: _beside(path, d.geometry) for name, d in study.design.items()}
    missing = sorted(set(geometries) - {m.design for m in members})
    if missing:
        raise ParameterError(f"{path}: design.{missing[0]}: no device is of this design")
    return Chip(study.name, tuple(members), geometries, tuple(notes), unit)


def _beside(path: Path, geometry: str) -> str:
    beside = path.parent / geometry
    return str(beside) if beside.is_file() else geometry


class _Readings:
    """What was read of one device, reading by reading."""

    def __init__(self) -> None:
        self.design = ""
        self.place = (np.nan, np.nan)
        self.frequency: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self.quality: dict[str, list[tuple[float, float]]] = defaultdict(list)

    def member(self, name: str) -> Member:
        return Member(
            name,
            self.design,
            self.place,
            {mode: _median(each) for mode, each in self.frequency.items()},
            {mode: _median(each) for mode, each in self.quality.items()},
        )


def _median(readings: list[tuple[float, float]]) -> Number:
    """Return the median of readings, with the larger of their stated error and their scatter."""
    values = np.array([value for value, _ in readings])
    stated = float(np.median([sd for _, sd in readings]))
    count = len(values)
    scatter = 1.4826 * float(np.median(np.abs(values - np.median(values)))) if count > 2 else 0.0
    return Number(float(np.median(values)), max(stated, scatter) / np.sqrt(count), count)


def _parse(path: Path) -> StudyFile:
    try:
        return StudyFile.model_validate(tomllib.loads(path.read_text(encoding="utf-8-sig")))
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ParameterError(one_line(f"{path}: is no TOML ({error}); mend this line")) from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ParameterError(one_line(f"{path}: {key}: {first['msg']}")) from None


def _read_table(path: Path, table: Table, measured: dict[str, _Readings]) -> None:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            head = list(reader.fieldnames or [])
            rows = list(enumerate(reader, 2))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(one_line(f"{path}: cannot be read ({error})")) from None
    columns = table.columns
    for wanted in (columns.device, columns.frequency):
        if wanted not in head:
            raise ParameterError(
                one_line(f"{path}: no column {wanted!r}; it has {', '.join(head)[:200]}")
            )
    for line, row in rows:
        name = row[columns.device]
        if not name.startswith(table.chip):
            continue
        where = f"{path}, line {line}"
        readings = measured[name[len(table.chip) :]]
        mode = row.get(columns.mode) or "1"
        number = _positive(row[columns.frequency], where, columns.frequency)
        readings.frequency[mode].append((number, _error(row, columns.frequency_sd, where)))
        if row.get(columns.quality_factor):
            quality = _positive(row[columns.quality_factor], where, columns.quality_factor)
            readings.quality[mode].append((quality, _error(row, columns.quality_factor_sd, where)))
        readings.design = row.get(columns.design) or readings.design
        if row.get(columns.x) and row.get(columns.y):
            readings.place = (
                _finite(row[columns.x], where, columns.x),
                _finite(row[columns.y], where, columns.y),
            )


def _finite(text: str, where: str, column: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ParameterError(one_line(f"{where}: {column}: {text[:40]!r} is no finite number"))
    return value


def _positive(text: str, where: str, column: str) -> float:
    value = _finite(text, where, column)
    if value <= 0:
        raise ParameterError(f"{where}: {column}: {value:g} is not above zero")
    return value


def _error(row: dict[str, Any], column: str, where: str) -> float:
    return _positive(row[column], where, column) if row.get(column) else 0.0


def _read_device(path: Path, device: Device, readings: _Readings) -> None:
    where = f"{path}: device {device.name}"
    readings.design = device.design
    if device.position is not None:
        x, y = (quantity(value, "m", f"{where}: position")[0] for value in device.position)
        readings.place = (x, y)
    for mode in device.modes:
        frequency = quantity(mode.frequency, "Hz", f"{where}: frequency")[0]
        sd = quantity(mode.frequency_sd, "Hz", f"{where}: frequency_sd")[0]
        if not frequency > 0:
            raise ParameterError(f"{where}: frequency: {frequency:g} Hz is not above zero")
        readings.frequency[mode.mode].append((frequency, sd))
        if mode.quality_factor is not None:
            if not mode.quality_factor > 0:
                raise ParameterError(f"{where}: quality_factor: it is not above zero")
            readings.quality[mode.mode].append((mode.quality_factor, mode.quality_factor_sd))
    if device.measurement is not None:
        _read_measurement(path.parent / device.measurement, readings)
    if not readings.frequency:
        raise ParameterError(f"{where}: has no frequency; give modes or a measurement")


def _read_measurement(path: Path, readings: _Readings) -> None:
    """Take frequencies and quality factors of the measurements of a file."""
    read = 0
    for numbers in measured(path):
        read += 1
        readings.frequency[numbers.mode].append((numbers.frequency, numbers.frequency_sd))
        if numbers.quality is not None:
            readings.quality[numbers.mode].append((numbers.quality, numbers.quality_sd))
    if not read:
        raise ParameterError(
            f"{path}: nothing of use; a chip takes spectra, responses and decays with a frequency"
        )


def _place(path: Path, positions: Positions, measured: dict[str, _Readings]) -> str:
    """Read places from names; return their unit."""
    try:
        pattern = re.compile(positions.pattern)
    except re.error as error:
        raise ParameterError(one_line(f"{path}: positions.pattern: {error}")) from None
    if not {"x", "y"} <= set(pattern.groupindex):
        raise ParameterError(
            f"{path}: positions.pattern: it needs the groups (?P<x>…) and (?P<y>…)"
        )
    steps = isinstance(positions.pitch, float)
    pitch = quantity(positions.pitch, "m", f"{path}: positions.pitch")[0]
    for name, readings in measured.items():
        match = pattern.search(name)
        if match is None:
            raise ParameterError(
                one_line(f"{path}: positions.pattern: device {name[:40]!r} does not match it")
            )
        where = f"{path}: positions.pattern: device {name}"
        readings.place = (
            pitch * _finite(match["x"], where, "x"),
            pitch * _finite(match["y"], where, "y"),
        )
    return "steps" if steps else "m"


def _with_designs(members: list[Member], notes: list[str]) -> list[Member]:
    """Return the devices with designs; where none is stated, those of like frequency are alike."""
    stated = [m for m in members if m.design]
    if len(stated) == len(members):
        return members
    if stated:
        lacking = next(m.name for m in members if not m.design)
        raise ParameterError(f"device {lacking}: it has no design; give one for every device")
    ordered = sorted(members, key=lambda m: min(n.value for n in m.frequency.values()))
    found: list[Member] = []
    number, last = 1, None
    for m in ordered:
        lowest = min(n.value for n in m.frequency.values())
        if last is not None and np.log(lowest / last) > LIKE:
            number += 1
        last = lowest
        found.append(Member(m.name, str(number), m.place, m.frequency, m.quality))
    notes.append(
        f"designs: none is stated; {number} groups of frequencies, more than {LIKE:.0%} apart, "
        "are taken for designs"
    )
    return found
