"""Sweeps stored as matrices: a row or a column is one sweep, and the file must tell which."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import xarray as xr

from femnl.core.errors import MeasurementError
from femnl.io.labfiles import Spec, import_file

F = np.linspace(990.0, 1010.0, 21)
DRIVE = np.array([0.1, 0.2, 0.4])
VOLTS = DRIVE[:, None] * 1e-3 / (1 + 1j * (F - 1000) / 2)
SQUARE = np.arange(1.0, 22.0)[:, None] * VOLTS[0]
COLUMNS = {"frequency": "f", "amplitude": "Z", "drive": "U"}


def imported(folder: Path, values: dict[str, Any] | None = None, **variables: Any) -> xr.Dataset:
    path = folder / "run.mat"
    scipy.io.savemat(path, variables)
    names = {name: column for name, column in COLUMNS.items() if column in variables}
    names |= {"time": "t"} if "t" in variables else {}
    spec = Spec(kind="response", columns=names, values=values or {})
    return import_file(path, path.with_suffix(".nc"), spec)["measurement"].to_dataset()


@pytest.mark.parametrize("turned", [False, True])
def test_a_sweep_may_be_a_row_or_a_column(tmp_path: Path, turned: bool) -> None:
    found = imported(tmp_path, f=F, Z=VOLTS.T if turned else VOLTS, U=DRIVE)
    np.testing.assert_allclose(found["real"] + 1j * found["imag"], VOLTS)
    np.testing.assert_allclose(found.frequency, np.tile(F, (3, 1)))
    np.testing.assert_allclose(found.drive, DRIVE)
    assert np.all(found.direction == 1)


@pytest.mark.parametrize("turned", [False, True])
def test_frequencies_of_a_square_matrix_tell_which_way_it_lies(
    tmp_path: Path, turned: bool
) -> None:
    f = F + 0.01 * np.arange(21.0)[:, None] ** 2
    drive = np.arange(1.0, 22.0)
    found = imported(tmp_path, f=f.T if turned else f, Z=SQUARE.T if turned else SQUARE, U=drive)
    np.testing.assert_allclose(found["real"] + 1j * found["imag"], SQUARE)
    np.testing.assert_allclose(found.frequency, f)
    np.testing.assert_allclose(found.drive, drive)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("apart", [0.01, 40.0])
def test_sweeps_may_follow_a_mode_farther_than_they_are_wide(
    tmp_path: Path, turned: bool, apart: float
) -> None:
    f = F + apart * np.arange(12.0)[:, None]
    volts = np.arange(1.0, 13.0)[:, None] * VOLTS[0]
    found = imported(
        tmp_path,
        f=f.T if turned else f,
        Z=volts.T if turned else volts,
        U=np.arange(1.0, 13.0),
    )
    np.testing.assert_allclose(found.frequency, f)
    np.testing.assert_allclose(found["real"] + 1j * found["imag"], volts)
    few = imported(tmp_path, f=f[:3].T, Z=volts[:3].T)
    np.testing.assert_allclose(few.frequency, f[:3])
    with pytest.raises(MeasurementError, match="run along its rows as well as along its columns"):
        imported(tmp_path, f=f, Z=volts)


def test_a_drive_that_is_not_known_leaves_a_sweep_whole(tmp_path: Path) -> None:
    drive = DRIVE.copy()
    drive[1] = np.nan
    found = imported(tmp_path, f=F, Z=VOLTS, U=drive)
    assert found.sizes["sweep"] == 3
    np.testing.assert_allclose(found.drive, drive)


def test_axes_of_length_one_are_idle(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["f"] = F[:, None]
        file["Z"] = VOLTS[:, :, None]
        file["U"] = DRIVE[:, None]
    path = tmp_path / "run.h5"
    spec = Spec(kind="response", columns=dict(COLUMNS))
    found = import_file(path, path.with_suffix(".nc"), spec)["measurement"].to_dataset()
    np.testing.assert_allclose(found["real"] + 1j * found["imag"], VOLTS)
    np.testing.assert_allclose(found.drive, DRIVE)


def test_a_square_matrix_that_does_not_tell_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="a row or a column is not told; save the freq"):
        imported(tmp_path, f=F, Z=SQUARE)


def test_a_drive_of_each_sweep_may_be_a_list_of_values(tmp_path: Path) -> None:
    drives: list[str | float] = ["100 mV", "200 mV", "400 mV"]
    found = imported(tmp_path, {"drive": drives}, f=F, Z=VOLTS.T)
    np.testing.assert_allclose(found.drive, DRIVE)


def test_a_time_of_each_sweep_tells_no_duration(tmp_path: Path) -> None:
    found = imported(tmp_path, f=F, Z=VOLTS.T, t=np.array([0.0, 60.0, 120.0]))
    np.testing.assert_allclose(found.time, [0.0, 60.0, 120.0])
    assert "duration" not in found


def test_a_lone_sweep_may_have_one_drive(tmp_path: Path) -> None:
    found = imported(tmp_path, f=F, Z=VOLTS[:1], U=DRIVE[:1])
    assert found.drive.values.tolist() == [0.1]


@pytest.mark.parametrize(
    ("variables", "says"),
    [
        ({"f": F[:7], "Z": VOLTS}, "columns.amplitude is 3 × 21, and there are 7 frequencies"),
        ({"f": F, "Z": VOLTS, "U": np.arange(5.0)}, "columns.drive has 5 values beside columns"),
        ({"f": F, "Z": VOLTS, "U": np.ones((2, 21))}, "columns.drive is 2 × 21 beside columns"),
        ({"Z": VOLTS}, "columns.frequency is missing"),
    ],
)
def test_sizes_that_disagree_are_refused(
    tmp_path: Path, variables: dict[str, Any], says: str
) -> None:
    with pytest.raises(MeasurementError, match=says):
        imported(tmp_path, **variables)
