"""Files of labs become measurement files: what the exporter wrote is what femnl reads."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles import Spec, formats, import_file

DATA = Path(__file__).parents[3] / "shared" / "data"
F = np.linspace(1.4660e6, 1.4662e6, 21)
V = np.stack([amplitude / (1 + 1j * (F - 1.4661e6) / 20.0) for amplitude in (1e-3, 2e-3)])
RESPONSE = """
kind = "response"
name = "sweeps"
geometry = "square-270um"
[columns]
frequency = { column = "f", unit = "kHz" }
magnitude = { column = "R", unit = "mV" }
phase = { column = "theta", unit = "deg" }
drive = { column = "U", unit = "mV" }
[values]
wavelength = "632.8 nm"
"""


def _response_table(path: Path, mark: str = ",", decimal: str = ".") -> None:
    """Two drives, the second swept down, as a spreadsheet exports them."""
    rows = [(100.0, F, V[0]), (200.0, F[::-1], V[1][::-1])]
    lines = [mark.join(("U", "f", "R", "theta"))]
    for drive, f, v in rows:
        for one, volt in zip(f, v, strict=True):
            cells = (drive, one / 1e3, abs(volt) * 1e3, np.degrees(np.angle(volt)))
            lines.append(mark.join(repr(float(cell)).replace(".", decimal) for cell in cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.parametrize(("mark", "decimal"), [(",", "."), (";", ","), ("\t", "."), (" ", ".")])
def test_a_text_table_with_its_toml_becomes_a_response(
    mark: str, decimal: str, tmp_path: Path
) -> None:
    _response_table(tmp_path / "run.csv", mark, decimal)
    (tmp_path / "run.toml").write_text(f'decimal = "{decimal}"\n' + RESPONSE)
    import_file(tmp_path / "run.csv", tmp_path / "run.nc")
    tree = measurement.read(tmp_path / "run.nc")
    sweeps = tree["sweeps"].to_dataset()
    np.testing.assert_allclose(sweeps["frequency"].values, [F, F], rtol=1e-14)
    np.testing.assert_allclose(measurement.amplitude(sweeps).values, V, rtol=1e-12)
    np.testing.assert_allclose(sweeps["drive"].values, [0.1, 0.2])
    assert sweeps["direction"].values.tolist() == [1, -1]
    assert sweeps.attrs["wavelength"] == pytest.approx(632.8e-9)
    assert tree.attrs["geometry"] == "square-270um"
    assert "run.csv" in tree.attrs["source"]
    assert "2 sweeps, 1 up and 1 down" in tree.attrs["history"]


@pytest.mark.parametrize("order", ["up up", "up down", "down up down"])
def test_sweeps_are_told_apart_where_the_frequency_turns_back(order: str, tmp_path: Path) -> None:
    runs = [F if way == "up" else F[::-1] for way in order.split()]
    table = "f,x,y\n" + "".join(
        f"{f!r},{float(np.cos(f))!r},{float(np.sin(f))!r}\n" for f in np.concatenate(runs).tolist()
    )
    (tmp_path / "run.csv").write_text(table)
    columns = {"frequency": "f", "real": "x", "imag": "y"}
    tree = import_file(
        tmp_path / "run.csv", tmp_path / "run.nc", Spec(kind="response", columns=columns)
    )
    sweeps = tree["measurement"].to_dataset()
    assert sweeps["direction"].values.tolist() == [
        1 if way == "up" else -1 for way in order.split()
    ]
    f = sweeps["frequency"].values
    # Of cos
    np.testing.assert_allclose(
        sweeps["real"].values[np.isfinite(f)], np.cos(f[np.isfinite(f)]), rtol=0, atol=2e-16
    )
    assert np.isfinite(f).sum() == F.size * len(runs)


def test_a_long_table_becomes_a_map_on_its_grid_with_gaps_as_missing(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    places = [
        (n, y, x) for n in (1, 2) for y in range(3) for x in range(4) if (n, y, x) != (2, 1, 1)
    ]
    jitter = rng.uniform(-0.2, 0.2, size=(len(places), 2))
    rows = [
        f"{n} {x + dx:.6f} {y + dy:.6f} {n * x} {y}"
        for (n, y, x), (dx, dy) in zip(places, jitter, strict=True)
    ]
    (tmp_path / "map.txt").write_text("n x y re im\n" + "\n".join(rows))
    (tmp_path / "map.toml").write_text(
        'kind = "map"\nrms = true\n[columns]\nharmonic = "n"\n'
        'real = { column = "re", unit = "mV" }\nimag = { column = "im", unit = "mV" }\n'
        'x = { column = "x", unit = "um", round = "1 um" }\ny = { column = "y", unit = "um", '
        'round = "1 um" }\n'
    )
    tree = import_file(tmp_path / "map.txt", tmp_path / "map.nc")
    picture = tree["measurement"].to_dataset()
    np.testing.assert_allclose(picture["x"].values, np.arange(4) * 1e-6)
    expected = (
        np.sqrt(2) * 1e-3 * np.arange(4) * np.array([1, 2])[:, None, None] * np.ones((1, 3, 1))
    )
    expected[1, 1, 1] = np.nan
    np.testing.assert_allclose(picture["real"].values, expected)


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_matlab_variables_become_a_trace(version: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    volts = rng.normal(size=(3, 40))
    time = np.arange(40) * 1e-7
    drive = np.array([1e6, 1.1e6, 1.2e6])
    path = tmp_path / "scope.mat"
    if version == "5":
        scipy.io.savemat(
            path, {"U": volts * 1e3, "t": time, "fd": drive, "note": "ignored"}, do_compression=True
        )
    else:
        _matlab73(path, {"U": volts * 1e3, "t": time[None], "fd": drive[None]})
    (tmp_path / "scope.toml").write_text(
        'kind = "trace"\n[columns]\nvoltage = { column = "U", unit = "mV" }\ntime = '
        '"t"\ndrive_frequency = { '
        'column = "fd", unit = '
        '"Hz" }\n'
        '[values]\nwavelength = "532 nm"\nnoise_sd = 1e-4\n'
    )
    tree = import_file(path, tmp_path / "scope.nc")
    found = tree["measurement"].to_dataset()
    np.testing.assert_allclose(found["voltage"].values, volts, rtol=1e-14)
    np.testing.assert_allclose(found["drive_frequency"].values, drive)
    assert found.attrs["noise_sd"] == 1e-4


def _matlab73(path: Path, variables: dict[str, NDArray[Any]]) -> None:
    """Write as MATLAB 7.3 does.

    a user block of 512 bytes, axes reversed, the class as attribute, complex as a compound.
    """
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            stored = values.T
            if np.iscomplexobj(stored):
                pair = np.zeros(stored.shape, dtype=[("real", "f8"), ("imag", "f8")])
                pair["real"] = stored.real
                pair["imag"] = stored.imag
                stored = pair
            file[name] = stored
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as raw:
        raw.write(
            b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan 01 00:00:00 2024 HDF5 "
            b"schema 1.00 .".ljust(116)
            + b" " * 8
            + b"\x00\x02IM"
        )


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_complex_matlab_sweeps_become_a_response(version: str, tmp_path: Path) -> None:
    path = tmp_path / "vna.mat"
    if version == "5":
        scipy.io.savemat(path, {"S": V, "f": F})
    else:
        _matlab73(path, {"S": V, "f": F[None]})
    spec = Spec(
        kind="response", columns={"amplitude": "S", "frequency": "f"}, values={"mode": "1,1"}
    )
    sweeps = import_file(path, tmp_path / "vna.nc", spec)["measurement"].to_dataset()
    np.testing.assert_allclose(measurement.amplitude(sweeps).values, V, rtol=1e-14)
    np.testing.assert_allclose(sweeps["frequency"].values, [F, F])


def _labone_csv(path: Path, mark: str = ";") -> None:
    """Write two sweeps, the second down and cut short, as the LabOne sweeper saves them.

    a line for each field, filled with nan.
    """
    lines = [mark.join(("chunk", "timestamp", "size", "fieldname")) + mark]
    for chunk, (f, v) in enumerate([(F, V[0]), (F[:4:-1], V[1][:4:-1])]):
        rms = v / np.sqrt(2)
        for name, values in {
            "grid": f,
            "frequency": f,
            "r": abs(rms),
            "phase": np.angle(rms),
            "x": rms.real,
            "y": rms.imag,
            "settling": f * 0,
        }.items():
            cells = [repr(float(value)) for value in values] + ["nan"] * (F.size - f.size)
            lines.append(mark.join((str(chunk), str(12345 + chunk), str(f.size), name, *cells)))
    path.write_text("\n".join(lines) + "\n")


def _with_commented_heading(path: Path) -> None:
    _labone_csv(path)
    path.write_text("% " + path.read_text())


def _labone_hdf5(path: Path) -> None:
    """Write the same as LabOne's HDF5: /chunk/device/demods/n/sample/field."""
    with h5py.File(path, "w") as file:
        for chunk, (f, v) in enumerate([(F, V[0]), (F[:4:-1], V[1][:4:-1])]):
            sample = file.create_group(f"{chunk:03d}/dev4434/demods/0/sample")
            for name, values in {
                "timestamp": np.arange(f.size),
                "grid": f,
                "frequency": f,
                "x": v.real / np.sqrt(2),
                "y": v.imag / np.sqrt(2),
            }.items():
                sample[name] = values
            file[f"{chunk:03d}/dev4434/demods/0/timeconstant/value"] = [1e-3]


