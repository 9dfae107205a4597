"""Units that a file states of its columns, in their headings or beside them."""

import re
from collections.abc import Mapping
from unicodedata import normalize

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.levels import is_level
from femnl.io.labfiles.named_columns import COMPLEX
from femnl.io.labfiles.spec import Column, Spec
from femnl.io.measurement import KINDS, to_si
from femnl.io.measurement.units import is_unit_of

_IN_BRACKETS = re.compile(r".*\S\s*[\[(]\s*([^\[\]()]+?)\s*[\])]")
_BEHIND_SLASH = re.compile(r".*\S\s*/\s*([^\s/]+)")
_BEHIND = re.compile(
    r".*\S[ _]((?:[fpnuµμmkMGT](?:Hz|V|s|m|A|W|Pa|K|N|T|rad))|Hz|deg|m?bar|[Tt]orr|degC|°C?|min)"
)
_RMS = re.compile(r"(\w*V)[ _]?rms", re.IGNORECASE)


def heading_unit(heading: str) -> str:
    """Return what stands for a unit in a heading, "" without any: "f [kHz]", "f / kHz", "f_kHz"."""
    for known in (_IN_BRACKETS, _BEHIND_SLASH, _BEHIND):
        match = known.fullmatch(heading)
        if match:
            return match[1]
    return ""


def as_stated(spec: Spec, units: Mapping[str, str], where: str) -> tuple[Spec, list[str]]:
    """Return a spec whose columns have the units that the file states, and what was taken so.

    Args: units: what may be a unit, by column; no unit of the quantity is none.
    Raises: MeasurementError where the spec states another one, and where only the file says that
    volts are root mean square.
    """
    units = {normalize("NFKC", name): unit for name, unit in units.items()}
    columns: dict[str, Column | str | int] = dict(spec.columns)
    notes: list[str] = []
    for name in spec.columns:
        column = spec.column(name)
        single = isinstance(column.column, str | int)
        found = units.get(normalize("NFKC", str(column.column)), "") if single else ""
        place = f"{where}: columns.{name}"
        rms = _RMS.fullmatch(found)
        if rms and spec.rms is None:
            raise MeasurementError(
                f"{place}: {str(column.column)!r} is root mean square; give rms = true, which "
                "multiplies by √2, or rms = false"
            )
        found = rms[1] if rms else found
        if not _fits(found, name, spec):
            if found and column.unit is None and (si := _si(name, spec)):
                notes.append(
                    f"{place}: {found!r} of {str(column.column)!r} is no unit of it that is known, "
                    f"so that numbers are taken in {si}; give unit where they are not"
                )
            continue
        if column.unit is None:
            columns[name] = column.model_copy(update={"unit": found})
            notes.append(f"{place}: in {found}, as the file says")
        elif not _same(found, column.unit, _si(name, spec)):
            raise MeasurementError(
                f"{place}: unit = {column.unit!r}, but the file says {found!r} of "
                f"{str(column.column)!r}; correct the one that is wrong"
            )
    return spec.model_copy(update={"columns": columns}), notes


def _si(name: str, spec: Spec) -> str:
    """Return the SI unit of a quantity, "" where it has none."""
    datasets = KINDS[str(spec.kind)].datasets
    known = datasets[name].unit if name in datasets else ""
    return COMPLEX.get(name, known) or ""


def _fits(unit: str, name: str, spec: Spec) -> bool:
    """Whether text is a unit of a quantity that has one; dB alone says nothing of volts."""
    if is_level(unit):
        return name == "power" or (name == "magnitude" and unit != "dB")
    si = _si(name, spec)
    return bool(unit and si) and is_unit_of(unit, si)


def _same(one: str, other: str, si: str) -> bool:
    """Whether two units are one; levels in decibel may be named by their reference or not."""
    if is_level(one) or is_level(other):
        return is_level(one) and is_level(other)
    if not is_unit_of(other, si):
        return True  # which is refused where it is read
    first, second = (float(to_si(1.0, unit, si, "")) for unit in (one, other))
    return abs(first - second) <= 1e-9 * abs(first)
