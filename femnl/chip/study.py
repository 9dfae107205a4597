"""Study files of a chip: its devices, where they are, what they are, and what was measured."""

import re
from collections import defaultdict
from pathlib import Path

import numpy as np

from femnl.chip.members import Chip, Member
from femnl.chip.readings import Readings, finite, measurable, read_table
from femnl.chip.schema import Device, Positions, parse
from femnl.core.errors import ParameterError, one_line
from femnl.io.measurement.units import quantity

FEWEST = 4
"""Devices below which there is no chip to speak of."""
DESIGN_GAP = 0.02
"""Gap of the logarithm of frequency between two designs, where a file states no designs: films of
one chip differ by less from edge to edge, designs mostly by more."""
FARTHEST = {"m": 1.0, "steps": 1e4}
"""Places beyond these, by their unit, are taken for a mistake: wafers are smaller."""
MOST = 2000
"""More devices than this are taken for a mistake; memory grows with their number."""


def read_chip(path: Path) -> Chip:
    """Read a study file and everything that it names.

    Raises: ParameterError, MeasurementError: one line that names file, key, value and remedy.
    """
    study = parse(path)
    if study.table is None and not study.device:
        raise ParameterError(f"{path}: has no devices; add [table] or [[device]] tables")
    notes: list[str] = []
    found: dict[str, Readings] = defaultdict(Readings)
    if study.table is not None:
        read_table(path.parent / study.table.file, study.table, found)
    names = [device.name for device in study.device]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ParameterError(
            one_line(f"{path}: two [[device]] tables have the name {repeated[0]!r}; rename one")
        )
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
    _need_places_on_a_wafer(path, members, unit)
    members = _with_designs(path, members, notes)
    geometries = {name: _beside(path, d.geometry) for name, d in study.design.items()}
    missing = sorted(set(geometries) - {m.design for m in members})
    if missing:
        raise ParameterError(f"{path}: design.{missing[0]}: no device is of this design")
    return Chip(study.name, tuple(members), geometries, tuple(notes), unit)


def _need_places_on_a_wafer(path: Path, members: list[Member], unit: str) -> None:
    farthest = FARTHEST[unit]
    for member in members:
        if any(abs(step) > farthest for step in member.place):
            raise ParameterError(
                one_line(
                    f"{path}: device {member.name[:40]}: position: "
                    f"{max(member.place, key=abs):g} {unit} is farther out than {farthest:g} "
                    f"{unit}; check its unit"
                )
            )


def _beside(path: Path, geometry: str) -> str:
    beside = path.parent / geometry
    return str(beside) if beside.is_file() else geometry


def _read_device(path: Path, device: Device, readings: Readings) -> None:
    where = f"{path}: device {device.name}"
    readings.design = device.design or readings.design
    if device.position is not None:
        x, y = (quantity(value, "m", f"{where}: position")[0] for value in device.position)
        readings.place = (x, y)
    for mode in device.modes:
        frequency = quantity(mode.frequency, "Hz", f"{where}: frequency")[0]
        sd = quantity(mode.frequency_sd, "Hz", f"{where}: frequency_sd")[0]
        if not frequency > 0:
            raise ParameterError(f"{where}: frequency: {frequency:g} Hz is not above zero")
        if sd < 0:
            raise ParameterError(f"{where}: frequency_sd: {sd:g} Hz is below zero")
        measurable(frequency, f"{where}: frequency")
        measurable(sd, f"{where}: frequency_sd")
        readings.frequency[mode.mode].append((frequency, sd))
        if mode.quality_factor is not None:
            if not mode.quality_factor > 0:
                raise ParameterError(f"{where}: quality_factor: it is not above zero")
            if mode.quality_factor_sd < 0:
                raise ParameterError(f"{where}: quality_factor_sd: it is below zero")
            measurable(mode.quality_factor, f"{where}: quality_factor")
            measurable(mode.quality_factor_sd, f"{where}: quality_factor_sd")
            readings.quality[mode.mode].append((mode.quality_factor, mode.quality_factor_sd))
    if device.measurement is not None:
        _read_measurement(path.parent / device.measurement, readings)
    if not readings.frequency:
        raise ParameterError(f"{where}: has no frequency; give modes or a measurement")


def _read_measurement(path: Path, readings: Readings) -> None:
    """Take frequencies and quality factors of the measurements of a file."""
    from femnl.chip.measured import measured  # which loads fits, that tables of numbers do not need

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


def _place(path: Path, positions: Positions, measured: dict[str, Readings]) -> str:
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
        # A group that is optional can be missing from a match
        x, y = (finite(match[axis] or "", where, axis) for axis in "xy")
        readings.place = (pitch * x, pitch * y)
    return "steps" if steps else "m"


def _with_designs(path: Path, members: list[Member], notes: list[str]) -> list[Member]:
    """Return the devices with designs; where none is stated, those of like frequency are alike."""
    stated = [m for m in members if m.design]
    if len(stated) == len(members):
        return members
    if stated:
        lacking = next(m.name for m in members if not m.design)
        raise ParameterError(
            one_line(f"{path}: device {lacking}: has no design; give one for every device, or none")
        )
    ordered = sorted(members, key=lambda m: min(n.value for n in m.frequency.values()))
    found: list[Member] = []
    number, last = 1, None
    for m in ordered:
        lowest = min(n.value for n in m.frequency.values())
        if last is not None and np.log(lowest / last) > DESIGN_GAP:
            number += 1
        last = lowest
        found.append(Member(m.name, str(number), m.place, m.frequency, m.quality))
    notes.append(
        f"designs: none is stated; {number} groups of frequencies, more than "
        f"{DESIGN_GAP:.0%} apart, are taken for designs"
    )
    return found
