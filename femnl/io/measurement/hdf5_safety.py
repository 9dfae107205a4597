"""HDF5 files from strangers.

Opened only after a look that refuses what would leave the folder or fill the memory.
"""

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from mmap import ACCESS_READ, mmap
from pathlib import Path

import h5py

from femnl.core.errors import MeasurementError
from femnl.core.resources import need_file, need_no_text

LIMIT = 2**32
SMALL = 2**26  # bytes declared that are never too many
# Of data over file: noise hardly compresses, but a page of zeros does so a thousandfold
RATIO = 100
_DEPTH = 16
MOST = 10_000
"""Groups and datasets of a file, and attributes of one of them."""
HEAP = b"GCOL\x01\0\0\0"
BLOCK = 2**24
"""Bytes that are read at a time."""


def open_hdf5(path: Path) -> h5py.File:
    """Open an HDF5 file for reading after a look at what it declares.

    Refused are links and virtual or external storage (they reach other files), and datasets that
    would not fit in memory.
    Args: path: the file. Returns: the open h5py file, to be closed by the caller.
    Raises: MeasurementError for a missing, truncated, foreign or oversized file.
    """
    if not h5py.is_hdf5(need_file(path)):
        need_no_text(path)
    if path.stat().st_size > LIMIT:
        raise MeasurementError(
            f"{path}: {path.stat().st_size / 2**30:.0f} GiB, more than {LIMIT / 2**30:g}; split it"
        )
    if h5py.is_hdf5(path):
        _walk_heaps(path)
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise MeasurementError(
            f"{path}: not a readable HDF5 file, perhaps truncated ({_short(error)}); copy or "
            "export it again"
        ) from None
    try:
        found = _Found()
        _look(file, path, file, 0, found)
        if found.size > max(SMALL, RATIO * path.stat().st_size):
            raise MeasurementError(
                f"{path}: declares {found.size / 2**20:.0f} MiB of data in {path.stat().st_size} "
                "bytes, which no measurement does; export it again without the empty parts"
            )
    except (RuntimeError, OSError, KeyError, ValueError, TypeError, OverflowError) as error:
        file.close()
        raise MeasurementError(
            f"{path}: damaged HDF5 structure ({_short(error)}); copy or export it again"
        ) from None
    except MeasurementError:
        file.close()
        raise
    return file


def _walk_heaps(path: Path) -> None:
    """Refuse a collection of texts in which HDF5 would walk in circles.

    Such a collection has objects that do not lead to its end.

    Source: HDF5 File Format Specification 3.0, III.E. Global Heap; free space is object 0, its size
    counting its head.
    """
    if path.stat().st_size == 0:  # which cannot be mapped, and is refused as foreign
        return
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        for start in collections(file.fileno()):
            at = start + 16
            end = start + int.from_bytes(data[start + 8 : start + 16], "little")
            while at + 16 <= min(end, len(data)):
                size = int.from_bytes(data[at + 8 : at + 16], "little")
                step = size if data[at : at + 2] == b"\0\0" else 16 + size + -size % 8
                if step < 16:
                    raise MeasurementError(
                        f"{path}: damaged (a text at byte {at} has no size); copy or export "
                        "it again"
                    )
                at += step


def collections(descriptor: int) -> Iterator[int]:
    """Yield where collections of texts begin in an open file.

    Parts that were never written are passed over: a file may declare more of them than a disk
    holds. What is read is not mapped, as it would count as memory of the process.
    """
    end = 0
    while True:
        try:
            at = os.lseek(descriptor, end, os.SEEK_DATA)
        except OSError:  # nothing but such parts follows
            return
        end = os.lseek(descriptor, at, os.SEEK_HOLE)
        for begin in range(at, end, BLOCK):
            block = os.pread(descriptor, BLOCK + len(HEAP) - 1, begin)
            start = -1
            while (start := block.find(HEAP, start + 1)) >= 0:
                yield begin + start


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120]


def _look_at_types(item: h5py.Group | h5py.Dataset, where: str) -> None:
    """Refuse lists of varying length, which no measurement has.

    Where one is damaged, HDF5 ends the whole process.
    """
    kinds = {"values": item.id.get_type()} if isinstance(item, h5py.Dataset) else {}
    count = h5py.h5a.get_num_attrs(item.id)
    if count > MOST:
        raise MeasurementError(f"{where}: has {count} attributes, more than {MOST}; leave some out")
    for index in range(count):
        attribute = h5py.h5a.open(item.id, index=index)
        kinds[attribute.name.decode("utf-8", "replace")] = attribute.get_type()
    for name, kind in kinds.items():
        # Dimension scales have these
        if (
            isinstance(kind, h5py.h5t.TypeVlenID)
            and kind.get_super().get_class() != h5py.h5t.REFERENCE
        ):
            raise MeasurementError(
                f"{where}: {name} holds lists of varying length; store plain arrays of numbers, "
                "and texts"
            )


@dataclass
class _Found:
    """What a file declares, so far: bytes of data, and the places of its groups and datasets."""

    size: int = 0
    places: set[int] = field(default_factory=set)


def _refuse_again(place: int, found: _Found, where: str) -> None:
    """Refuse a second way to one group or dataset, and more of them than a file has.

    A few links make as many ways through a file as a tree of that depth has leaves.
    """
    if place in found.places:
        raise MeasurementError(f"{where}: is a second link to one object; store it once")
    found.places.add(place)
    if len(found.places) > MOST:
        raise MeasurementError(
            f"{where}: the file has more than {MOST} groups and datasets; split it"
        )


def _look(group: h5py.Group, path: Path, file: h5py.File, depth: int, found: _Found) -> None:
    _look_at_types(group, f"{path}: {group.name}")
    if depth > _DEPTH:
        raise MeasurementError(
            f"{path}: groups nested deeper than {_DEPTH}; a measurement file has one level"
        )
    for name in group:
        where = f"{path}: {group.name.rstrip('/')}/{name}"
        link = group.get(name, getlink=True)
        if not isinstance(link, h5py.HardLink):
            raise MeasurementError(
                f"{where}: is a link, which femnl does not follow; store the data in the "
                "file itself"
            )
        item = group[name]
        place = hash(item)  # of file and address
        if isinstance(item, h5py.Group):
            if depth and item == file:
                raise MeasurementError(
                    f"{where}: is a link back to the root; store the data in the file itself"
                )
            _refuse_again(place, found, where)
            _look(item, path, file, depth + 1, found)
        elif isinstance(item, h5py.Dataset):
            _refuse_again(place, found, where)
            _look_at_types(item, where)
            if item.is_virtual or item.external:
                raise MeasurementError(
                    f"{where}: keeps its data in another file; store the data in the file itself"
                )
            if item.shape is None:
                raise MeasurementError(f"{where}: is empty; store numbers in it, or leave it out")
            found.size += math.prod(item.shape) * item.dtype.itemsize
            if found.size > LIMIT:
                raise MeasurementError(
                    f"{where}: the file declares more than {LIMIT / 2**30:g} GiB of data; split "
                    "it into smaller files"
                )