@pytest.mark.parametrize(
    "write",
    [_labone_csv, _labone_hdf5, lambda path: _labone_csv(path, ","), _with_commented_heading],
    ids=["csv", "hdf5", "comma", "commented heading"],
)
def test_labone_sweeps_come_in_as_amplitudes_with_their_direction(
    write: Callable[[Path], None], tmp_path: Path
) -> None:
    path = tmp_path / "dev4434_demods_0_sample_00000.dat"
    write(path)
    spec = Spec(
        name="lockin", values={"drive": ["100 mV", 0.2], "harmonic": 1, "wavelength": "632.8 nm"}
    )
    tree = import_file(path, tmp_path / "lockin.nc", spec)
    sweeps = tree["lockin"].to_dataset()
    assert sweeps["direction"].values.tolist() == [1, -1]
    np.testing.assert_allclose(sweeps["drive"].values, [0.1, 0.2])
    np.testing.assert_allclose(measurement.amplitude(sweeps).values[0], V[0], rtol=1e-12)
    np.testing.assert_allclose(measurement.amplitude(sweeps).values[1, :16], V[1][5:], rtol=1e-12)
    assert np.isnan(sweeps["frequency"].values[1, 16:]).all()
    assert any("√2 times the root mean square" in line for line in tree.attrs["repairs"])


