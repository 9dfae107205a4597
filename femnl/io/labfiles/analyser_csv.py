"""Traces of spectrum analysers: exports of Keysight, Rohde & Schwarz, and Siglent.

Keysight's X series, Rohde & Schwarz's FSV and FSW, Siglent's SSA, which Teledyne sells as T3SA.

Keysight (.csv): lines "key,value", a line DATA, then x and y.

    Trace
    Swept SA
    Center Frequency,1.5266179E+06
    RBW,30
    X Axis Units,s
    Y Axis Units,dBm
    DATA
    0,-62.1

Rohde & Schwarz (.dat, .csv): lines "key;value;unit", for each trace a line "Trace 1;;" with its
units behind it and "Values;1001;", then x and y; a comma may be the decimal mark.

    Type;FSW-26;
    Center Freq;1526617.9;Hz
    Span;0;Hz
    RBW;30;Hz
    Trace 1;;
    x-Unit;s;
    y-Unit;dBm;
    Values;1001;
    0;-62,1;

Siglent (.csv): lines "key,value", a line "Trace Data", then frequency and level; further traces
follow below or beside the first.

    Machine Module,T3SA3200
    Y Axis Unit,dBm
    Trace Name,Trace A
    Trace Data
    1500000.000000,-68.25,,,

A trace over time, in zero span, is a `decay`, tuned to the centre frequency behind the resolution
bandwidth; one over frequency is a `response` of magnitudes alone. The first trace is read, and of
detectors that store two values a point the higher one, which is the last column. Volts over
frequency are root mean square, so that amplitudes are √2 times as large unless the TOML says rms =
false.
Source: Keysight, "Spectrum Analyzer Mode User's & Programmer's Reference", Trace File Contents;
Rohde & Schwarz, "FSW User Manual", 1173.9411.02, ASCII File Export Format. Siglent
does not publish its form: it is that of exports in public repositories (T3SA3200, SSA3021X), none
of which is in zero span.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles.base import RMS, Format, Groups, head, sweeps_to_response, text_lines
from femnl.io.labfiles.levels import is_level, magnitudes
from femnl.io.labfiles.spec import Spec
from femnl.io.measurement import quantity, to_si

if TYPE_CHECKING:
    import xarray as xr

LOWEST = 9e3
"""Lowest frequency [Hz] of Siglent's analysers; what ends below may be a time."""
KEYS = {
    "center frequency": "frequency",
    "center freq": "frequency",
    "rbw": "bandwidth",
    "res bw": "bandwidth",
    "x axis units": "x",
    "x-unit": "x",
    "y axis units": "y",
    "y-unit": "y",
    "y axis unit": "y",
    "date": "date",
}
"""What is read of the head, by its key in small letters."""
HEAD_BYTES = 4096
LEAST = 3
"""Points without which there is nothing to import."""


@dataclass(frozen=True)
class Form:
    """How an analyser writes: the mark between cells, and the key of the line before the points.

    level: which of the numbers in a line is the level. x: unit of the axis that it never states.
    """

    mark: str
    before: str
    level: int
    x: str | None = None


KEYSIGHT = Form(",", "DATA", -1)
ROHDE = Form(";", "Values", -1)
SIGLENT = Form(",", "Trace Data", 1, "Hz")


@dataclass(frozen=True)
class Trace:
    """One trace: its head, and its points (n, 2) in the units of the head."""

    head: dict[str, str]
    points: NDArray[np.float64]


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    groups: Groups = {}
    notes: list[str] = []
    for path in paths:
        name = spec.name if len(paths) == 1 else path.stem
        found, told = _measurement(path, _trace(path), spec)
        groups[name] = found
        notes += told
    return groups, notes


def _measurement(path: Path, trace: Trace, spec: Spec) -> tuple[xr.Dataset, list[str]]:
    over = trace.head.get("x", "")
    if over.lower() == "s":
        return _decay(path, trace), []
    if over.lower() == "hz":
        return _response(path, trace, spec)
    raise MeasurementError(
        f"{path}: its x axis is in {over[:20]!r}; a trace over Hz or s can be imported"
    )


def _decay(path: Path, trace: Trace) -> xr.Dataset:
    """Return a trace in zero span as a decay."""
    time, level = trace.points.T
    attributes: dict[str, float | str | None] = {}
    for name in ("frequency", "bandwidth"):
        if name in trace.head:
            given = trace.head[name]
            text = given if " " in given else f"{given} Hz"
            number = quantity(text, "Hz", f"{path}: {name}")[0]
            attributes[name] = number if number > 0 else None
    if "date" in trace.head:
        attributes["date"] = trace.head["date"]
    unit = trace.head.get("y", "dBm")
    if unit.startswith("dB"):
        return measurement.decay(time=time, power=level, attributes=attributes)
    volts = to_si(level, unit, "V", f"{path}: y axis")
    return measurement.decay(time=time, magnitude=volts, attributes=attributes)


