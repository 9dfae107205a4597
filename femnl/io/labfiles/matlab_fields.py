"""Fields of MATLAB structs and elements of cells by their path, as in `run.demods(2).x`."""

import re
import zlib
from collections.abc import Iterator
from contextlib import suppress
from os import SEEK_CUR
from pathlib import Path
from typing import Any, BinaryIO, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError

Steps = list[str | int]
"""Names of fields, and places of elements, from 1 in column order."""
_PATH = re.compile(r"([A-Za-z]\w*)((?:\.[A-Za-z]\w*|\(\d{1,9}\)|\{\d{1,9}\})*)", re.ASCII)
_STEP = re.compile(r"\.([A-Za-z]\w*)|[({](\d+)[)}]", re.ASCII)
_COMPRESSED = 15
_HEADER = 128
_PIECE = 2**20


def split(name: str) -> tuple[str, Steps]:
    """Return the variable that a name begins with, and the steps from there to the numbers."""
    path = _PATH.fullmatch(name)
    if path is None:
        return name, []
    root, steps = path.groups()
    return root, [field or int(place) for field, place in _STEP.findall(steps)]


def field_5(value: NDArray[Any], steps: Steps, where: str) -> NDArray[Any]:
    """Follow steps through what scipy reads of a file up to version 7.

    Raises: MeasurementError for a step that leads nowhere, and for an end that is no array of
    numbers.
    """
    for step in steps:
        if isinstance(step, str):
            fields = value.dtype.names or ()
            if step not in fields:
                raise MeasurementError(_no_field(where, step, list(fields)))
            if value.size != 1:
                raise MeasurementError(_several(where, value.size))
            value = np.asarray(value[step].reshape(-1)[0])
        else:
            elements = value.reshape(-1, order="F")
            if not 1 <= step <= elements.size:
                raise MeasurementError(f"{where}: there is no element {step} of {elements.size}")
            value = elements[step - 1 : step]
            value = np.asarray(value[0]) if value.dtype == object else value
    if value.dtype.kind not in "biufc":
        raise MeasurementError(_no_numbers(where, list(value.dtype.names or ()), value.size))
    return value


def field_73(file: h5py.File, root: str, steps: Steps, where: str) -> NDArray[Any]:
    """Follow steps through the groups and references of a file of version 7.3, as `field_5`."""
    item = file[root]
    place: int | None = None
    for step in steps:
        if isinstance(step, str):
            if not isinstance(item, h5py.Group) or step not in item:
                raise MeasurementError(_no_field(where, step, _fields(item)))
            item = item[step]
            item = item if place is None else _element(file, item, place, where)
            place = None
        elif isinstance(item, h5py.Group):  # a struct array holds its elements field by field
            place = step
        else:
            item = _element(file, item, step, where)
    numbers = isinstance(item, h5py.Dataset) and (
        item.dtype.kind in "biuf" or item.dtype.names == ("real", "imag")
    )
    if not numbers or place is not None:
        size = item.size if isinstance(item, h5py.Dataset) else 1
        raise MeasurementError(_no_numbers(where, _fields(item), size))
    return np.asarray(item[()])


def need_bounded(path: Path, most: float) -> None:
    """Refuse a file up to version 7 whose variables unpack to more bytes than `most`.

    What is no such file is left to the reader, which refuses it.
    """
    total = 0
    with path.open("rb") as file, suppress(zlib.error):
        for size in _unpacked(file):
            total += size
            if total > most:
                raise MeasurementError(
                    f"{path}: its variables unpack to more than {most / 2**30:g} GiB; save fewer "
                    "of them"
                )


def _unpacked(file: BinaryIO) -> Iterator[int]:
    """Yield the bytes that each piece of the outermost elements unpacks to.

    Deeper ones are not compressed.
    """
    start = file.read(_HEADER)
    order: Literal["big", "little"] = "big" if start[126:128] == b"MI" else "little"
    while len(tag := file.read(8)) == 8:
        kind = int.from_bytes(tag[:4], order)
        left = int.from_bytes(tag[4:], order)
        if kind != _COMPRESSED:
            file.seek(left, SEEK_CUR)
            continue
        unpack = zlib.decompressobj()
        while left > 0 and (piece := file.read(min(left, _PIECE))):
            left -= len(piece)
            while piece:
                yield len(unpack.decompress(piece, _PIECE))
                piece = unpack.unconsumed_tail


def _element(file: h5py.File, item: Any, place: int, where: str) -> Any:
    """Return the element of a cell or struct array that a dataset of references leads to."""
    if not isinstance(item, h5py.Dataset) or h5py.check_ref_dtype(item.dtype) is None:
        if place == 1:  # a struct of one element holds its fields as they are
            return item
        raise MeasurementError(f"{where}: there is no element {place} of 1")
    references = item[()].T.reshape(-1, order="F")
    if not 1 <= place <= references.size:
        raise MeasurementError(f"{where}: there is no element {place} of {references.size}")
    return file[references[place - 1]]


def _fields(item: Any) -> list[str]:
    return list(item) if isinstance(item, h5py.Group) else []


def _no_field(where: str, field: str, fields: list[str]) -> str:
    if not fields:
        return f"{where}: what should hold {field} is no struct; leave .{field} out"
    return f"{where}: no field {field}; it has {', '.join(fields[:12])}"


def _several(where: str, count: int) -> str:
    return f"{where}: a struct array of {count} elements; name one of them, as in run(1).x"


def _no_numbers(where: str, fields: list[str], count: int) -> str:
    if fields:
        return f"{where}: is a struct; name one of its fields: {', '.join(fields[:12])}"
    return (
        f"{where}: is no array of numbers; name an element of a cell of {count}, as in run{{1}}, "
        "or save its numbers as a plain array"
    )
