"""Faulty measurement files: each is refused in one line with its remedy, or repaired and told."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from femnl.core.errors import MeasurementError
from femnl.io import measurement

Damage = Callable[[h5py.File], Any]


def _replace(key: str, values: Any, **attributes: Any) -> Damage:
    """Put other values, or other attributes, in the place of a dataset."""

    def damage(file: h5py.File) -> None:
        old = dict(file[key].attrs)
        del file[key]
        file[key] = values
        file[key].attrs.update({**old, **attributes})

    return damage


def _attribute(key: str, name: str, value: Any) -> Damage:
    return lambda file: file[key].attrs.__setitem__(name, value)


def _edit(key: str, index: Any, value: Any) -> Damage:
    return lambda file: file[key].__setitem__(index, value)


def _good(path: Path) -> None:
    """Write a small file with all kinds, from h5py alone."""
    groups: dict[str, dict[str, tuple[Any, str]]] = {
        "spectrum": {
            "frequency": ([1e6, 2e6, 3e6], "Hz"),
            "frequency_sd": ([1.0, 1.0, 1.0], "Hz"),
            "label": (["1,1", "2,1", "2,2"], ""),
        },
        "response": {
            "frequency": (np.tile(np.linspace(1e6, 1.1e6, 12), (2, 1)), "Hz"),
            "real": (np.arange(24.0).reshape(2, 12), "V"),
            "imag": (np.arange(24.0).reshape(2, 12), "V"),
            "drive": ([0.1, 0.2], "V"),
            "direction": ([1, -1], ""),
            "harmonic": ([1, 1], ""),
        },
        "map": {
            "real": (np.arange(24.0).reshape(2, 3, 4), "V"),
            "imag": (np.arange(24.0).reshape(2, 3, 4), "V"),
            "harmonic": ([1, 2], ""),
            "x": ([0, 1e-6, 2e-6, 3e-6], "m"),
            "y": ([0, 1e-6, 2e-6], "m"),
        },
        "trace": {
            "voltage": (np.arange(8.0).reshape(2, 4), "V"),
            "time": ([0, 1e-6, 2e-6, 3e-6], "s"),
            "drive_frequency": ([1e6, 2e6], "Hz"),
        },
        "series": {"pressure": ([1.0, 2.0, 3.0], "Pa"), "frequency": ([1e6, 1e6, 1e6], "Hz")},
    }
    with h5py.File(path, "w") as file:
        file.attrs["femnl_measurement"] = "1.0"
        file.attrs["geometry"] = "square-270um"
        for kind, datasets in groups.items():
            file.create_group(kind).attrs["kind"] = kind
            for key, (values, unit) in datasets.items():
                file[kind][key] = values
                if unit:
                    file[kind][key].attrs["units"] = unit


REFUSED: dict[str, tuple[Damage, str]] = {
    "other version": (
        _attribute("/", "femnl_measurement", "2.0"),
        "femnl_measurement is '2.0'; this femnl reads versions 1.0 to 1.2; update femnl",
    ),
    "no version": (
        lambda f: f.attrs.pop("femnl_measurement"),
        "no root attribute femnl_measurement",
    ),
    "unknown kind": (
        _attribute("map", "kind", "picture"),
        "map: kind is 'picture'; give the group an attribute kind, one of decay, map, ",
    ),
    "no kind": (lambda f: f["map"].attrs.pop("kind"), "map: kind is ''"),
    "missing dataset": (
        lambda f: f["response"].pop("imag"),
        "needs one of the datasets imag, magnitude",
    ),
    "no control": (
        lambda f: f["series"].pop("pressure"),
        "series: kind series needs one of the datasets pressure",
    ),
    "no drive at all": (
        lambda f: f["trace"].pop("drive_frequency"),
        "needs one of the datasets drive_frequency, drive_voltage",
    ),
    "wrong dimension": (
        _attribute("map/x", "units", "V"),
        "map/x: unit 'V' is not a unit of this quantity; give it in 'm'",
    ),
    "nonsense unit": (_attribute("map/x", "units", "flurb"), "map/x: unit 'flurb' is unknown"),
    "unit as a program": (
        _attribute("map/x", "units", "m**9**9**9**9"),
        "unit 'm**9**9**9**9' is not understood",
    ),
    "text for numbers": (_replace("map/real", np.full((2, 3, 4), b"one")), "map/real: holds"),
    "complex": (
        _replace("map/real", np.ones((2, 3, 4), complex)),
        "store complex data as real and imag",
    ),
    "wrong shape": (
        _replace("map/real", np.zeros((2, 3, 5))),
        "map/real: shape (2, 3, 5) does not fit dimensions (harmonic = 2, y = 3, x = 4)",
    ),
    "wrong count": (_replace("response/drive", [1.0, 2.0, 3.0]), "share them"),
    "one sweep short": (
        _replace("response/real", np.zeros((1, 12))),
        "response/real: shape (1, 12) does not fit",
    ),
    "empty": (_replace("spectrum/frequency", np.zeros(0)), "does not fit dimensions"),
    "drive that stands still": (
        _edit("trace/drive_frequency", 1, 0.0),
        "trace/drive_frequency: value 0 is not positive",
    ),
    "negative frequency": (
        _edit("spectrum/frequency", 1, -2e6),
        "spectrum/frequency: value -2e+06 is not positive",
    ),
    "zero sd": (
        _edit("spectrum/frequency_sd", 1, 0.0),
        "spectrum/frequency_sd: value 0 is not positive",
    ),
    "direction 0": (
        _edit("response/direction", 0, 0),
        "response/direction: value 0 is not +1 (up) or −1 (down)",
    ),
    "harmonic 1.5": (
        _replace("response/harmonic", [1.5, 1.0]),
        "response/harmonic: value 1.5 is not a whole number",
    ),
    "one place twice": (
        _edit("map/x", 1, 0.0),
        "map/x: value 0 is given twice with different data; correct or delete one",
    ),
    "nothing but NaN": (_edit("map/real", ..., np.nan), "map/real: all 24 points are NaN"),
    "no frequency left": (_edit("spectrum/frequency", ..., np.nan), "nothing is left to use"),
    "wavelength in nm": (
        _attribute("map", "wavelength", 632.8),
        "wavelength is 632.8 m; give it in m, or as a text with its unit such as '632.8 nm'",
    ),
    "wavelength in V": (
        _attribute("map", "wavelength", "632.8 V"),
        "map: attribute wavelength: unit 'V' is not a unit",
    ),
    "negative noise": (
        _attribute("map", "noise_sd", -1.0),
        "attribute noise_sd is -1; give a positive number in V",
    ),
    "list for a number": (_attribute("map", "noise_sd", [1.0, 2.0]), "is not one number"),
    "soft link": (
        lambda f: f.__setitem__("map/link", h5py.SoftLink("/trace/time")),
        "map/link: is a link",
    ),
    "external link": (
        lambda f: f.__setitem__("map/link", h5py.ExternalLink("/etc/passwd", "/")),
        "map/link: is a link",
    ),
    "loop of groups": (
        lambda f: f["map"].__setitem__("again", f["/"]),
        "is a link back to the root",
    ),
    "lists as values": (
        lambda f: f["map"].create_dataset("lists", (2,), dtype=h5py.vlen_dtype("f8")),
        "map/lists: values holds lists of varying length; store plain arrays",
    ),
    "lists as an attribute": (
        lambda f: f["map/x"].attrs.create(
            "units", np.array([np.arange(3), None], dtype=object)[:1], dtype=h5py.vlen_dtype("i8")
        ),
        "map/x: units holds lists of varying length; store plain arrays",
    ),
    "too large": (
        lambda f: f["map"].create_dataset("huge", (10**7, 10**7), dtype="f8", chunks=True),
        "declares more than 4 GiB",
    ),
}

MENDED: dict[str, tuple[Damage, str]] = {
    "kHz": (
        _replace("spectrum/frequency", [1e3, 2e3, 3e3], units="kHz"),
        "spectrum/frequency: converted from kHz to Hz",
    ),
    "µm": (_replace("map/x", [0.0, 1.0, 2.0, 3.0], units="µm"), "map/x: converted from µm to m"),
    "no units": (
        lambda f: f["map/x"].attrs.pop("units"),
        "map/x: has no units attribute, taken as m",
    ),
    "wavelength as text": (
        _attribute("map", "wavelength", "632.8 nm"),
        "attribute wavelength '632.8 nm' converted to 6.328e-07 m",
    ),
    "NaN mode": (
        _edit("spectrum/frequency", 1, np.nan),
        "modes without frequency or frequency_sd left out: 1 of 3 (rows 1)",
    ),
    "NaN axis": (
        _edit("map/x", 3, np.nan),
        "map/x: positions that are NaN left out: 1 of 4 (rows 3)",
    ),
    "NaN pixel": (
        _edit("map/real", (0, 0, 0), np.nan),
        "1 points have only one of real and imag, taken as missing",
    ),
    "infinite": (
        _edit("trace/voltage", (0, 0), np.inf),
        "trace/voltage: 1 infinite values taken as missing",
    ),
    "falling axis": (
        _edit("map/x", ..., [3e-6, 2e-6, 1e-6, 0]),
        "map/x: not in rising order (3e-06 … 0), sorted together with its data",
    ),
    "falling sweep": (
        lambda f: f["response/frequency"].__setitem__(1, f["response/frequency"][1][::-1]),
        "not in rising order in 1 of 2 sweeps",
    ),
    "point without frequency": (
        _edit("response/frequency", (0, 3), np.nan),
        "1 points have data but no frequency",
    ),
    "NaN sweep": (
        _edit("response/real", 0, np.nan),
        "sweeps without a single point left out: 1 of 2 (rows 0)",
    ),
    "no harmonic": (
        lambda f: f["response"].pop("harmonic"),
        "response/harmonic: not given, taken as 1",
    ),
    "drive as attribute": (
        lambda f: (f["response"].pop("drive"), f["response"].attrs.__setitem__("drive", 0.3)),
        "response/drive: one attribute, taken for every sweep",
    ),
    "stranger": (
        lambda f: f["map"].__setitem__("comment", 1.0),
        "map/comment: not a dataset of kind map, left out",
    ),
    "data in the root": (
        lambda f: f.__setitem__("extra", [1.0]),
        "extra: dataset outside a group, left out",
    ),
    "group in a group": (
        lambda f: f.create_group("map/deeper"),
        "map/deeper: group inside a group, left out",
    ),
    "NaN point": (
        _edit("series/frequency", 2, np.nan),
        "points without control variable or data left out: 1 of 3",
    ),
    "repeated point": (
        lambda f: [
            f[f"response/{k}"].__setitem__((0, 5), f[f"response/{k}"][0, 4])
            for k in ("frequency", "real", "imag")
        ],
        "1 exact repeats of points taken as missing",
    ),
}


def test_the_file_that_the_faults_are_put_in_is_clean(tmp_path: Path) -> None:
    _good(tmp_path / "file.nc")
    assert measurement.read(tmp_path / "file.nc").attrs["repairs"] == ()


@pytest.mark.parametrize("fault", REFUSED)
def test_a_fault_that_cannot_be_mended_is_one_line(fault: str, tmp_path: Path) -> None:
    damage, expected = REFUSED[fault]
    _good(tmp_path / "file.nc")
    with h5py.File(tmp_path / "file.nc", "a") as file:
        damage(file)
    with pytest.raises(MeasurementError) as caught:
        measurement.read(tmp_path / "file.nc")
    line = str(caught.value)
    assert expected in line
    assert str(tmp_path / "file.nc") in line
    assert "\n" not in line
    assert ";" in line, "the remedy follows a semicolon"


@pytest.mark.parametrize("fault", MENDED)
def test_a_fault_that_is_mended_is_told(fault: str, tmp_path: Path) -> None:
    damage, expected = MENDED[fault]
    _good(tmp_path / "file.nc")
    with h5py.File(tmp_path / "file.nc", "a") as file:
        damage(file)
    tree = measurement.read(tmp_path / "file.nc")
    assert any(expected in line for line in tree.attrs["repairs"]), tree.attrs["repairs"]


def test_a_sorted_map_keeps_every_value_at_its_place(tmp_path: Path) -> None:
    _good(tmp_path / "file.nc")
    before = measurement.read(tmp_path / "file.nc")
    with h5py.File(tmp_path / "file.nc", "a") as file:
        for key in ("map/x", "map/real", "map/imag"):
            file[key][...] = file[key][...][..., [2, 0, 3, 1]]
    after = measurement.read(tmp_path / "file.nc")
    assert after["map"].to_dataset().identical(before["map"].to_dataset())


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.95])
def test_a_truncated_file_is_named_so(share: float, tmp_path: Path) -> None:
    path = tmp_path / "file.nc"
    _good(path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(
        MeasurementError, match=r"file\.nc: (is empty|not a readable HDF5 file, perhaps truncated)"
    ):
        measurement.read(path)


def test_a_missing_file_and_a_foreign_one_are_named_so(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match=r"none\.nc: no such file"):
        measurement.read(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("frequency,amplitude\n1,2\n")
    with pytest.raises(MeasurementError, match=r"text\.nc: is a text file"):
        measurement.read(tmp_path / "text.nc")


def test_flipped_bytes_give_a_line_or_data_but_never_another_failure(tmp_path: Path) -> None:
    path = tmp_path / "file.nc"
    rng = np.random.default_rng(11)
    _good(path)
    whole = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    for _ in range(60):
        broken = whole.copy()
        broken[rng.integers(0, whole.size, size=8)] = rng.integers(0, 256, size=8)
        path.write_bytes(broken.tobytes())
        with contextlib.suppress(MeasurementError):
            measurement.read(path)