def test_sweeps_of_two_devices_in_one_file_are_two_measurements(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "two.h5", "w") as file:
        for device, size in (("dev1", 1.0), ("dev2", 3.0)):
            sample = file.create_group(f"000/{device}/demods/0/sample")
            for name, values in {"grid": F, "x": size * V[0].real, "y": size * V[0].imag}.items():
                sample[name] = values
    tree = import_file(tmp_path / "two.h5", tmp_path / "two.nc", Spec(rms=False))
    assert [*tree.children] == ["measurement-dev1-demod0", "measurement-dev2-demod0"]
    second = tree["measurement-dev2-demod0"].to_dataset()
    np.testing.assert_allclose(measurement.amplitude(second).values[0], 3 * V[0])


def test_samples_of_a_demodulator_as_text_become_a_response(tmp_path: Path) -> None:
    rows = [
        f"0;{tick};{v.real!r};{v.imag!r};{f!r};0;0;0"
        for tick, (f, v) in enumerate(zip(F.tolist(), V[0].tolist(), strict=True))
    ]
    (tmp_path / "s.csv").write_text(
        "chunk;timestamp;x;y;freq;phase;dio;trigger\n" + "\n".join(rows)
    )
    sweeps = import_file(tmp_path / "s.csv", tmp_path / "s.nc", Spec(rms=False))[
        "measurement"
    ].to_dataset()
    np.testing.assert_allclose(measurement.amplitude(sweeps).values, V[:1], rtol=1e-12)


def test_a_signal_of_the_labone_acquisition_becomes_a_trace(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "daq.h5", "w") as file:
        for chunk in range(3):
            for signal in ("x", "y"):
                node = file.create_group(f"{chunk:03d}/dev4434/demods/0/sample.{signal}.avg")
                node["value"] = np.arange(50) * (chunk + 1.0) * (1 if signal == "x" else -1)
                node["timestamp"] = np.uint64(10**9) + np.arange(50, dtype=np.uint64) * 6000
    spec = Spec(signal="sample.x.avg", clockbase="60 MHz", values={"drive_frequency": "1.4661 MHz"})
    found = import_file(tmp_path / "daq.h5", tmp_path / "daq.nc", spec)["measurement"].to_dataset()
    np.testing.assert_allclose(found["time"].values, np.arange(50) * 1e-4)
    np.testing.assert_allclose(found["voltage"].values, np.arange(50) * np.array([[1], [2], [3]]))
    with pytest.raises(MeasurementError, match="2 of 2 signals match; choose one"):
        import_file(tmp_path / "daq.h5", tmp_path / "daq.nc", Spec(clockbase="60 MHz"))


