"""What cannot be done gets one line on standard error with the remedy, status 2, and no output."""

import os
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest

from femnl.cli._main import run
from femnl.io import measurement

CASES = tomllib.loads(Path(__file__).with_name("refusals.toml").read_text(encoding="utf-8"))["case"]
TEXTS = {
    "empty.toml": "",
    "broken.toml": "name = \n",
    "vast.toml": "# " + 17 * 2**20 * " ",
    "deep.toml": ".".join("a" * 5000) + " = 1",
    "unitless.toml": 'name = "x"\n[outline]\nkind = "square"\nside = 270\n',
    "crowded.toml": 'name = "x"\n[outline]\nkind = "square"\nside = "270 um"\n[holes]\nlattice '
    '= "square"\npitch = '
    '"1 um"\n'
    'count = [100000, 100000]\nradius = "0.1 um"\n[film]\nthickness = "100 nm"\nyoung = "250 '
    'GPa"\npoisson = 0.23\n'
    'density = "3100 kg/m^3"\nstress = "1 GPa"\n',
    "words.csv": "a,b\nx,y\n",
    "empty.csv": "",
    "column.csv": "f,X,Y\n1e6,1,2\n1.1e6,1,2\n",
    "column.toml": 'kind = "response"\n[columns]\nfrequency = "f"\nreal = "Q"\nimag = "Y"\n',
    "kind.csv": "f,X\n1,2\n",
    "kind.toml": 'kind = "nothing"\n',
    "key.csv": "f,X\n1,2\n",
    "key.toml": 'kind = "response"\nfoo = 1\n',
    "vast_1f.gsf": "Gwyddion Simple Field 1.0\nXRes = 1000000000\nYRes = 1000000000\n\0\0\0\0"
    + "0" * 8,
    "cut_1f.gsf": "Gwyddion Simple Field 1.0\nXRes = 10\n",
    "cut.mat": "MATLAB 5.0 MAT-file",
}
DEVICES: dict[str, dict[str, str]] = {
    "map": {},
    "above": {"geometry": "../secret.toml"},
    "absolute": {"geometry": "/etc/secret.toml"},
    "elsewhere": {"geometry": "/etc/passwd"},
    "rubbish": {"model": "rubbish"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with every file that the cases name."""
    folder = tmp_path_factory.mktemp("bad")
    for name, text in TEXTS.items():
        (folder / name).write_text(text)
    (folder / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    (folder / "folder.nc").mkdir()
    for name in ("pipe.toml", "pipe.nc"):
        os.mkfifo(folder / name)
    axis = np.linspace(-1e-4, 1e-4, 11)
    rng = np.random.default_rng(0)
    for name, attributes in DEVICES.items():
        data = measurement.harmonic_map(
            axis, axis, [1, 2], rng.normal(size=(2, 11, 11)) + 0j, wavelength=632.8e-9
        )
        measurement.write(measurement.bundle({"map": data}, **attributes), folder / f"{name}.nc")
    frequency = np.linspace(1e6, 1.001e6, 50)
    for name, volts in {
        "response": 1 / (frequency - 1.0005e6 + 50j),
        "flat": np.ones(50) + 0j,
    }.items():
        data = measurement.response(
            frequency[None], volts[None], drive=[1.0], direction=[1], noise_sd=1e-3
        )
        measurement.write(measurement.bundle({"sweep": data}), folder / f"{name}.nc")
    with h5py.File(folder / "plain.nc", "w") as file:
        file["x"] = [1.0]
    with h5py.File(folder / "hollow.nc", "w") as file:
        file.attrs["femnl_measurement"] = "1.0"
        file.create_group("map").attrs["kind"] = "map"
        file["map"].create_dataset(
            "real", (1, 20000, 20000), dtype="f8", chunks=(1, 2000, 2000), compression="gzip"
        )
    return folder


def test_there_are_many_cases_and_none_twice() -> None:
    assert len(CASES) >= 60
    assert len({tuple(case["words"]) for case in CASES}) == len(CASES)


@pytest.mark.parametrize("case", CASES, ids=lambda case: " ".join(case["words"]))
def test_a_request_that_cannot_be_met_is_one_line(
    case: dict[str, str],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder.parent / "cache"))
    before = sorted(path.name for path in folder.iterdir())
    assert run(list(case["words"])) == 2
    out, err = capsys.readouterr()
    assert err.count("\n") == 1
    if "says" in case:
        assert err == f"femnl: {case['says']}\n"
    else:
        assert err.startswith(f"femnl: {case['starts']}")
    if case["words"][0] != "show":
        assert out == ""
    assert sorted(path.name for path in folder.iterdir()) == before
