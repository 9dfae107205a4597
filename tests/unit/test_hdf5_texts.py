"""Texts and holes of measurement files in which HDF5 would get lost, or fill the memory."""

import os
import re
import resource
import time
from pathlib import Path

import h5py
import pytest

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.measurement.hdf5_safety import BLOCK, HEAP, REFERENCE, TEXT, places

HEAD = b"GCOL\1\0\0\0"
CLAIM = bytes.fromhex("19010100 10000000 10000000 01000000 00000800 00000000 01000000 00000000")
"""What precedes the reference to a text, as h5py writes it."""


def written(path: Path) -> Path:
    """Return a spectrum of three modes, whose labels are texts."""
    data = measurement.spectrum([1e6, 2e6, 3e6], [1.0, 1.0, 1.0], label=["1,1", "2,1", "2,2"])
    measurement.write(measurement.bundle({"modes": data}), path)
    return path


def test_a_heap_of_texts_in_which_hdf5_walks_in_circles_is_refused(tmp_path: Path) -> None:
    """HDF5 2.0 never returns from free space of size 0."""
    path = written(tmp_path / "file.nc")
    whole = bytearray(path.read_bytes())
    at = whole.index(b"GCOL\1\0\0\0") + 16
    whole[at : at + 16] = bytes(16)
    path.write_bytes(whole)
    with pytest.raises(
        MeasurementError,
        match=rf"file\.nc: damaged \(a text at byte {at} has no size\); copy or export it again",
    ):
        measurement.read(path)


@pytest.mark.parametrize("place", ["units", "modes/label"])
def test_a_text_that_claims_gigabytes_is_refused_before_room_is_made_for_it(
    place: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "file.nc")
    whole = bytearray(path.read_bytes())
    if place == "units":
        (match, *_) = TEXT.finditer(whole)
        at = match.end()
    else:
        with h5py.File(path) as file:
            at = file[place].id.get_offset() + REFERENCE
    whole[at : at + 4] = (2**32 - 2**24).to_bytes(4, "little")
    path.write_bytes(whole)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    line = rf"damaged \(a text of 4278190080 bytes in a file of {len(whole)}\); copy or export"
    with pytest.raises(MeasurementError, match=line):
        measurement.read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**18  # KiB


@pytest.mark.parametrize(("pattern", "found", "begin"), [(HEAP, HEAD, 0), (TEXT, CLAIM, 4)])
@pytest.mark.parametrize("before", [0, BLOCK - 40, BLOCK - 8, BLOCK - 4, BLOCK - 3, BLOCK])
def test_texts_are_found_across_what_is_read_at_a_time(
    pattern: re.Pattern[bytes], found: bytes, begin: int, before: int, tmp_path: Path
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"\1" * before + found + b"\1" * 99)
    with path.open("rb") as file:
        assert list(places(file.fileno(), pattern)) == [(before + begin, before + len(found))]


def test_a_file_that_was_never_written_takes_neither_time_nor_memory(tmp_path: Path) -> None:
    path = tmp_path / "file.nc"
    with path.open("wb") as file:
        file.write(b"\x89HDF\r\n\x1a\n")
        file.truncate(2**32)
    with path.open("rb") as file:
        allocated = os.fstat(file.fileno()).st_blocks * 512
    if allocated > 2**24:
        pytest.skip("the disk keeps what was never written")
    began = time.process_time()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(MeasurementError, match="not a readable HDF5 file"):
        measurement.read(path)
    assert time.process_time() - began < 1
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**18  # KiB
