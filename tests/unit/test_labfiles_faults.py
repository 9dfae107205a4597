"""Faulty lab files, and files of strangers.

One clear line, and nothing is run, followed or filled up.
"""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from femnl.core.errors import MeasurementError
from femnl.io.labfiles import Spec, import_file, read_spec

Make = Callable[[Path], Spec | None]
RESPONSE = Spec(kind="response", columns={"frequency": "f", "real": "x", "imag": "y"})
SWEEPER = "chunk;timestamp;size;fieldname\n"


def _csv(text: str, spec: Spec | None = RESPONSE) -> Make:
    def make(path: Path) -> Spec | None:
        path.write_text(text, encoding="utf-8")
        return spec

    return make


def _bytes(data: bytes, spec: Spec | None = RESPONSE) -> Make:
    def make(path: Path) -> Spec | None:
        path.write_bytes(data)
        return spec

    return make


def _gsf(header: str, data: bytes = b"\0" * 16) -> Make:
    text = b"Gwyddion Simple Field 1.0\n" + header.encode()
    return _bytes(text + b"\0" * (4 - len(text) % 4) + data, None)


def _mat(variables: dict[str, object]) -> Make:
    def make(path: Path) -> Spec:
        scipy.io.savemat(path, variables)
        return Spec(kind="trace", columns={"voltage": "u", "time": "t"})

    return make


def _hdf5(build: Callable[[h5py.File], object], spec: Spec | None = None) -> Make:
    def make(path: Path) -> Spec | None:
        with h5py.File(path, "w") as file:
            build(file)
        return spec

    return make


def _sample(file: h5py.File, **fields: object) -> None:
    for name, values in fields.items():
        file[f"000/dev1/demods/0/sample/{name}"] = values


def _daq(file: h5py.File) -> None:
    file["000/dev1/demods/0/sample.x/value"] = [1.0, 2.0]
    file["000/dev1/demods/0/sample.x/timestamp"] = [1, 2]


def _daq_without_values(file: h5py.File) -> None:
    file["000/dev1/demods/0/sample.x/value"] = np.empty(0)
    file["000/dev1/demods/0/sample.x/timestamp"] = np.empty(0)


def _without_names(path: Path) -> None:
    """Write no array, and damage where HDF5 would keep its name."""
    h5py.File(path, "w").close()
    content = path.read_bytes()
    assert content.count(b"HEAP") == 1
    path.write_bytes(content.replace(b"HEAP", b"HEAR"))