def _response(path: Path, trace: Trace, spec: Spec) -> tuple[xr.Dataset, list[str]]:
    """Return a trace over frequency as a response without phases."""
    frequency, level = trace.points.T
    unit = trace.head.get("y", "dBm")
    if unit.startswith("dB") and not is_level(unit):
        raise MeasurementError(
            f"{path}: its y axis is in {unit[:20]!r}; export it in dBm, dBV, dBmV, dBµV or V"
        )
    volts = magnitudes(level, unit, "trace", f"{path}: y axis")
    told = []
    if not is_level(unit) and spec.rms is not False:
        volts = RMS * volts
        told.append(f"{path}: amplitudes are √2 times the root mean square that analysers show")
    sweep = (frequency, volts.astype(np.complex128))
    dataset, notes = sweeps_to_response([sweep], {}, spec, str(path))
    alone = dataset.drop_vars("imag").rename({"real": "magnitude"})
    return alone, [*notes, *told, f"{path}: magnitudes alone; the phase is not known"]


def _trace(path: Path) -> Trace:
    """Return the first trace of a file. Raises: MeasurementError naming the line that is wrong."""
    lines = text_lines(path)
    form = _form([line.strip().lower() for line in lines]) or KEYSIGHT
    entries: dict[str, str] = {} if form.x is None else {"x": form.x}
    for at, line in enumerate(lines):
        key, *cells = (cell.strip() for cell in line.split(form.mark))
        if key == form.before:
            count = int(cells[0]) if cells and cells[0].isdigit() else None
            points = _points(path, lines[at + 1 :], at + 2, form, count)
            if form is SIGLENT and points[:, 0].max() < LOWEST:
                raise MeasurementError(
                    f"{path}: its x axis ends at {points[:, 0].max():g}, below every frequency of "
                    "the analyser; if that is a time in s, import the table with a TOML"
                )
            return Trace(entries, points)
        known = KEYS.get(key.lower())
        if known and cells and cells[0]:
            if form is ROHDE:
                cells[0] = cells[0].replace(",", ".")
            # A number with its unit, where it has one of its own
            entries.setdefault(known, " ".join(cells[:2]).strip())
    raise MeasurementError(f"{path}: no line {form.before} before the points; export it again")


def _points(
    path: Path, lines: Sequence[str], first: int, form: Form, count: int | None
) -> NDArray[np.float64]:
    """Return x and the level of each line, (n, 2), up to one that is empty or of the next trace."""
    rows = []
    for number, line in enumerate(lines[:count], start=first):
        cells = [cell.strip() for cell in line.split(form.mark) if cell.strip()]
        if not cells or cells[0] == "Trace Name":
            break
        texts = [cell.replace(",", ".") for cell in cells] if form is ROHDE else cells
        try:
            numbers = [float(text) for text in texts]
        except ValueError:
            raise MeasurementError(
                f"{path}: line {number}: {line.strip()[:30]!r} is no pair of numbers; correct it"
            ) from None
        if len(numbers) < 2:
            raise MeasurementError(f"{path}: line {number}: one number, not two; correct it")
        rows.append((numbers[0], numbers[form.level]))
    if len(rows) < LEAST or (count is not None and len(rows) < count):
        said = "" if count is None else f" of {count}"
        raise MeasurementError(
            f"{path}: line {first}: only {len(rows)}{said} points follow; export it again"
        )
    return np.array(rows)


def _form(lines: Sequence[str]) -> Form | None:
    """Return who wrote a file, by its first lines in small letters, None where none of them."""
    if lines and lines[0].startswith("type;"):
        return ROHDE
    if len(lines) > 1 and lines[0].rstrip(",") == "trace" and "sa" in lines[1].split():
        return KEYSIGHT
    keys = {line.split(",")[0] for line in lines}
    return SIGLENT if {"y axis unit", "trace data"} <= keys else None


def _recognise(path: Path) -> bool:
    start = head(path, HEAD_BYTES).decode("utf-8-sig", "replace")
    return _form([line.strip().lower() for line in start.splitlines()]) is not None


FORMAT = Format("analyser trace", _recognise, _read, priority=2)
