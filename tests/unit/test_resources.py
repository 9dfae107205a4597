"""Files and folders that must be there."""

from pathlib import Path

import pytest

from femnl.core.errors import MeasurementError
from femnl.core.resources import need_file


def test_a_folder_in_the_place_of_a_file_is_told_from_nothing(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="is a folder; name a file in it"):
        need_file(tmp_path)
    with pytest.raises(MeasurementError, match="no such file; check the path"):
        need_file(tmp_path / "absent.nc")