CASES: dict[str, tuple[str, Make, str]] = {
    "no spec": (
        "a.csv",
        _csv("f,x,y\n1,2,3\n", None),
        "needs a TOML beside it that says what its columns are",
    ),
    "empty": ("a.csv", _csv(""), "holds no table"),
    "missing column": (
        "a.csv",
        _csv("f,x\n1,2\n"),
        "columns.imag: no column 'y'; the file has f, x",
    ),
    "word in a column": (
        "a.csv",
        _csv("f,x,y\n1,2,3\n2,oops,3\n"),
        "columns.real (x): row 2: 'oops' is not a number",
    ),
    "ragged": ("a.csv", _csv("f,x,y\n1,2,3\n1,2,3,4\n"), "not a table"),
    "same heading twice": (
        "a.csv",
        _csv("f,x,y,\n1,2,3,4\n", Spec(kind="response", columns={"frequency": "q"})),
        "no column 'q'",
    ),
    "not text": ("a.csv", _bytes(b"\xff\xfe\x00f\x00,"), "not UTF-8 text; export it as UTF-8"),
    "wrong unit": (
        "a.csv",
        _csv(
            "f,x,y\n1,2,3\n",
            Spec.model_validate(
                {"kind": "response", "columns": {"frequency": {"column": "f", "unit": "V"}}}
            ),
        ),
        "columns.frequency (f): unit 'V' is not a unit of this quantity; give it in 'Hz'",
    ),
    "unknown quantity": (
        "a.csv",
        _csv("f\n1\n", Spec(kind="response", columns={"colour": "f"})),
        "columns.colour: not a quantity of kind response",
    ),
    "no phase": (
        "a.csv",
        _csv("x,R\n1,2\n", Spec(kind="map", columns={"x": "x", "magnitude": "R"})),
        "columns.phase is missing",
    ),
    "no amplitude": (
        "a.csv",
        _csv("f\n1\n2\n", Spec(kind="response", columns={"frequency": "f"})),
        "columns.real is missing",
    ),
    "drives do not fit": (
        "a.csv",
        _csv(
            "f,x,y\n1,2,3\n2,3,4\n", RESPONSE.model_copy(update={"values": {"drive": [0.1, 0.2]}})
        ),
        "values.drive has 2 entries for 1 sweeps",
    ),
    "no grid": (
        "a.csv",
        _csv(
            "a,b,c,d\n" + "".join(f"{k + 0.01 * k * k},{k * 1.1},1,2\n" for k in range(40)),
            Spec(kind="map", columns={"x": "a", "y": "b", "real": "c", "imag": "d"}),
        ),
        'do not make a grid; give columns.x and columns.y a step such as round = "1 um"',
    ),
    "place twice": (
        "a.csv",
        _csv(
            "a,b,c,d\n0,0,1,2\n0,1,1,2\n0,0,1,2\n",
            Spec(kind="map", columns={"x": "a", "y": "b", "real": "c", "imag": "d"}),
        ),
        "row 3 repeats the place x = 0, y = 0",
    ),
    "uneven steps": (
        "a.csv",
        _csv(
            "t,u,f\n0,1,1\n1,1,1\n0,1,2\n",
            Spec(kind="trace", columns={"time": "t", "voltage": "u", "drive_frequency": "f"}),
        ),
        "steps of the drive have 1 to 2 samples",
    ),
    "sweeper line short": ("a.csv", _csv(SWEEPER + "0;1\n", None), "line 2 has 2 cells"),
    "sweeper size": (
        "a.csv",
        _csv(SWEEPER + "0;1;many;x;1\n", None),
        "size 'many' is not a number",
    ),
    "sweeper cut off": (
        "a.csv",
        _csv(SWEEPER + "0;1;3;x;1;2\n", None),
        "announces 3 values of x and has 2",
    ),
    "sweeper without x": (
        "a.csv",
        _csv(SWEEPER + "0;1;2;grid;1;2\n", None),
        "has neither x and y nor r and phase",
    ),
    "sweeper of an amplitude": (
        "a.csv",
        _csv(SWEEPER + "0;1;2;frequency;1;1\n0;1;2;x;1;2\n0;1;2;y;1;2\n", None),
        "the frequency stands still",
    ),
    "sweeper empty": ("a.csv", _csv(SWEEPER, None), "holds no finished sweep"),
    "gsf without size": ("m_1f.gsf", _gsf("XRes = 2\n"), "header field YRes is missing"),
    "gsf cut off": (
        "m_1f.gsf",
        _gsf("XRes = 2\nYRes = 2\n", b"\0" * 12),
        "12 bytes of data where 2 × 2 pixels need 16",
    ),
    "gsf endless": (
        "m_1f.gsf",
        _gsf("XRes = 1e9\nYRes = 1e9\n"),
        "pixels need 4000000000000000000",
    ),
    "gsf of half a pixel": ("m_1f.gsf", _gsf("XRes = 1.5\nYRes = 2\n"), "are not counts of pixels"),
    "gsf in kg": (
        "m_1f.gsf",
        _gsf("XRes = 2\nYRes = 2\nZUnits = kg\n"),
        "ZUnits: unit 'kg' is not a unit of this quantity",
    ),
    "gsf without a number": ("drum.gsf", _gsf("XRes = 2\nYRes = 2\n"), "harmonic unknown"),
    "gsf phase alone": (
        "m_1f_phase.gsf",
        _gsf("XRes = 2\nYRes = 2\nZUnits = rad\n"),
        "1f has only phase; give real and imag",
    ),
    "mat cell": (
        "a.mat",
        _mat({"u": np.array([[1, "a"]], dtype=object), "t": [1.0, 2.0]}),
        "variable u is a cell, which is not read",
    ),
    "mat struct": (
        "a.mat",
        _mat({"u": {"deep": 1.0}, "t": [1.0, 2.0]}),
        "variable u is a struct, which is not read",
    ),
    "mat without it": ("a.mat", _mat({"q": [1.0]}), "has none of t, u; it has q"),
    "mat cut off": (
        "a.mat",
        _bytes(b"MATLAB 5.0 MAT-file" + b" " * 105 + b"\x00\x01IM" + b"\x0e\x00\x00\x00\xff"),
        "damaged, or not a MATLAB file (",
    ),
    "mat garbage": (
        "a.mat",
        _bytes(
            b"MATLAB 5.0 MAT-file"
            + b" " * 105
            + b"\x00\x01IM"
            + b"\x0e\0\0\0\xff\0\0\0"
            + bytes(range(64))
        ),
        "damaged, or not a MATLAB file (",
    ),
    "hdf5 of another make": (
        "a.h5",
        _hdf5(lambda file: file.create_dataset("x", data=[1.0])),
        "what its arrays are; start with kind",
    ),
    "hdf5 link": (
        "a.h5",
        _hdf5(lambda file: file.__setitem__("000", h5py.ExternalLink("/etc/passwd", "/"))),
        "is a link, which femnl does not follow",
    ),
    "hdf5 half": (
        "a.h5",
        _hdf5(lambda file: _sample(file, grid=[1.0, 2.0], x=[1.0], y=[1.0])),
        "2 values of grid, 1 values of x, 1 values of y; the file is cut off",
    ),
    "daq without clock": (
        "a.h5",
        _hdf5(_daq),
        'give it in the TOML, e.g. clockbase = "60 MHz"',
    ),
    "daq without values": (
        "a.h5",
        _hdf5(_daq_without_values, Spec(kind="trace", clockbase="60 MHz")),
        ": dev1/demods/0/sample.x has a chunk without a value; record it again",
    ),
    "hdf5 without names": ("a.h5", _without_names, "damaged (Object visitation failed"),
    "unknown": (
        "a.xyz",
        _bytes(b"hello", None),
        "format not recognised; known are Gwyddion Simple Field",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_faulty_lab_file_is_one_line_with_its_name_and_a_remedy(
    case: str, tmp_path: Path
) -> None:
    name, make, expected = CASES[case]
    spec = make(tmp_path / name)
    with pytest.raises(MeasurementError) as caught:
        import_file(tmp_path / name, tmp_path / "out.nc", spec)
    line = str(caught.value)
    assert expected in line
    assert str(tmp_path) in line
    assert ";" in line
    assert "\n" not in line
    assert not (tmp_path / "out.nc").exists()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("kind = response", "not TOML"),
        (
            'kind = "film"',
            "kind = 'film': Input should be 'spectrum', 'response', 'map', 'trace', 'series' or "
            "'decay'",
        ),
        ('kindd = "map"', "kindd: unknown key, did you mean kind?"),
        ('name = "../../etc"', "name = '../../etc'"),
        ('[columns]\nx = { colum = "a" }', "columns.x"),
        ('[[files]]\nname = "a"\nharmonic = 0', "files.0.harmonic = '0'"),
    ],
)
def test_a_faulty_toml_is_one_line_with_the_key(text: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(MeasurementError) as caught:
        read_spec(tmp_path / "s.toml")
    assert expected in str(caught.value)
    assert str(tmp_path / "s.toml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_of_two_formats_are_not_mixed(tmp_path: Path) -> None:
    _gsf("XRes = 2\nYRes = 2\n")(tmp_path / "m_1f.gsf")
    _csv("f,x,y\n1,2,3\n")(tmp_path / "a.csv")
    with pytest.raises(MeasurementError, match="files of several formats"):
        import_file(tmp_path, tmp_path / "out.nc")


def test_an_object_in_a_matlab_file_is_never_built(tmp_path: Path) -> None:
    scipy.io.savemat(
        tmp_path / "a.mat", {"u": np.ones(3), "t": np.arange(3.0), "evil": {"code": "system('x')"}}
    )
    spec = Spec(
        kind="trace", columns={"voltage": "u", "time": "t"}, values={"drive_frequency": 1e6}
    )
    tree = import_file(tmp_path / "a.mat", tmp_path / "out.nc", spec)
    assert tree["measurement"].to_dataset()["voltage"].values.tolist() == [[1.0, 1.0, 1.0]]
