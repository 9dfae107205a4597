"""HDF5 and NetCDF-4 files whose arrays have names: of QCoDeS, xarray, Labber, or of one's own.

Every numeric dataset is a column, by its path: `signal`, `run1/frequency`. The TOML says which is
which. In a log of Labber, whose numbers stand in Data/Data (points, channels, entries), the columns
are the channels, by name, with " (Real)" and " (Imaginary)" behind the parts of a complex one.
Source: the datasets of QCoDeS are exported by xarray (qcodes.github.io, "Exporting data"); the
groups of a log of Labber are those of its files, version 1.8.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import Format, Groups, head
from femnl.io.labfiles.columns import one_table
from femnl.io.labfiles.spec import Spec
from femnl.io.measurement import open_hdf5
from femnl.io.measurement.head import whole

SIGNATURE = b"\x89HDF\r\n\x1a\n"
LOG = "Data/Data"
CHANNELS = "Data/Channel names"
TOLD = 12
"""Datasets that a message lists."""

Table = dict[str, NDArray[Any]]


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    if spec.kind is None:
        names = ", ".join(list(_table(paths[0]))[:TOLD]) or "no array of numbers"
        raise MeasurementError(
            f"{paths[0]}: needs a TOML beside it that says what its arrays are; start with kind "
            f"and [columns]; it holds {names}"
        )
    return one_table(paths, spec, "HDF5 file", _table, _units(paths[0]))


def _units(path: Path) -> dict[str, str]:
    """Return what the attribute `units` or `unit` says of arrays, by their path."""
    found: dict[str, str] = {}

    def collect(name: str, item: h5py.Group | h5py.Dataset) -> None:
        for key in ("unit", "units"):
            if key in item.attrs and isinstance(item, h5py.Dataset):
                found[name] = _text(item.attrs[key])

    with open_hdf5(path) as file, whole(path):
        file.visititems(collect)
    return found


def _table(path: Path) -> Table:
    """Return the arrays of numbers by their path, scalars left out."""
    found: Table = {}

    def collect(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset) and item.shape and item.dtype.kind in "iufc":
            found[name] = np.asarray(item[()])

    with open_hdf5(path) as file, whole(path):
        file.visititems(collect)
        if LOG in found and CHANNELS in file:
            found |= _channels(path, found.pop(LOG), file[CHANNELS][()])
    return found


def _channels(path: Path, values: NDArray[Any], names: NDArray[Any]) -> Table:
    """Return the channels of a log, entry after entry.

    Args: values (points, channels, entries). names: (name, part) of each channel.
    """
    if values.ndim != 3 or len(names) != values.shape[1]:
        raise MeasurementError(
            f"{path}: {LOG} of shape {values.shape} does not have one column for each of the "
            f"{len(names)} channels of {CHANNELS}; export the log again"
        )
    found = {}
    for k, row in enumerate(names):
        name, *part = (_text(cell) for cell in row)
        label = f"{name} ({part[0]})" if part and part[0] else name
        found[label] = values[:, k, :].T.reshape(-1)
    return found


def _text(cell: object) -> str:
    return cell.decode("utf-8", "replace") if isinstance(cell, bytes) else str(cell)


FORMAT = Format(
    "HDF5 file",
    lambda path: head(path, 8) == SIGNATURE and path.suffix.lower() != ".mat",
    _read,
    priority=-1,
)
