"""HDF5 files from strangers.

Opened only after a look that refuses what would leave the folder or fill the memory.
"""

import math
import os
import re
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
HEAP = re.compile(re.escape(b"GCOL\x01\0\0\0"))
"""The head of a collection of texts."""
TEXT = re.compile(
    # Four bytes first, which are found fast, and a look back
    rb"\x10\0\0\0(?<=[\x19\x29\x39\x49][\x01\x11\x21][\0\x01]\0\x10\0\0\0)"
    rb"[\x10\x20\x30\x40][\0\x08]\0\0\x01\0{3}\0\0\x08\0(?:\0{4})?"
    rb"(?:\x01\0[\0\x01]\0{5}|\x02\0[\0\x01]\0)"
)
"""What precedes the reference to the text of an attribute: a type, bytes of varying number, and no
axes.

Source: HDF5 File Format Specification 3.0, IV.A.2.b and d.
"""
LONGEST = 64
"""Bytes that are more than a pattern matches or looks back at."""
REFERENCE = 16
"""Bytes that stand for a text: its length, the collection that holds it, its place there."""
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
        _look_at_texts(path)
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


def _look_at_texts(path: Path) -> None:
    """Refuse texts over which HDF5 would walk in circles, or fill the memory.

    A collection of them must have objects that lead to its end, and none is longer than the file.

    Source: HDF5 File Format Specification 3.0, III.E. Global Heap; free space is object 0, its size
    counting its head.
    """
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        for start, _ in places(file.fileno(), HEAP):
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
        for _, end in places(file.fileno(), TEXT):
            _refuse_long(str(path), data[end : end + REFERENCE], len(data))


def _refuse_long(where: str, references: bytes, size: int) -> None:
    """Refuse texts longer than their file of some size, by the references to them.

    HDF5 makes room for such a text, and writes on that, before it finds that there is none: seconds
    and gigabytes for a file of some kB.
    """
    for at in range(0, len(references), REFERENCE):
        length = int.from_bytes(references[at : at + 4], "little")
        if length > size:
            raise MeasurementError(
                f"{where}: damaged (a text of {length} bytes in a file of {size}); copy or export "
                "it again"
            )


def _look_at_list(item: h5py.Dataset, path: Path, where: str) -> None:
    """Refuse a list of texts that HDF5 would fill the memory over.

    Its references stand side by side, unless it is written in chunks.
    """
    kind = h5py.check_string_dtype(item.dtype)
    begin = item.id.get_offset()
    if kind is None or kind.length is not None or begin is None:
        return
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(begin)
        _refuse_long(where, file.read(min(item.id.get_storage_size(), size)), size)


def places(descriptor: int, pattern: re.Pattern[bytes]) -> Iterator[tuple[int, int]]:
    """Yield where each match of a pattern in an open file begins and ends.

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
            first = max(begin - LONGEST, 0)
            block = os.pread(descriptor, BLOCK + 2 * LONGEST, first)
            for match in pattern.finditer(block):
                if begin <= first + match.start() < begin + BLOCK:
                    yield first + match.start(), first + match.end()


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
            _look_at_list(item, path, where)
            found.size += math.prod(item.shape) * item.dtype.itemsize
            if found.size > LIMIT:
                raise MeasurementError(
                    f"{where}: the file declares more than {LIMIT / 2**30:g} GiB of data; split "
                    "it into smaller files"
                )
