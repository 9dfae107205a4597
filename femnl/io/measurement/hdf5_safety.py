"""HDF5 files from strangers.

Opened only after a look that refuses what would leave the folder or fill the memory.
"""

import math
from mmap import ACCESS_READ, mmap
from pathlib import Path

import h5py

from femnl.core.errors import MeasurementError
from femnl.core.resources import need_file

LIMIT = 2**32
SMALL = 2**26  # bytes declared that are never too many
# Of data over file: noise hardly compresses, but a page of zeros does so a thousandfold
RATIO = 100
_DEPTH = 16
HEAP = b"GCOL\x01\0\0\0"


def open_hdf5(path: Path) -> h5py.File:
    """Open an HDF5 file for reading after a look at what it declares.

    Refused are links and virtual or external storage (they reach other files), and datasets that
    would not fit in memory.
    Args: path: the file. Returns: the open h5py file, to be closed by the caller.
    Raises: MeasurementError for a missing, truncated, foreign or oversized file.
    """
    need_file(path)
    _walk_heaps(path)
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise MeasurementError(
            f"{path}: not a readable HDF5 file, perhaps truncated ({_short(error)}); copy or "
            "export it again"
        ) from None
    try:
        total = [0]
        _look(file, path, file, 0, total)
        if total[0] > max(SMALL, RATIO * path.stat().st_size):
            raise MeasurementError(
                f"{path}: declares {total[0] / 2**20:.0f} MiB of data in {path.stat().st_size} "
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

    One whose objects do not lead to its end.

    Source: HDF5 File Format Specification 3.0, III.E. Global Heap; free space is object 0, its size
    counting its head.
    """
    if path.stat().st_size == 0:  # which cannot be mapped, and is refused as foreign
        return
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        start = -1
        while (start := data.find(HEAP, start + 1)) >= 0:
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


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120]


def _look_at_types(item: h5py.Group | h5py.Dataset, where: str) -> None:
    """Refuse lists of varying length, which no measurement has.

    Where one is damaged, HDF5 ends the whole process.
    """
    kinds = {"values": item.id.get_type()} if isinstance(item, h5py.Dataset) else {}
    for index in range(h5py.h5a.get_num_attrs(item.id)):
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


def _look(group: h5py.Group, path: Path, file: h5py.File, depth: int, total: list[int]) -> None:
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
        if isinstance(item, h5py.Group):
            if depth and item == file:
                raise MeasurementError(
                    f"{where}: is a link back to the root; store the data in the file itself"
                )
            _look(item, path, file, depth + 1, total)
        elif isinstance(item, h5py.Dataset):
            _look_at_types(item, where)
            if item.is_virtual or item.external:
                raise MeasurementError(
                    f"{where}: keeps its data in another file; store the data in the file itself"
                )
            if item.shape is None:
                raise MeasurementError(f"{where}: is empty; store numbers in it, or leave it out")
            total[0] += math.prod(item.shape) * item.dtype.itemsize
            if total[0] > LIMIT:
                raise MeasurementError(
                    f"{where}: the file declares more than {LIMIT / 2**30:g} GiB of data; split "
                    "it into smaller files"
                )
