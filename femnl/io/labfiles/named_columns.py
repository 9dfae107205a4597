"""The columns of a file that its description names, in SI."""

from collections.abc import Mapping
from typing import Any
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.levels import directions, is_level, magnitudes
from femnl.io.labfiles.spec import Column, Spec
from femnl.io.measurement import KINDS, quantity, to_si
from femnl.io.measurement.contract import Item
from femnl.io.measurement.control_variables import free_item
from femnl.io.measurement.units import is_unit_of

MILLIWATT = 1e-3  # W, of which powers in decibel are multiples
Columns = dict[str, NDArray[Any]]
COMPLEX = {"amplitude": "V", "magnitude": "V", "phase": "rad"}
"""Quantities that together make a complex one, with their units."""


def take_columns(spec: Spec, table: Mapping[str, NDArray[Any]], where: str) -> Columns:
    """Pick the columns that the spec names and turn them into SI.

    Args: spec: with kind and columns; table: the file's columns by name. Returns: quantity →
    values.
    Raises: MeasurementError for an unknown quantity, a missing column or a wrong unit.
    """
    if spec.kind is None:
        raise MeasurementError(
            f"{where}: the TOML names columns and no kind; give one of {', '.join(KINDS)}"
            if spec.columns
            else f"{where}: needs a TOML beside it that says what its columns are; start with kind "
            "and [columns]"
        )
    known = {**KINDS[spec.kind].datasets}
    _refuse_doubled(spec, where)
    taken: Columns = {}
    length = max((values.shape[0] for values in table.values()), default=0)
    for name in spec.columns:
        place = f"{where}: columns.{name}"
        column = spec.column(name)
        if name not in known and name not in (*COMPLEX, "sweep"):
            known[name] = _control(spec, name, place)
        if column.rate is not None:
            rate, _ = quantity(column.rate, "Hz", f"{place}.rate")
            taken[name] = np.arange(length) / rate
            continue
        keys = columns_of(column)
        found = [_named_so(wanted, table, place) for wanted in keys]
        key = ", ".join(str(wanted) for wanted in keys)
        if len({values.shape for values in found}) > 1:
            raise MeasurementError(f"{place}: columns {key} differ in length; save them alike")
        values = found[0] if len(keys) == 1 else np.stack(found)
        si = COMPLEX.get(name, known[name].unit if name in known else "")
        if si is None or name == "sweep":
            taken[name] = np.asarray(values, dtype=object)
            continue
        where_here = f"{place} ({key})"
        if name == "direction":
            values = directions(values)
        if name == "power" and si == "dB":
            taken[name] = _powers(values, column.unit, where_here)
        elif name == "magnitude" or (name == "drive" and is_level(column.unit)):
            taken[name] = magnitudes(values, column.unit, key, where_here)
        else:
            unit = column.unit if column.unit is not None else si
            taken[name] = _numbers(values, unit, si, where_here)
        if column.offset is not None:
            taken[name] = taken[name] + quantity(column.offset, si, f"{place}.offset")[0]
        if column.round is not None:
            step, _ = quantity(column.round, si, f"{place}.round")
            taken[name] = np.round(taken[name] / step) * step
    return taken


def _named_so(wanted: str | int | None, table: Mapping[str, NDArray[Any]], place: str) -> Any:
    """Return a column by its heading, however its µ is written, or by its number from 1."""
    same = {normalize("NFKC", name): values for name, values in table.items()}
    key = normalize("NFKC", str(wanted))
    if key in same:
        return same[key]
    if isinstance(wanted, int) and 1 <= wanted <= len(table):
        return list(table.values())[wanted - 1]
    raise MeasurementError(
        f"{place}: no column {str(wanted)!r}; the file has {', '.join(list(table)[:12])}"
    )


def _refuse_doubled(spec: Spec, where: str) -> None:
    """Refuse two quantities that are one column."""
    first: dict[str, str] = {}
    for name in spec.columns:
        key = str(spec.column(name).column)
        if spec.column(name).column is None:
            continue
        if key in first:
            raise MeasurementError(
                f"{where}: columns.{name} and columns.{first[key]} are both {key!r}; correct one"
            )
        first[key] = name


