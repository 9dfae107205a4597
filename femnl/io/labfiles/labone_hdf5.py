"""Measurements saved by Zurich Instruments LabOne as HDF5.

A file holds one group for each chunk, named by a number of three digits or more, and in it the
instrument's tree of nodes:

    /000/dev1234/demods/0/sample/{timestamp, frequency or grid, x, y, r, phase, …}     sweeper, and
    continuous recording /000/dev1234/demods/0/sample.x.avg/{timestamp, value}
    data acquisition (one signal a node)

Sweeps become a `response`, one group for each demodulator, one sweep for each chunk. Signals of the
data acquisition become a `trace`, one step for each chunk; their time stamps count the instrument's
clock, whose rate the TOML gives, e.g. clockbase = "60 MHz" (MFLI; 210 MHz HF2LI, 1.8 GHz UHFLI),
with signal = "sample.x.avg" where there are several. Demodulator outputs are root mean square;
amplitudes of sweeps are √2 times as large unless the TOML says rms = false. Source: LabOne User
Manual, "Saving and Loading Data"; LabOne Programming Manual, "Sweeper Module" and "Data Acquisition
Module" (docs.zhinst.com/labone_programming_manual).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles.base import Format, Groups, Sweep, head, scalar_values, sweeps_to_response
from femnl.io.labfiles.hdf5 import SIGNATURE
from femnl.io.labfiles.labone_csv import sweep_of
from femnl.io.labfiles.spec import Spec
from femnl.io.measurement import open_hdf5, quantity
from femnl.io.measurement.head import whole

if TYPE_CHECKING:
    import xarray as xr

Fields = dict[str, NDArray[np.float64]]


def _nodes(file: h5py.File) -> Iterator[tuple[str, str, h5py.Group]]:
    """Chunk, node path and group of every demodulator record, in the order of the chunks."""
    for chunk in sorted((name for name in file if name.isascii() and name.isdigit()), key=int):
        found: list[tuple[str, h5py.Group]] = []

        def collect(
            name: str, item: h5py.Group | h5py.Dataset, found: list[tuple[str, h5py.Group]] = found
        ) -> None:
            if isinstance(item, h5py.Group) and name.rsplit("/", 1)[-1].split(".")[0] == "sample":
                found.append((name, item))

        file[chunk].visititems(collect)
        yield from ((chunk, name, group) for name, group in found)


def _fields(group: h5py.Group) -> Fields:
    found = {
        name: item
        for name, item in group.items()
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf"
    }
    return {name: np.asarray(item[()], dtype=float).reshape(-1) for name, item in found.items()}


def _records(path: Path) -> list[tuple[str, str, Fields]]:
    """Return the chunk, node path and arrays of every demodulator record of a file."""
    with open_hdf5(path) as file, whole(path):
        return [(chunk, name, _fields(group)) for chunk, name, group in _nodes(file)]


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    sweeps: dict[str, list[Sweep]] = {}
    signals: dict[str, list[Fields]] = {}
    for path in paths:
        for chunk, name, fields in _records(path):
            if "value" in fields:
                signals.setdefault(name, []).append(fields)
            elif "grid" in fields or "frequency" in fields:
                sweeps.setdefault(name, []).append(
                    sweep_of(fields, spec, f"{path}: /{chunk}/{name}")
                )
    where = str(paths[0])
    groups: Groups = {}
    notes: list[str] = []
    devices = {name.partition("/")[0] for name in sweeps}
    for name, found in sweeps.items():
        demodulator = name.rpartition("/")[0].rpartition("/")[2]
        device = f"-{name.partition('/')[0]}" if len(devices) > 1 else ""
        key = spec.name if len(sweeps) == 1 else f"{spec.name}{device}-demod{demodulator}"
        groups[key], lines = sweeps_to_response(found, {}, spec, f"{where}: /{name}")
        notes += lines
    if sweeps and spec.rms is not False:
        notes.append(f"{where}: amplitudes are √2 times the root mean square that LabOne stores")
    if signals and not sweeps:
        groups[spec.name], lines = _signal(signals, spec, where)
        notes += lines
    elif signals:
        notes.append(
            f"{where}: {len(signals)} signals of the data acquisition beside sweeps, left out"
        )
    if not groups:
        raise MeasurementError(
            f"{where}: no demodulator record in it (/000/dev…/demods/…/sample); save the "
            "sweeper's or the acquisition's data"
        )
    return groups, notes


def _signal(
    signals: dict[str, list[Fields]], spec: Spec, where: str
) -> tuple[xr.Dataset, list[str]]:
    """Return one recorded signal as a trace.

    Its time is counted from the first sample of each chunk.
    """
    names = sorted(signals)
    chosen = [name for name in names if spec.signal is None or name.endswith(spec.signal)]
    if len(chosen) != 1:
        ends = ", ".join(name.rsplit("/", 1)[-1] for name in names[:12])
        raise MeasurementError(
            f"{where}: {len(chosen)} of {len(names)} signals match; choose one in the TOML: "
            'signal = "…" (there '
            f"are {ends})"
        )
    if spec.clockbase is None:
        raise MeasurementError(
            f"{where}: time stamps count a clock of unknown rate; give it in the TOML, e.g. "
            'clockbase = "60 MHz"'
        )
    rate, _ = quantity(spec.clockbase, "Hz", f"{where}: clockbase")
    chunks = signals[chosen[0]]
    length = min(fields["value"].size for fields in chunks)
    if length == 0:
        raise MeasurementError(f"{where}: {chosen[0]} has a chunk without a value; record it again")
    cut = sum(fields["value"].size > length for fields in chunks)
    notes = (
        [f"{where}: {cut} of {len(chunks)} chunks cut to the {length} samples of the shortest"]
        if cut
        else []
    )
    if "timestamp" not in chunks[0] or chunks[0]["timestamp"].size < length:
        raise MeasurementError(
            f"{where}: {chosen[0]} has no timestamp for each value; save the acquisition with "
            "its time stamps"
        )
    ticks = chunks[0]["timestamp"][:length]
    known = {"noise_sd": "V", "wavelength": "m", "x": "m", "y": "m", "drive_frequency": "Hz"}
    scalars = scalar_values(spec, known, where)
    steps = np.full(len(chunks), scalars.pop("drive_frequency", np.nan))
    volts = np.stack([fields["value"][:length] for fields in chunks])
    return measurement.trace(
        (ticks - ticks[0]) / rate, volts, drive_frequency=steps, **scalars
    ), notes


def _recognise(path: Path) -> bool:
    """Whether an HDF5 file has groups named by a number, which hold the chunks."""
    if head(path, 8) != SIGNATURE or path.suffix.lower() == ".mat":
        return False
    try:
        with open_hdf5(path) as file:
            return any(name.isdigit() for name in file)
    except MeasurementError:
        # Damaged: the reader of all HDF5 files says how
        return False


FORMAT = Format("LabOne HDF5", _recognise, _read)
