"""Files and folders that must be there."""

import re
from pathlib import Path

import h5py
import pytest

from femnl.core.errors import MeasurementError
from femnl.core.resources import need_file, need_no_text


def test_a_folder_in_the_place_of_a_file_is_told_from_nothing(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="is a folder; name a file in it"):
        need_file(tmp_path)
    with pytest.raises(MeasurementError, match="no such file; check the path"):
        need_file(tmp_path / "absent.nc")


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("s.toml", b"[outline]", "s.toml: is a TOML file, such as a geometry or a study; name a "),
        ("t.nc", "σ,Hz\n1,2\n".encode(), "t.nc: is a text file, and no measurement file"),
        ("l.nc", "µm\r\n\t1".encode("latin-1"), "l.nc: is a text file"),
        ("e.nc", b"", "e.nc: is empty; copy or export it again"),
    ],
)
def test_a_text_in_the_place_of_numbers_is_told(
    name: str, content: bytes, told: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MeasurementError, match=re.escape(told)):
        need_no_text(tmp_path / name)


@pytest.mark.parametrize("before", [0, 512, 8192])
def test_an_hdf5_file_is_no_text_even_behind_one(before: int, tmp_path: Path) -> None:
    path = tmp_path / "f.nc"
    with h5py.File(path, "w", userblock_size=before) as file:
        file["x"] = [1.0]
    with path.open("r+b") as stream:
        stream.write(b"a" * before)
    assert h5py.is_hdf5(path)
    assert need_no_text(path) == path