def need_columns(columns: Columns, names: tuple[str, ...], where: str) -> None:
    """Refuse a table without one of its columns. Raises: MeasurementError."""
    for name in names:
        if name not in columns:
            raise MeasurementError(f"{where}: columns.{name} is missing; say which column holds it")


def _control(spec: Spec, name: str, place: str) -> Item:
    """Return the item of a column that is a control variable of the file's own.

    Raises: MeasurementError where the kind has none, or the column states no unit.
    """
    kind = KINDS[str(spec.kind)]
    unit = spec.column(name).unit
    if kind.free and unit is not None:
        return free_item(kind, name, unit, place)
    own = (
        f', or give the unit of a control variable: {name} = {{ column = …, unit = "V" }}'
        if kind.free
        else ""
    )
    raise MeasurementError(
        f"{place}: not a quantity of kind {spec.kind}; use "
        f"{', '.join([*kind.datasets, *COMPLEX])}{own}"
    )


def in_own_units(spec: Spec, units: Mapping[str, str]) -> Spec:
    """Return a spec whose columns have the units of the file where it states none.

    Args: units: those that the file gives, by column.
    """
    columns: dict[str, Column | str | int] = {}
    for name in spec.columns:
        column = spec.column(name)
        if column.unit is None and isinstance(column.column, str) and column.column in units:
            column = column.model_copy(update={"unit": units[column.column]})
        columns[name] = column
    return spec.model_copy(update={"columns": columns})


def columns_of(column: Column) -> list[str | int]:
    """Return the names or numbers of the columns that are one quantity, one or several sweeps."""
    given = column.column
    if given is None:
        return []
    return list(given) if isinstance(given, list) else [given]


def named(spec: Spec) -> set[str]:
    """Return the columns that a spec names."""
    return {str(one) for name in spec.columns for one in columns_of(spec.column(name))}


def unread(spec: Spec, table: Mapping[str, NDArray[Any]], where: str) -> list[str]:
    """Say which columns of a file the spec does not name."""
    known = named(spec)
    left = [name for name in table if name not in known]
    return [f"{where}: columns that are not read: {', '.join(left[:12])}"] if left else []


def _powers(values: NDArray[Any], unit: str | None, where: str) -> NDArray[Any]:
    """Return powers in decibel, those in watts by 1 mW.

    Raises: MeasurementError for another unit, and for watts that are not positive, which have no
    level.
    """
    if unit is None or is_level(unit):
        return _numbers(values, "dB", "dB", where)
    if not is_unit_of(unit, "W"):
        raise MeasurementError(
            f"{where}: unit {unit!r} is that of no power; give it in dB, dBm or W, or name a "
            "voltage magnitude"
        )
    watts = _numbers(values, unit, "W", where)
    if np.any(watts <= 0):
        raise MeasurementError(
            f"{where}: {watts[watts <= 0].flat[0]:g} W has no level in decibel; subtract no "
            "background, and mark what is no power as NaN"
        )
    return np.asarray(10 * np.log10(watts / MILLIWATT))


def _numbers(values: NDArray[Any], unit: str, si: str, where: str) -> NDArray[Any]:
    if values.dtype.kind == "c":
        return to_si(values.real, unit, si, where) + 1j * to_si(values.imag, unit, si, where)
    if not values.size:
        return np.empty(values.shape)
    if values.dtype.kind not in "iuf":
        row, bad = next(
            ((k, str(value)) for k, value in enumerate(values.ravel(), 1) if not is_number(value)),
            (0, ""),
        )
        if _with_comma(bad):
            raise MeasurementError(
                f'{where}: {bad[:30]!r} has a decimal comma; give decimal = "," in the TOML'
            )
        raise MeasurementError(
            f"{where}: row {row}: {bad[:30]!r} is not a number; correct that row or mark it as NaN"
            if bad
            else f"{where}: holds texts such as {str(values.flat[0])[:30]!r}; save numbers, with "
            "the decimal mark that the TOML names"
        )
    return to_si(values, unit, si, where)


def _with_comma(text: str) -> bool:
    """Whether text is a number whose decimal mark is a comma."""
    return text.count(",") == 1 and is_number(text.replace(",", "."))


def is_number(value: object) -> bool:
    """Whether a value is a number as tables write it; Python also reads 1_000 and other digits."""
    text = str(value)
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text
