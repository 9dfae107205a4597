"""What was read of each device, reading by reading, and tables of readings."""

import csv
from collections import defaultdict
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from femnl.chip.members import Member, Number
from femnl.chip.schema import Table
from femnl.core.errors import ParameterError, one_line
from femnl.core.robust import MAD
from femnl.core.toml import read_text
from femnl.io.labfiles.stated_units import heading_unit
from femnl.io.measurement import to_si
from femnl.io.measurement.contract import LEAST, MOST
from femnl.io.measurement.units import is_unit_of


class Readings:
    """What was read of one device, reading by reading."""

    def __init__(self) -> None:
        self.design = ""
        self.place = (np.nan, np.nan)
        self.frequency: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self.quality: dict[str, list[tuple[float, float]]] = defaultdict(list)

    def member(self, name: str) -> Member:
        """Return the device with one number for each mode."""
        return Member(
            name,
            self.design,
            self.place,
            {mode: median_of(each) for mode, each in self.frequency.items()},
            {mode: median_of(each) for mode, each in self.quality.items()},
        )


def median_of(readings: list[tuple[float, float]]) -> Number:
    """Return the median of readings, with its standard deviation.

    That of one reading is the larger of what is stated and the scatter of all, 1.4826 of their
    median deviation. That of the median is √(π/2n) of it, and 1/√n where it is the mean (n ≤ 2).
    """
    values = np.array([value for value, _ in readings])
    stated = float(np.median([sd for _, sd in readings]))
    median = float(np.median(values))
    scatter = MAD * float(np.median(np.abs(values - median)))
    count = len(values)
    part = np.sqrt((np.pi / 2 if count > 2 else 1.0) / count)
    return Number(median, float(max(stated, scatter) * part), count)


def read_table(path: Path, table: Table, measured: dict[str, Readings]) -> None:
    """Take the rows of a table that are of this chip, in SI units or those of its head."""
    try:
        reader = csv.DictReader(StringIO(read_text(path)))
        head = list(reader.fieldnames or [])
        rows = list(enumerate(reader, 2))
    except OSError as error:
        raise ParameterError(
            one_line(f"{path}: cannot be read ({error.strerror}); check table.file")
        ) from None
    except (ValueError, csv.Error) as error:
        raise ParameterError(one_line(f"{path}: is no table of text ({error})")) from None
    repeated = sorted({name for name in head if head.count(name) > 1})
    if repeated:
        raise ParameterError(
            one_line(f"{path}: the head has two columns {repeated[0]!r}; rename one")
        )
    columns = table.columns
    for wanted in (columns.device, columns.frequency):
        if wanted not in head:
            raise ParameterError(
                one_line(f"{path}: no column {wanted!r}; it has {', '.join(head)[:200]}")
            )
    hertz = _scale(columns.frequency, "Hz")
    for line, row in rows:
        # The reader fills short rows with None, and puts what is too much under None
        if None in row or None in row.values():
            raise ParameterError(
                f"{path}, line {line}: has not as many fields as the head ({len(head)})"
            )
        name = row[columns.device]
        if not name.startswith(table.chip):
            continue
        where = f"{path}, line {line}"
        readings = measured[name[len(table.chip) :]]
        mode = row.get(columns.mode) or "1"
        number = hertz * _positive(row[columns.frequency], where, columns.frequency)
        sd = _scale(columns.frequency_sd, "Hz") * _error(row, columns.frequency_sd, where)
        readings.frequency[mode].append((number, sd))
        if row.get(columns.quality_factor):
            quality = _positive(row[columns.quality_factor], where, columns.quality_factor)
            readings.quality[mode].append((quality, _error(row, columns.quality_factor_sd, where)))
        design = row.get(columns.design) or readings.design
        if readings.design and design != readings.design:
            raise ParameterError(
                one_line(
                    f"{where}: device {name} is of the design {design!r} here, and of "
                    f"{readings.design!r} above; give each device a name of its own"
                )
            )
        readings.design = design
        if row.get(columns.x) and row.get(columns.y):
            readings.place = (
                _scale(columns.x, "m") * finite(row[columns.x], where, columns.x),
                _scale(columns.y, "m") * finite(row[columns.y], where, columns.y),
            )


def _scale(column: str, si: str) -> float:
    """Return by what numbers of a column are multiplied: its head may state a unit.

    Raises: ParameterError where it has something else in brackets or behind a slash.
    """
    unit = heading_unit(column)
    if unit and is_unit_of(unit, si):
        return float(to_si(1.0, unit, si, column))
    if unit and set(column) & set("[(/"):
        raise ParameterError(
            one_line(
                f"table: {column!r} states {unit!r}, which is no unit of {si} that is known; "
                f"correct the head, or leave the unit out of it and give numbers in {si}"
            )
        )
    return 1.0


def finite(text: str, where: str, column: str) -> float:
    """Return a finite number from text."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ParameterError(one_line(f"{where}: {column}: {text[:40]!r} is no finite number"))
    return value


def _positive(text: str, where: str, column: str) -> float:
    value = finite(text, where, column)
    if value <= 0:
        raise ParameterError(f"{where}: {column}: {value:g} is not above zero")
    return measurable(value, f"{where}: {column}")


def measurable(value: float, where: str) -> float:
    """Return a number that is above zero, or a standard deviation, if a laboratory can have it."""
    if value > MOST or 0 < value < LEAST:
        raise ParameterError(
            f"{where}: value {value:g} is beyond any measurement ({LEAST:g} to {MOST:g}); check "
            "its unit"
        )
    return value


def _error(row: dict[str, Any], column: str, where: str) -> float:
    return _positive(row[column], where, column) if row.get(column) else 0.0
