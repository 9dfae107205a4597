"""MATLAB files, versions 5 to 7 and 7.3.

A TOML beside the file says which variable is what, as for text tables.

Version 7.3 is HDF5 behind a 512-byte user block, arrays stored column first, so with their axes
reversed; complex numbers are a compound of real and imag. Up to version 7 scipy reads the file.
Only arrays of numbers are read, those in structs and cells by their path, as `run.demods(2).x`;
objects and functions are refused by name, so nothing in a stranger's file is ever constructed.
Variables may be columns of equal length, or arrays that have the contract's shape. Source:
MathWorks, "MAT-File Versions" (mathworks.com/help/matlab/import_export/mat-file-versions.html);
scipy.io.loadmat.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, whosmat

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import LARGEST, Format, Groups, head, need_size, undamaged
from femnl.io.labfiles.matlab_fields import Steps, field_5, field_73, need_bounded, split
from femnl.io.labfiles.named_columns import named, take_columns
from femnl.io.labfiles.spec import Spec
from femnl.io.labfiles.tables import to_dataset
from femnl.io.measurement import open_hdf5
from femnl.io.measurement.head import whole

_NUMERIC = (
    "double",
    "single",
    "int8",
    "int16",
    "int32",
    "int64",
    "uint8",
    "uint16",
    "uint32",
    "uint64",
    "logical",
)
_NESTED = ("struct", "cell")
_HDF5 = b"MATLAB 7.3"


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    if len(paths) > 1:
        raise MeasurementError(
            f"{paths[1]}: one MATLAB file at a time; import each into a file of its own"
        )
    path = paths[0]
    need_size(path, "split it")
    wanted = named(spec)
    table = _read_73(path, wanted) if head(path).startswith(_HDF5) else _read_5(path, wanted)
    columns = take_columns(
        spec, {name: _column(values) for name, values in table.items()}, str(path)
    )
    dataset, notes = to_dataset(spec, columns, str(path))
    return {spec.name: dataset}, notes


def _column(values: NDArray[Any]) -> NDArray[Any]:
    """A row or column vector as a list of numbers; everything in MATLAB has two axes at least."""
    return values.reshape(-1) if sum(n > 1 for n in values.shape) <= 1 else values


def _read_5(path: Path, wanted: set[str]) -> dict[str, NDArray[Any]]:
    listed = undamaged(path, "MATLAB file", lambda: whosmat(str(path), appendmat=False))
    listing = {str(name): (shape, str(kind)) for name, shape, kind in listed}
    paths = _allowed(path, wanted, {name: kind for name, (_, kind) in listing.items()})
    names = sorted({root for root, _ in paths.values()})
    if sum(8 * float(np.prod(listing[name][0], dtype=float)) for name in names) > LARGEST:
        raise MeasurementError(
            f"{path}: variables {', '.join(names)} hold more than {LARGEST / 2**30:g} GiB; split "
            "the file"
        )
    if any(steps for _, steps in paths.values()):
        need_bounded(path, LARGEST)
    found = undamaged(
        path, "MATLAB file", lambda: loadmat(str(path), appendmat=False, variable_names=names)
    )
    if lost := [name for name in names if name not in found]:
        raise MeasurementError(
            f"{path}: variable {lost[0]} is listed but cannot be read; save it again"
        )
    return {
        name: field_5(np.asarray(found[root]), steps, f"{path}: {name}")
        for name, (root, steps) in paths.items()
    }


def _read_73(path: Path, wanted: set[str]) -> dict[str, NDArray[Any]]:
    with open_hdf5(path) as file, whole(path):
        kinds = {name: _kind(file[name]) for name in file if not name.startswith("#")}
        paths = _allowed(path, wanted, kinds)
        return {
            name: _plain(field_73(file, root, steps, f"{path}: {name}")).T
            for name, (root, steps) in paths.items()
        }


def _kind(item: h5py.Dataset | h5py.Group) -> str:
    label = item.attrs.get("MATLAB_class", b"double")
    kind = label.decode() if isinstance(label, bytes) else str(label)
    return kind if isinstance(item, h5py.Dataset) else "struct"


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    return (
        values["real"] + 1j * values["imag"] if values.dtype.names == ("real", "imag") else values
    )


def _allowed(path: Path, wanted: set[str], kinds: dict[str, str]) -> dict[str, tuple[str, Steps]]:
    """Return the wanted names whose variable is there, with it and the steps to its numbers."""
    paths = {name: split(name) for name in sorted(wanted)}
    there = {name: (root, steps) for name, (root, steps) in paths.items() if root in kinds}
    for name, (root, steps) in there.items():
        if kinds[root] not in ((*_NUMERIC, *_NESTED) if steps else _NUMERIC):
            more = (
                "name what it holds, as in run.x or run{1}"
                if kinds[root] in _NESTED
                else "save its numbers as a plain array"
            )
            raise MeasurementError(
                f"{path}: variable {name} is a {kinds[root]}, which is not read; {more}"
            )
    if wanted and not there:
        raise MeasurementError(
            f"{path}: has none of {', '.join(sorted(wanted))}; it has "
            f"{', '.join(sorted(kinds)[:12]) or 'none'}"
        )
    return there


FORMAT = Format(
    "MATLAB file",
    lambda path: path.suffix.lower() == ".mat" or head(path).startswith(b"MATLAB "),
    _read,
    priority=1,
)
