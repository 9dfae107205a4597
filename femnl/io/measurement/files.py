"""Measurement files on disk: read with every repair noted, written whole or not at all."""

import os
from collections.abc import Mapping
from pathlib import Path

import xarray as xr

from femnl.core.errors import MeasurementError
from femnl.core.scratch import scratch
from femnl.io.measurement.check import check
from femnl.io.measurement.contract import VERSION
from femnl.io.measurement.head import ROOT, names_controls, need_version, text, whole


def read(path: str | Path) -> xr.DataTree:
    """Read a measurement file of version 1.x.

    Args: path of the NetCDF-4/HDF5 file.
    Returns: a DataTree with one group a measurement, in SI units with the contract's dimensions and
    coordinates; its attribute `repairs` is a tuple of lines, one for each thing that had to be
    changed, empty for a clean file.
    Raises: MeasurementError with file, group, dataset, value and remedy.
    Source: docs/reference/measurement-format.md.
    """
    path = Path(path)
    version = need_version(path)
    # By a stream of our own: a file that xarray stumbles over would stay open otherwise.
    with whole(path), path.open("rb") as stream:
        # Times are plain seconds here: decoding them would make timedeltas, and phony names stand
        # in where dimension scales are absent.
        groups = xr.open_groups(
            stream, engine="h5netcdf", phony_dims="sort", decode_times=False, decode_coords=False
        )
        groups = {name: group.load() for name, group in groups.items()}
        for group in groups.values():
            group.close()
    return _collect(groups, str(path), free=names_controls(version))


def bundle(
    groups: Mapping[str, xr.Dataset], geometry: str | None = None, **attributes: str
) -> xr.DataTree:
    """Put measurements together as they would be in one file, checked as on reading.

    Args: groups: name → Dataset from a builder; geometry: name of a geometry or path relative to
    the file;
    attributes: title, source, sample, model.
    Returns: DataTree with the attribute `repairs`. Raises: MeasurementError.
    """
    root = {
        key: value
        for key, value in {"geometry": geometry, **attributes}.items()
        if value is not None
    }
    return _collect(
        {"/": xr.Dataset(attrs=root), **{f"/{name}": group for name, group in groups.items()}},
        "measurement",
    )


def _collect(groups: Mapping[str, xr.Dataset], where: str, *, free: bool = True) -> xr.DataTree:
    root = groups["/"]
    notes = []
    clean = {}
    for name, group in groups.items():
        if name == "/":
            notes += [
                f"{where}/{stray}: dataset outside a group, left out" for stray in root.variables
            ]
        elif name.count("/") > 1:
            notes.append(f"{where}{name}: group inside a group, left out")
        else:
            clean[name], found = check(group, f"{where}: {name.strip('/')}", free=free)
            notes += found
    if not clean:
        raise MeasurementError(
            f"{where}: holds no measurement; store each in a group with an attribute kind"
        )
    attributes = {str(key): text(value) for key, value in root.attrs.items()}
    attributes[ROOT] = VERSION
    return xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs={**attributes, "repairs": tuple(notes)}), **clean}
    )


def write(tree: xr.DataTree, path: str | Path) -> None:
    """Write a measurement file, whole or not at all.

    A temporary file beside it is renamed when complete.

    Repairs that reading made go to the attribute `history`.
    Args: tree: as from `read` or `bundle`; path: the file to make or replace.
    Raises: MeasurementError if the tree is not a measurement or the disk refuses it.
    """
    path = Path(path)
    groups = {
        "/": xr.Dataset(attrs=dict(tree.attrs)),
        **{f"/{name}": node.to_dataset(inherit=False) for name, node in tree.children.items()},
    }
    earlier = groups["/"].attrs.pop("repairs", ())
    clean = _collect(groups, str(path))
    lines = [*filter(None, [clean.attrs.get("history", "")]), *earlier, *clean.attrs.pop("repairs")]
    if lines:
        clean.attrs["history"] = text("\n".join(lines))
    try:
        # Made in memory: HDF5 that meets a full disk fails a second time when it closes its file,
        # and says so on standard error.
        content = clean.to_netcdf(engine="h5netcdf")
        with scratch(path.parent) as folder:
            part = folder / "part.nc"
            with part.open("wb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(part, path)
    except OSError as error:
        raise MeasurementError(
            f"{path}: cannot be written ({error.strerror or error}); choose a folder that exists "
            "and has room"
        ) from None