def _gsf(path: Path, values: NDArray[np.float64], **header: object) -> None:
    """Write as Gwyddion's page says.

    Magic line, header, NUL up to a multiple of four, rows from the top, 32-bit floats.
    """
    fields = {"XRes": values.shape[1], "YRes": values.shape[0], **header}
    text = (
        b"Gwyddion Simple Field 1.0\n"
        + "".join(f"{key} = {value}\n" for key, value in fields.items()).encode()
    )
    path.write_bytes(text + b"\0" * (4 - len(text) % 4) + values.astype("<f4").tobytes())


@pytest.mark.parametrize("title", ["a", "ab", "abc", "abcd"])
def test_gwyddion_images_become_the_harmonics_of_a_map(title: str, tmp_path: Path) -> None:
    images = np.arange(2 * 2 * 3 * 5, dtype=float).reshape(2, 2, 3, 5)
    extent = {"XReal": 10, "YReal": 6, "XYUnits": "um", "ZUnits": "mV", "Title": title}
    for n, pair in zip((1, 3), images, strict=True):
        _gsf(tmp_path / f"drum_{n}f_real.gsf", pair[0], **extent)
        _gsf(tmp_path / f"drum_{n}f_imag.gsf", pair[1], **extent)
    tree = import_file(tmp_path, tmp_path / "drum.nc", Spec(values={"wavelength": "632.8 nm"}))
    found = tree["measurement"].to_dataset()
    assert found["harmonic"].values.tolist() == [1, 3]
    np.testing.assert_allclose(found["x"].values, [-4e-6, -2e-6, 0, 2e-6, 4e-6], atol=1e-20)
    np.testing.assert_allclose(found["y"].values, [-2e-6, 0, 2e-6], atol=1e-20)
    np.testing.assert_allclose(
        measurement.amplitude(found).values, 1e-3 * (images[:, 0] + 1j * images[:, 1])[:, ::-1]
    )
    assert any("origin is taken in the middle" in line for line in tree.attrs["repairs"])


def test_gwyddion_offsets_place_the_image(tmp_path: Path) -> None:
    _gsf(
        tmp_path / "m.gsf",
        np.ones((2, 2)),
        XReal=2e-6,
        YReal=2e-6,
        XOffset=1e-6,
        YOffset=-3e-6,
        ZUnits="V",
    )
    (tmp_path / "m.toml").write_text('[[files]]\nname = "m.gsf"\nharmonic = 2\n')
    tree = import_file(tmp_path / "m.gsf", tmp_path / "m.nc")
    found = tree["measurement"].to_dataset()
    np.testing.assert_allclose(found["x"].values, [1.5e-6, 2.5e-6])
    np.testing.assert_allclose(found["y"].values, [1.5e-6, 2.5e-6])
    assert any("2f has no imaginary part, taken as zero" in line for line in tree.attrs["repairs"])


@pytest.mark.shared
@pytest.mark.skipif(not DATA.is_dir(), reason="the shared data are not beside the repository")
def test_the_silverbox_comes_in_as_a_trace_with_its_drive(tmp_path: Path) -> None:
    columns = {"drive_voltage": "V1", "voltage": "V2", "time": {"rate": "610.3515625 Hz"}}
    spec = Spec.model_validate({"kind": "trace", "name": "silverbox", "columns": columns})
    import_file(DATA / "silverbox" / "SNLS80mV.csv", tmp_path / "silverbox.nc", spec)
    found = measurement.read(tmp_path / "silverbox.nc")["silverbox"].to_dataset()
    assert dict(found.sizes) == {"step": 1, "time": 131072}
    assert found["drive_voltage"].values[0, :2].tolist() == [0.0057756, 0.0066102]
    assert found["voltage"].values[0, 1] == 0.012971
    assert float(found["time"].values[1]) == 2**14 / 1e7


def test_every_format_is_found_by_being_in_the_folder() -> None:
    assert [kind.name for kind in formats()] == [
        "Gwyddion Simple Field",
        "Gwyddion file",
        "HDF5 file",
        "LabOne HDF5",
        "LabOne text",
        "LabVIEW TDMS",
        "LabVIEW text",
        "MATLAB file",
        "Nanonis scan",
        "NumPy array",
        "analyser text",
        "analyser trace",
        "recording",
        "text table",
    ]
