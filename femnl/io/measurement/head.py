"""What a measurement file says of itself, read before its arrays and without their libraries."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from femnl.core.errors import MeasurementError
from femnl.io.measurement.contract import VERSION
from femnl.io.measurement.hdf5_safety import open_hdf5

ROOT = "femnl_measurement"
"""Attribute of a measurement file that holds the version of its contract."""
FREE_CONTROLS = 2
"""Minor version from which on a file may name control variables of its own."""


def text(value: object) -> str:
    """Read an attribute as text, stored as a string, as bytes or as an array of one."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    # HDF5 hands over bytes of no encoding as half signs, which cannot be written again
    return str(value).encode("utf-8", "surrogatepass").decode("utf-8", "replace")


def need_version(path: Path) -> str:
    """Return the version of a measurement file, one that femnl reads.

    Raises: MeasurementError for another version, and for what is no measurement file.
    """
    with open_hdf5(path) as file, whole(path):
        version = text(file.attrs.get(ROOT, ""))
    if not version:
        raise MeasurementError(
            f"{path}: no root attribute {ROOT}, so not a measurement file; convert it with "
            "femnl import"
        )
    if version.split(".")[0] != VERSION.split(".")[0]:
        raise MeasurementError(
            f"{path}: {ROOT} is {version!r}; this femnl reads versions {VERSION.split('.')[0]}.0 "
            f"to {VERSION}; update femnl, or write one of them"
        )
    return version


def names_controls(version: str) -> bool:
    """Whether files of a version may name control variables of their own: from 1.2 on."""
    minor = "".join(version.split(".")[1:2])[:4]
    return minor.isdecimal() and int(minor) >= FREE_CONTROLS


def is_measurement(path: Path) -> bool:
    """Whether a file is a measurement file, or a damaged one that may be: `read` says which."""
    if not h5py.is_hdf5(path):
        return False
    try:
        with open_hdf5(path) as file, whole(path):
            return ROOT in file.attrs
    except MeasurementError:
        return True


def named_geometry(path: Path) -> str | None:
    """Return the geometry that a measurement file names. Raises: MeasurementError."""
    with open_hdf5(path) as file, whole(path):
        return text(file.attrs["geometry"]) if "geometry" in file.attrs else None


@contextmanager
def whole(path: Path) -> Iterator[None]:
    """Name the file where a library stumbles over damage in it."""
    try:
        yield
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        RuntimeError,
        AttributeError,
        IndexError,
        OverflowError,
        SystemError,
    ) as error:
        raise MeasurementError(
            f"{path}: damaged ({' '.join(str(error).split())[:120]}); copy or export it again"
        ) from None
