"""Numbers in MATLAB's structs and cells, up to version 7 and in version 7.3."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import xarray as xr
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles import Spec, import_file
from femnl.io.labfiles.matlab_fields import need_bounded

F = np.linspace(990.0, 1010.0, 21)
V = 1e-3 / (1 + 1j * (F - 1000) / 2)
PLACES = {
    "a struct in a struct": ("run.sweep.f", "run.sweep.V"),
    "an element of a struct array": ("devices(2).f", "devices(2).V"),
    "elements of a cell": ("cells{1}", "cells{2}"),
}


def written(path: Path, version: str) -> None:
    if version == "7":
        devices = np.empty((1, 2), dtype=[("f", object), ("V", object)])
        devices[0, 0] = (F + 1, 2 * V)
        devices[0, 1] = (F, V)
        cells = np.empty((1, 2), dtype=object)
        cells[0, 0] = F
        cells[0, 1] = V
        run = {"sweep": {"f": F, "V": V}, "note": "text"}
        content = {"run": run, "devices": devices, "cells": cells}
        scipy.io.savemat(path, content, do_compression=True)
        return
    with h5py.File(path, "w", userblock_size=512) as file:
        kept = {"f": F, "V": V, "f0": F + 1, "V0": 2 * V}
        for name, values in kept.items():
            file[f"#refs#/{name}"] = stored(values)
        file["run/sweep/f"] = stored(F)
        file["run/sweep/V"] = stored(V)

        def references(*names: str) -> NDArray[Any]:
            found = np.array([[file[f"#refs#/{name}"].ref] for name in names], dtype=object)
            return found.astype(h5py.ref_dtype)

        file["devices/f"] = references("f0", "f")
        file["devices/V"] = references("V0", "V")
        file["cells"] = references("f", "V")
        file["cells"].attrs["MATLAB_class"] = np.bytes_("cell")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def stored(values: NDArray[Any]) -> NDArray[Any]:
    if not np.iscomplexobj(values):
        return values[:, None]
    pair = np.zeros((values.size, 1), dtype=[("real", "f8"), ("imag", "f8")])
    pair["real"] = values.real[:, None]
    pair["imag"] = values.imag[:, None]
    return pair


def imported(path: Path, frequency: str, amplitude: str) -> xr.Dataset:
    columns = {"frequency": frequency, "amplitude": amplitude}
    spec = Spec(kind="response", columns=columns, values={"mode": "1,1"})
    return import_file(path, path.with_suffix(".nc"), spec)["measurement"].to_dataset()


@pytest.mark.parametrize("version", ["7", "7.3"])
@pytest.mark.parametrize("place", PLACES)
def test_numbers_are_found_by_their_path(place: str, version: str, tmp_path: Path) -> None:
    written(tmp_path / "run.mat", version)
    found = imported(tmp_path / "run.mat", *PLACES[place])
    np.testing.assert_allclose(measurement.amplitude(found).values[0], V, rtol=1e-14)
    np.testing.assert_allclose(found["frequency"].values[0], F)


@pytest.mark.parametrize("version", ["7", "7.3"])
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run", "variable run is a struct, which is not read; name what it holds"),
        ("run.sweep", "is a struct; name one of its fields: "),
        ("run.sweep.g", "no field g; it has "),
        ("run.sweep.f.x", "what should hold x is no struct"),
        ("devices.f", "devices.f: (a struct array of 2 elements|is no array of numbers)"),
        ("devices(3).f", "there is no element 3 of 2"),
        ("cells{0}", "there is no element 0 of 2"),
    ],
)
def test_paths_that_lead_to_no_numbers_are_refused(
    name: str, message: str, version: str, tmp_path: Path
) -> None:
    written(tmp_path / "run.mat", version)
    with pytest.raises(MeasurementError, match=message):
        imported(tmp_path / "run.mat", name, PLACES["elements of a cell"][1])


def test_a_struct_that_unpacks_to_too_much_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mat"
    scipy.io.savemat(path, {"run": {"f": np.zeros(2_000_000)}}, do_compression=True)
    assert path.stat().st_size < 100_000
    need_bounded(path, 2**25)
    with pytest.raises(MeasurementError, match=r"unpack to more than 0\.00390625 GiB"):
        need_bounded(path, 2**22)
