"""Units that a file states of its columns, in their headings or beside them."""

import re
from collections.abc import Mapping
from unicodedata import normalize

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.levels import is_level
from femnl.io.labfiles.named_columns import COMPLEX, columns_of
from femnl.io.labfiles.spec import Column, Spec
from femnl.io.measurement import KINDS, to_si
from femnl.io.measurement.units import is_unit_of, multiples

_IN_BRACKETS = re.compile(r".*\S\s*[\[(]\s*([^\[\]()]+?)\s*[\])]")
_BEHIND_SLASH = re.compile(r".*\S\s*/\s*([^\s/]+)")
_BEHIND = re.compile(
    r".*\S[ _]((?:[fpnuµμmkMGT](?:Hz|V|s|m|A|W|Pa|K|N|T|rad))|Hz|deg|m?bar|[Tt]orr|degC|°C?|min)"
)
ELSEWHERE = frozenset(
    unit
    for si in ("Hz", "V", "A", "W", "Pa", "K", "s", "m", "T", "rad")
    for unit in multiples(si)
    if len(unit) > 1 or unit in "VAWK"
) | {"deg", "degC", "°C", "mbar", "bar", "Torr", "mTorr", "rad/s", "rpm"}
"""Units that a heading cannot mean otherwise, as "f/s" or "run_m" may."""
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
    Raises: MeasurementError where the spec states another one, where only the file says that volts
    are root mean square, and where what it says is a unit of another quantity.
    """
    units = {normalize("NFKC", name): unit for name, unit in units.items()}
    columns: dict[str, Column | str | int] = dict(spec.columns)
    notes: list[str] = []
    for name in spec.columns:
        column = spec.column(name)
        place = f"{where}: columns.{name}"
        found = _one_for_all(name, spec, units, place)
        head = ", ".join(map(str, columns_of(column)))
        rms = _RMS.fullmatch(found)
        if rms and spec.rms is None:
            raise MeasurementError(
                f"{place}: {head!r} is root mean square; give rms = true, which multiplies by √2, "
                "or rms = false"
            )
        found = rms[1] if rms else found
        si = _si(name, spec)
        if not _fits(found, name, spec):
            # Of a magnitude in dB the level is asked for where it is read
            if found and column.unit is None and si and (name, found) != ("magnitude", "dB"):
                notes.append(_told(found, si, head, place))
            continue
        if column.unit is None:
            columns[name] = column.model_copy(update={"unit": found})
            notes.append(f"{place}: in {found}, as the file says")
        elif not _same(found, column.unit, si):
            raise MeasurementError(
                f"{place}: unit = {column.unit!r}, but the file says {found!r} of {head!r}; "
                "correct the one that is wrong"
            )
    return spec.model_copy(update={"columns": columns}), notes


def _one_for_all(name: str, spec: Spec, units: Mapping[str, str], place: str) -> str:
    """Return the unit that the file states of a column, or of several that are one quantity.

    Of several, what is no unit may be a number or a word that tells them apart.
    """
    column = spec.column(name)
    columns = columns_of(column)
    stated = [units.get(normalize("NFKC", str(one)), "") for one in columns]
    if len(stated) < 2:
        return stated[0] if stated else ""
    si = _si(name, spec)
    known = [unit if _means_a_unit(unit, si) or _fits(unit, name, spec) else "" for unit in stated]
    if column.unit is not None:
        wrong = (unit for unit in known if unit and not _same(unit, column.unit, si))
        return next(wrong, column.unit)
    other = next((k for k, unit in enumerate(known) if unit != known[0]), None)
    if other is not None:
        raise MeasurementError(
            f"{place}: the file says {known[0]!r} of {str(columns[0])!r} and {known[other]!r} of "
            f"{str(columns[other])!r}; save them in one unit, or give unit"
        )
    return known[0]


def _means_a_unit(text: str, si: str) -> bool:
    """Whether text is a unit of something, or one of the quantity in wrong letters."""
    plain = rms[1] if (rms := _RMS.fullmatch(text)) else text
    alike = any(unit.casefold() == plain.casefold() for unit in multiples(si))
    return alike or is_level(plain) or plain in ELSEWHERE


def _told(found: str, si: str, head: str, place: str) -> str:
    """Return what is said of text that is no unit of a quantity, and may be none at all.

    Raises: MeasurementError where it is the unit of another quantity, or one in wrong letters.
    """
    meant = [unit for unit in multiples(si) if unit.casefold() == found.casefold()]
    if _means_a_unit(found, si):
        instead = " or ".join(map(repr, meant)) or repr(si)
        raise MeasurementError(
            f"{place}: the file says {found!r} of {head!r}, which is no unit of {si}; give the "
            f"unit of its numbers, as in unit = {instead}"
        )
    return (
        f"{place}: {found!r} of {head!r} is no unit of it that is known, so that numbers are taken "
        f"in {si}; give unit where they are not"
    )


def _si(name: str, spec: Spec) -> str:
    """Return the SI unit of a quantity, "" where it has none."""
    datasets = KINDS[str(spec.kind)].datasets
    known = datasets[name].unit if name in datasets else ""
    return COMPLEX.get(name, known) or ""


def _fits(unit: str, name: str, spec: Spec) -> bool:
    """Whether text is a unit of a quantity that has one; dB alone says nothing of volts."""
    si = _si(name, spec)
    if is_level(unit):
        return si == "dB" or (name in ("magnitude", "drive") and unit != "dB")
    if si == "dB":
        return bool(unit) and is_unit_of(unit, "W")
    return bool(unit and si) and is_unit_of(unit, si)


def _same(one: str, other: str, si: str) -> bool:
    """Whether two units are one; levels in decibel may be named by their reference or not."""
    if is_level(one) and is_level(other):
        return "dB" in (one, other) or normalize("NFKC", one) == normalize("NFKC", other)
    if is_level(one) or is_level(other):
        return False
    if si == "dB":
        si = "W"  # of a power that is no level
    if not is_unit_of(other, si):
        return True  # which is refused where it is read
    first, second = (float(to_si(1.0, unit, si, "")) for unit in (one, other))
    return abs(first - second) <= 1e-9 * abs(first)
