"""Scans of Nanonis controllers become maps; what cannot be read is refused in one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles import Spec, import_file

HEAD = {
    "NANONIS_VERSION": "2",
    "SCANIT_TYPE": "              FLOAT            MSBFIRST",
    "REC_TEMP": "      290.0000000000",
    "SCAN_PIXELS": "       3       2",
    "SCAN_RANGE": "           6.000E-6           4.000E-6",
    "SCAN_OFFSET": "             1.000E-6         -2.000E-6",
    "SCAN_ANGLE": "            0.000E+0",
    "SCAN_DIR": "down",
    "COMMENT": "line one\nline two",
    "DATA_INFO": "\tChannel\tName\tUnit\tDirection\tCalibration\tOffset\n"
    "\t14\tZ\tm\tforward\t9.000E-9\t0.000E+0\n"
    "\t20\tLI_Demod_1_X\tV\tboth\t1.000E+0\t0.000E+0\n"
    "\t21\tLI_Demod_1_Y\tmV\tboth\t1.000E+0\t0.000E+0\n",
}
COLUMNS = {"x": "x", "y": "y", "real": "LI_Demod_1_X", "imag": "LI_Demod_1_Y"}
IMAGE = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
"""Rows from the top."""


def scan(path: Path, images: list[NDArray[np.float64]], **tags: str) -> Path:
    """Write a scan as the page of its format says; images as they are stored."""
    text = "".join(f":{name}:\n{value}\n" for name, value in (HEAD | tags).items())
    data = b"".join(image.astype(">f4").tobytes() for image in images)
    path.write_bytes(text.encode() + b"\n:SCANIT_END:\n\n\n\x1a\x04" + data)
    return path


def spec(**columns: Any) -> Spec:
    """Return the description of a map of the second harmonic."""
    found = {"kind": "map", "columns": COLUMNS | columns, "values": {"harmonic": 2}}
    return Spec.model_validate(found)


def images() -> list[NDArray[np.float64]]:
    """Return Z, and both channels forward and back, the latter from right to left."""
    return [0 * IMAGE, IMAGE, 10 * IMAGE[:, ::-1], 2000 * IMAGE, 20_000 * IMAGE[:, ::-1]]


def test_a_scan_becomes_a_map_with_its_places_and_units(tmp_path: Path) -> None:
    path = scan(tmp_path / "a.sxm", images())
    tree = import_file(path, tmp_path / "a.nc", spec())
    found = tree["measurement"].to_dataset()
    assert found["harmonic"].values.tolist() == [2]
    np.testing.assert_allclose(found["x"].values, [-1e-6, 1e-6, 3e-6], atol=1e-20)
    np.testing.assert_allclose(found["y"].values, [-3e-6, -1e-6])
    volts = measurement.amplitude(found).values
    np.testing.assert_allclose(volts, [(1 + 2j) * IMAGE[::-1]], rtol=1e-6)
    assert not any("turned" in note for note in tree.attrs["repairs"])


def test_the_way_back_is_turned_round_and_a_scan_upwards_begins_below(tmp_path: Path) -> None:
    path = scan(tmp_path / "a.sxm", images(), SCAN_DIR="up", SCAN_ANGLE="30")
    back = {"real": "LI_Demod_1_X back", "imag": "LI_Demod_1_Y back"}
    tree = import_file(path, tmp_path / "a.nc", spec(**back))
    volts = measurement.amplitude(tree["measurement"].to_dataset()).values
    np.testing.assert_allclose(volts, [(10 + 20j) * IMAGE], rtol=1e-6)
    assert any("turned by 30 deg" in note for note in tree.attrs["repairs"])


@pytest.mark.parametrize(
    ("tags", "told"),
    [
        ({"SCANIT_TYPE": "FLOAT LSBFIRST"}, "only FLOAT MSBFIRST is read"),
        ({"SCAN_PIXELS": "3 3"}, "120 bytes of data where 5 images of 3 × 3 pixels need 180"),
        ({"SCAN_PIXELS": "2.5 2"}, "no counts of pixels"),
        ({"SCAN_RANGE": "wide"}, "SCAN_RANGE = 'wide': needs 2 finite numbers"),
        ({"SCAN_DIR": "left"}, "SCAN_DIR = 'left': must be up or down"),
        ({"DATA_INFO": "14 Z m both"}, "DATA_INFO does not begin with the columns"),
        (
            {"DATA_INFO": HEAD["DATA_INFO"].replace("both", "sideways")},
            "is no channel with a direction",
        ),
    ],
)
def test_a_scan_that_cannot_be_read_is_refused_in_one_line(
    tags: dict[str, str], told: str, tmp_path: Path
) -> None:
    path = scan(tmp_path / "a.sxm", images(), **tags)
    with pytest.raises(MeasurementError, match=told) as caught:
        import_file(path, tmp_path / "a.nc", spec())
    assert "\n" not in str(caught.value)


def test_a_head_without_an_end_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.sxm").write_bytes(b":NANONIS_VERSION:\n2\n")
    with pytest.raises(MeasurementError, match="has no :SCANIT_END:"):
        import_file(tmp_path / "a.sxm", tmp_path / "a.nc", spec())


def test_a_height_is_no_voltage(tmp_path: Path) -> None:
    path = scan(tmp_path / "a.sxm", images())
    with pytest.raises(MeasurementError, match="unit 'm' is not a unit of this quantity"):
        import_file(path, tmp_path / "a.nc", spec(real="Z"))


def test_a_channel_that_is_not_there_is_named_with_those_that_are(tmp_path: Path) -> None:
    path = scan(tmp_path / "a.sxm", images())
    with pytest.raises(MeasurementError, match="the file has x, y, Z, LI_Demod_1_X"):
        import_file(path, tmp_path / "a.nc", spec(real="LI_Demod_2_X"))
