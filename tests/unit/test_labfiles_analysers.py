"""Files of analysers, of LabVIEW in binary form, and HDF5 files whose arrays have names."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from nptdms.writer import ChannelObject, TdmsWriter

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles import import_file

T = np.linspace(0, 2, 41)
LEVEL = -40 - 10 * T
F = np.linspace(990.0, 1010.0, 21)
V = 1e-3 / (1 + 1j * (F - 1000) / 2)
COLUMNS = 'kind = "response"\n[columns]\n'

KEYSIGHT = (
    "Trace\nSwept SA\nA.19.05,N9020A\n508 B25,01\nCenter Frequency,{centre}\nSpan,{span}\n"
    "RBW,30\nX Axis Units,{x}\nY Axis Units,dBm\nDATA\n"
)
ROHDE = (
    "Type;FSW-26;\nVersion;5.00;\nDate;01.Oct 2026;\nMode;ANALYZER;\nCenter Freq;{centre};Hz\n"
    "Span;{span};Hz\nRBW;30;Hz\nTrace 1;;\nTrace Mode;CLR/WRITE;\nx-Unit;{x};\ny-Unit;dBm;\n"
    "Values;{count};\n"
)
SIGLENT = (
    "Machine Module,T3SA3200\nY Axis Scale,LOG\nY Axis Unit,dBm\nNumber of Points,{count}\n"
    "Trace Name,Trace A\nTrace Type,Clear Write\n" + "Setting,1.000000\n" * 40 + "Trace Data\n"
)


def imported(path: Path) -> tuple[xr.Dataset, str]:
    """Import a file; return its only group, and what was told."""
    told = import_file(path, path.with_suffix(".nc")).attrs["repairs"]
    (group,) = measurement.read(path.with_suffix(".nc")).children.values()
    return group.to_dataset(), "\n".join(told)


@pytest.mark.parametrize("maker", ["Keysight", "Rohde & Schwarz", "decimal commas"])
def test_a_trace_in_zero_span_is_a_decay(maker: str, tmp_path: Path) -> None:
    mark = "," if maker == "Keysight" else ";"
    start = KEYSIGHT if maker == "Keysight" else ROHDE
    text = start.format(centre=1526617.9, span=0, x="s", count=len(T))
    body = "".join(f"{t:.6f}{mark}{p:.6f}\n" for t, p in zip(T, LEVEL, strict=True))
    if maker == "decimal commas":
        body = body.replace(".", ",")
    path = tmp_path / "trace.csv"
    path.write_text(text + body, encoding="utf-8")
    data, _ = imported(path)
    assert data.attrs["kind"] == "decay"
    np.testing.assert_allclose(data["power"], LEVEL, atol=1e-5)
    np.testing.assert_allclose(data["time"], T, atol=1e-5)
    assert data.attrs["frequency"] == pytest.approx(1526617.9)
    assert data.attrs["bandwidth"] == pytest.approx(30)


@pytest.mark.parametrize("maker", ["Keysight", "Rohde & Schwarz"])
def test_a_trace_over_frequency_is_a_response_of_magnitudes(maker: str, tmp_path: Path) -> None:
    mark = "," if maker == "Keysight" else ";"
    start = KEYSIGHT if maker == "Keysight" else ROHDE
    text = start.format(centre=1000, span=20, x="Hz", count=len(F))
    level = 10 * np.log10(abs(V) ** 2 / 2 / 50 / 1e-3)  # of 50 Ω
    body = "".join(f"{f:.6f}{mark}{p:.9f}\n" for f, p in zip(F, level, strict=True))
    path = tmp_path / "trace.csv"
    path.write_text(text + body, encoding="utf-8")
    data, told = imported(path)
    np.testing.assert_allclose(data["magnitude"].values[0], abs(V), rtol=1e-6)
    assert "magnitudes alone" in told


@pytest.mark.parametrize(("rms", "factor"), [("", np.sqrt(2)), ("rms = false\n", 1.0)])
def test_volts_of_an_analyser_are_root_mean_square(rms: str, factor: float, tmp_path: Path) -> None:
    text = ROHDE.format(centre="1000,5", span=20, x="Hz", count=len(F)).replace("dBm", "V")
    body = "".join(f"{f:.6f};{v:.12f}\n" for f, v in zip(F, abs(V), strict=True))
    path = tmp_path / "trace.csv"
    path.write_text(text + body, encoding="utf-8")
    (tmp_path / "trace.toml").write_text(rms)
    data, told = imported(path)
    np.testing.assert_allclose(data["magnitude"].values[0], factor * abs(V), rtol=1e-6)
    assert ("root mean square" in told) == (not rms)


def test_a_centre_with_a_decimal_comma_is_read(tmp_path: Path) -> None:
    text = ROHDE.format(centre="1526617,9", span=0, x="s", count=len(T))
    body = "".join(f"{t:.6f};{p:.6f}\n" for t, p in zip(T, LEVEL, strict=True))
    (tmp_path / "trace.csv").write_text(text + body.replace(".", ","), encoding="utf-8")
    (tmp_path / "trace.toml").write_text('[values]\npressure = "2 Pa"\n')
    data, _ = imported(tmp_path / "trace.csv")
    assert data.attrs["frequency"] == pytest.approx(1526617.9)
    assert data.attrs["pressure"] == pytest.approx(2)


@pytest.mark.parametrize("further", ["none", "below", "beside"])
def test_the_first_of_siglents_traces_is_read(further: str, tmp_path: Path) -> None:
    frequency = np.linspace(1.49e6, 1.51e6, 21)
    volts = 1e-3 / (1 + 1j * (frequency - 1.5e6) / 2e3)
    level = 10 * np.log10(abs(volts) ** 2 / 2 / 50 / 1e-3)
    beside = f"{1e6:.6f},-80.00" if further == "beside" else ",,"
    rows = [f"{f:.6f},{p:.9f},{beside}\n" for f, p in zip(frequency, level, strict=True)]
    text = SIGLENT.format(count=len(rows)) + "".join(rows)
    if further == "below":
        text += "Trace Name,Trace B\nTrace Data\n" + "1500000.0,-80.0,,,\n" * 21
    path = tmp_path / "trace.csv"
    path.write_text(text, encoding="utf-8")
    data, _ = imported(path)
    np.testing.assert_allclose(data["magnitude"].values[0], abs(volts), rtol=1e-6)
    np.testing.assert_allclose(data["frequency"].values.ravel(), frequency, rtol=1e-12)


def test_an_axis_of_siglent_that_may_be_a_time_is_refused(tmp_path: Path) -> None:
    rows = "".join(f"{t:.6f},{p:.6f},,,\n" for t, p in zip(T, LEVEL, strict=True))
    path = tmp_path / "trace.csv"
    path.write_text(SIGLENT.format(count=len(T)) + rows, encoding="utf-8")
    with pytest.raises(MeasurementError, match="its x axis ends at 2, below every frequency"):
        imported(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("Values;41;\n", ""), "no line Values"),
        (("Values;41;", "Values;42;"), "only 41 of 42 points"),
        (("0.050000;-40.500000", "0.050000;oops"), "line 14: '0.050000;oops' is no pair"),
        (("x-Unit;s", "x-Unit;dBm"), "its x axis is in 'dBm'"),
    ],
)
def test_damaged_traces_are_refused_with_the_line(
    change: tuple[str, str], message: str, tmp_path: Path
) -> None:
    text = ROHDE.format(centre=1e6, span=0, x="s", count=len(T))
    text += "".join(f"{t:.6f};{p:.6f}\n" for t, p in zip(T, LEVEL, strict=True))
    path = tmp_path / "trace.dat"
    path.write_text(text.replace(*change), encoding="utf-8")
    with pytest.raises(MeasurementError, match=message):
        imported(path)


def test_arrays_of_a_netcdf_file_are_columns_by_name(tmp_path: Path) -> None:
    """As QCoDeS exports a run: xarray, a coordinate and what depends on it."""
    run = xr.Dataset({"signal": ("freq", V)}, coords={"freq": F}, attrs={"run_id": 7})
    run.to_netcdf(tmp_path / "run.h5", engine="h5netcdf", invalid_netcdf=True)
    (tmp_path / "run.toml").write_text(
        COLUMNS + 'frequency = "freq"\namplitude = "signal"\n', encoding="utf-8"
    )
    data, _ = imported(tmp_path / "run.h5")
    np.testing.assert_allclose(data["real"].values[0] + 1j * data["imag"].values[0], V)


def test_channels_of_a_log_are_columns_by_name(tmp_path: Path) -> None:
    """Points, channels and entries: two sweeps, one after the other."""
    values = np.empty((len(F), 3, 2))
    values[:, 0] = F[:, None]
    values[:, 1] = np.array([V.real, 2 * V.real]).T
    values[:, 2] = np.array([V.imag, 2 * V.imag]).T
    text = h5py.string_dtype()
    names = np.array(
        [("Source - f", ""), ("Lock-in", "Real"), ("Lock-in", "Imaginary")],
        dtype=[("name", text), ("info", text)],
    )
    with h5py.File(tmp_path / "log.hdf5", "w") as file:
        file["Data/Data"] = values
        file["Data/Channel names"] = names
    (tmp_path / "log.toml").write_text(
        COLUMNS
        + 'frequency = "Source - f"\nreal = "Lock-in (Real)"\nimag = "Lock-in (Imaginary)"\n',
        encoding="utf-8",
    )
    data, _ = imported(tmp_path / "log.hdf5")
    assert data["real"].shape == (2, len(F))
    np.testing.assert_allclose(data["imag"].values, [V.imag, 2 * V.imag])


def test_an_hdf5_file_without_a_description_is_told_with_what_it_holds(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["run/frequency"] = F
        file["run/count"] = 3
    with pytest.raises(MeasurementError, match=r"needs a TOML beside it.*it holds run/frequency$"):
        imported(tmp_path / "run.h5")
    (tmp_path / "damaged.h5").write_bytes((tmp_path / "run.h5").read_bytes()[:200])
    with pytest.raises(MeasurementError, match="not a readable HDF5 file"):
        imported(tmp_path / "damaged.h5")


def test_channels_of_a_tdms_file_are_columns_and_waveforms_have_times(tmp_path: Path) -> None:
    wave = {"wf_increment": 1e-3, "wf_start_offset": 0.5}
    with TdmsWriter(tmp_path / "log.tdms") as file:
        file.write_segment([ChannelObject("scan", "V", np.sin(T), wave)])
    (tmp_path / "log.toml").write_text(
        'kind = "trace"\n[columns]\ntime = "V time"\nvoltage = "V"\n[values]\n'
        'drive_frequency = "1 kHz"\n',
        encoding="utf-8",
    )
    data, _ = imported(tmp_path / "log.tdms")
    np.testing.assert_allclose(data["voltage"].values[0], np.sin(T))
    np.testing.assert_allclose(np.diff(data["time"]), 1e-3)


def test_a_damaged_tdms_file_is_refused_in_one_line_or_said_to_be_cut_off(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with TdmsWriter(tmp_path / "log.tdms") as file:
        file.write_segment([ChannelObject("scan", "V", F)])
    whole = (tmp_path / "log.tdms").read_bytes()
    (tmp_path / "log.toml").write_text(
        'kind = "trace"\n[columns]\ntime = { rate = "1 kHz" }\nvoltage = "V"\n[values]\n'
        'drive_frequency = "1 Hz"\n'
    )
    told = []
    for size in range(5, len(whole) - 1, 7):
        (tmp_path / "log.tdms").write_bytes(whole[:size])
        try:
            told.append(imported(tmp_path / "log.tdms")[1])
        except MeasurementError as error:
            told.append(str(error))
            assert "\n" not in told[-1]
    assert capfd.readouterr().err == ""
    # The folder is named after this test
    told = [one.replace(str(tmp_path), "") for one in told]
    said = ("damaged, or not", "cut off in its last segment", "no channel of numbers")
    assert any(said[1] in one for one in told)
    assert [one for one in told if not any(words in one for words in said)] == []
