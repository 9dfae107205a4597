"""Lab files of sweeps: levels, words, clocks and heads; nothing is read wrongly in silence."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io.wavfile
import xarray as xr

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles import import_file

F = np.linspace(990.0, 1010.0, 21)
V = 1e-3 / (1 + 1j * (F - 1000) / 2)


def imported(folder: Path, name: str, text: str, spec: str) -> tuple[xr.Dataset, str]:
    """Import a text table; return its only group, and what was told."""
    (folder / name).write_text(text, encoding="utf-8")
    (folder / name).with_suffix(".toml").write_text(spec, encoding="utf-8")
    told = import_file(folder / name, folder / "out.nc").attrs["repairs"]
    tree = measurement.read(folder / "out.nc")
    (group,) = tree.children.values()
    return group.to_dataset(), "\n".join(told)


def rows(*columns: object) -> str:
    return "".join(",".join(str(cell) for cell in row) + "\n" for row in zip(*columns, strict=True))


def test_a_head_longer_than_its_rows_is_refused(tmp_path: Path) -> None:
    text = "time frequency (Hz) X Y\n" + rows(F, F, V.real, V.imag).replace(",", " ")
    spec = 'kind = "response"\n[columns]\nfrequency = "X"\nreal = "Y"\nimag = "Y"\n'
    with pytest.raises(MeasurementError, match="the heading names 5 columns, but rows have 4"):
        imported(tmp_path, "s.txt", text, spec)


@pytest.mark.parametrize(
    ("unit", "level"),
    [
        ("dBm", 10 * np.log10(abs(V) ** 2 / 2 / 50 / 1e-3)),
        ("dBV", 20 * np.log10(abs(V) / np.sqrt(2))),
        ("dB", 20 * np.log10(abs(V))),
    ],
)
def test_levels_become_amplitudes_and_are_refused_without_a_unit(
    unit: str, level: np.ndarray[tuple[int], np.dtype[np.float64]], tmp_path: Path
) -> None:
    spec = 'kind = "response"\n[columns]\nfrequency = "f"\n'
    text = "f,P\n" + rows(F, level)
    data, told = imported(
        tmp_path, "s.csv", text, spec + f'magnitude = {{ column = "P", unit = "{unit}" }}\n'
    )
    np.testing.assert_allclose(data["magnitude"].values[0], abs(V), rtol=1e-9)
    assert "magnitudes alone" in told
    with pytest.raises(MeasurementError, match="is negative; if it is a level"):
        imported(tmp_path, "s.csv", text, spec + 'magnitude = "P"\n')
    with pytest.raises(MeasurementError, match="the heading says decibel"):
        imported(tmp_path, "s.csv", "f,P (dB)\n" + rows(F, -level), spec + 'magnitude = "P (dB)"\n')


@pytest.mark.parametrize("ways", [("up", "down"), (1, -1)])
def test_time_temperature_and_direction_of_points_are_kept(
    ways: tuple[object, object], tmp_path: Path
) -> None:
    f = np.concatenate([F, F[::-1]])
    v = np.concatenate([V, V[::-1]])
    time = 100 + 2.0 * np.arange(42)
    way = [ways[0]] * 21 + [ways[1]] * 21
    text = "t,f,X,Y,T,way,note\n" + rows(time, f, v.real, v.imag, 4 + time / 100, way, f)
    spec = (
        'kind = "response"\n[columns]\ntime = "t"\nfrequency = "f"\nreal = "X"\nimag = "Y"\n'
        'temperature = "T"\ndirection = "way"\n'
    )
    data, told = imported(tmp_path, "s.csv", text, spec)
    assert data["direction"].values.tolist() == [1, -1]
    assert data["time"].values.tolist() == [100, 142]
    np.testing.assert_allclose(data["duration"].values, 42)
    np.testing.assert_allclose(data["temperature"].values, [5.2, 5.62])
    assert "columns that are not read: note" in told


def test_sweeps_side_by_side_and_shifts_from_a_centre_are_read(tmp_path: Path) -> None:
    text = "shift,X1,Y1,X2,Y2\n" + rows(F - 1000, V.real, V.imag, 2 * V.real, 2 * V.imag)
    spec = (
        'kind = "response"\n[columns]\n'
        'frequency = { column = "shift", offset = "1 kHz" }\n'
        'real = { column = ["X1", "X2"] }\nimag = { column = ["Y1", "Y2"] }\n'
    )
    data, _ = imported(tmp_path, "s.csv", text, spec)
    np.testing.assert_allclose(data["frequency"].values[0], F)
    np.testing.assert_allclose(measurement.amplitude(data).values, [V, 2 * V])


def test_times_rounded_to_seven_digits_become_an_even_clock(tmp_path: Path) -> None:
    time = np.round(1000 + 0.0004 * np.arange(500), 3)
    text = "t,U\n" + rows([f"{t:.3f}" for t in time], np.sin(np.arange(500)))
    spec = 'kind = "trace"\n[columns]\ntime = "t"\nvoltage = "U"\n'
    spec += '[values]\ndrive_frequency = "400 Hz"\n'
    data, told = imported(tmp_path, "s.csv", text, spec)
    assert "times are rounded to 0.001 s" in told
    np.testing.assert_allclose(np.diff(data["time"].values), 0.0004, rtol=1e-3)


def test_numpy_arrays_recordings_and_labview_text_are_read(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.column_stack([F, V]))
    (tmp_path / "a.toml").write_text('kind = "response"\n[columns]\nfrequency = 3\namplitude = 2\n')
    with pytest.raises(MeasurementError, match="no column '3'"):
        import_file(tmp_path / "a.npy", tmp_path / "a.nc")
    table = np.array(list(zip(F, V, strict=True)), dtype=[("f", float), ("v", complex)])
    np.save(tmp_path / "a.npy", table)
    (tmp_path / "a.toml").write_text(
        'kind = "response"\n[columns]\nfrequency = "f"\namplitude = "v"\n'
    )
    import_file(tmp_path / "a.npy", tmp_path / "a.nc")
    data = measurement.read(tmp_path / "a.nc")["measurement"].to_dataset()
    np.testing.assert_allclose(measurement.amplitude(data).values[0], V)

    samples = (2**14 * np.sin(np.arange(400) / 5)).astype(np.int16)
    scipy.io.wavfile.write(tmp_path / "b.wav", 8000, samples)
    (tmp_path / "b.toml").write_text(
        'kind = "trace"\n[columns]\nvoltage = 1\n[values]\ndrive_frequency = "250 Hz"\n'
    )
    told = import_file(tmp_path / "b.wav", tmp_path / "b.nc").attrs["repairs"]
    data = measurement.read(tmp_path / "b.nc")["measurement"].to_dataset()
    np.testing.assert_allclose(data["voltage"].values[0], samples / 2**15)
    np.testing.assert_allclose(np.diff(data["time"].values), 1 / 8000)
    assert any("full scale of 1 V" in line for line in told)

    body = "".join(f"{f:.3f}\t{v.real:.9g}\t{v.imag:.9g}\t\n" for f, v in zip(F, V, strict=True))
    text = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\n"
        "***End_of_Header***\t\n\nChannels\t2\n***End_of_Header***\t\t\n"
        "X_Value\tX\tY\tComment\n" + body.replace(".", ",")
    )
    spec = 'kind = "response"\n[columns]\nfrequency = "X_Value"\nreal = "X"\nimag = "Y"\n'
    data, _ = imported(tmp_path, "c.lvm", text, spec)
    np.testing.assert_allclose(measurement.amplitude(data).values[0], V, rtol=1e-7)
    with pytest.raises(MeasurementError, match=r"line 10: .* is not a number"):
        imported(tmp_path, "c.lvm", text.replace("990,000", "99x", 1), spec)


def test_an_array_of_objects_runs_nothing_and_is_refused(tmp_path: Path) -> None:
    ran = tmp_path / "ran"

    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return Path.touch, (str(ran),)

    np.save(tmp_path / "a.npy", np.array([Trap(), 1], dtype=object), allow_pickle=True)
    (tmp_path / "a.toml").write_text('kind = "response"\n[columns]\nfrequency = "1"\n')
    with pytest.raises(MeasurementError, match="not a plain array of numbers"):
        import_file(tmp_path / "a.npy", tmp_path / "a.nc")
    assert not ran.exists()
