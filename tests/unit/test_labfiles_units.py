"""Units that files state, names that descriptions misspell, and sources that stay as they are."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from femnl import measurement
from femnl.core.errors import MeasurementError, ParameterError
from femnl.io.labfiles import import_file

SWEEP = 'kind = "response"\n[columns]\nfrequency = {f}\nreal = "X"\nimag = "Y"\n'
HZ = np.array([999.9, 999.95, 1000.0, 1000.05])


def imported(folder: Path, text: str, spec: str) -> tuple[xr.Dataset, str]:
    """Import a table; return its only group, and what was told."""
    source = folder / "s.csv"
    source.write_text(text, encoding="utf-8")
    source.with_suffix(".toml").write_text(spec, encoding="utf-8")
    told = import_file(source, folder / "out.nc").attrs["repairs"]
    (group,) = measurement.read(folder / "out.nc").children.values()
    return group.to_dataset(), "\n".join(told)


def table(head: str, frequency: np.ndarray[tuple[int], np.dtype[np.float64]] = HZ) -> str:
    """Return a table of three columns: frequency, 1 and 2."""
    return f"{head}\n" + "".join(f"{f!r},1,2\n" for f in frequency.tolist())


@pytest.mark.parametrize("name", ["f [kHz]", "f (kHz)", "f / kHz", "f/kHz", "f_kHz", "f kHz"])
def test_a_unit_in_a_heading_is_that_of_the_column(name: str, tmp_path: Path) -> None:
    data, told = imported(tmp_path, table(f"{name},X,Y"), SWEEP.format(f=f'"{name}"'))
    np.testing.assert_allclose(data["frequency"].values[0], 1e3 * HZ)
    assert "columns.frequency: in kHz, as the file says" in told


def test_a_unit_in_a_heading_counts_where_its_column_is_named_by_number(tmp_path: Path) -> None:
    data, _ = imported(tmp_path, table("f [kHz],X,Y"), SWEEP.format(f="1"))
    np.testing.assert_allclose(data["frequency"].values[0], 1e3 * HZ)


@pytest.mark.parametrize("name", ["f (demod 1)", "f [a.u.]", "run_2", "f/s"])
def test_what_is_no_unit_of_the_quantity_says_nothing(name: str, tmp_path: Path) -> None:
    data, _ = imported(tmp_path, table(f"{name},X,Y"), SWEEP.format(f=f'"{name}"'))
    np.testing.assert_allclose(data["frequency"].values[0], HZ)


@pytest.mark.parametrize(
    ("name", "instead"),
    [
        ("f (V)", "'Hz'"),
        ("f [dBm]", "'Hz'"),
        ("Freq (MHZ)", "'mHz' or 'MHz'"),
        ("f (KHZ)", "'kHz'"),
    ],
)
def test_a_unit_of_another_quantity_or_in_wrong_letters_is_refused(
    name: str, instead: str, tmp_path: Path
) -> None:
    found = name.split()[1].strip("()[]")
    line = f"the file says '{found}' of .*, which is no unit of Hz; .* unit = {instead}"
    with pytest.raises(MeasurementError, match=line):
        imported(tmp_path, table(f"{name},X,Y"), SWEEP.format(f=f'"{name}"'))
    spec = SWEEP.format(f=f'{{ column = "{name}", unit = "kHz" }}')
    data, _ = imported(tmp_path, table(f"{name},X,Y"), spec)
    np.testing.assert_allclose(data["frequency"].values[0], 1e3 * HZ)


@pytest.mark.parametrize("head", ["R{} [mV]", "R{} [dBV]"])
def test_columns_side_by_side_have_the_unit_of_their_headings(head: str, tmp_path: Path) -> None:
    names = [head.format(k) for k in (1, 2)]
    spec = f'kind = "response"\n[columns]\nfrequency = "f"\nmagnitude = {{ column = {names} }}\n'
    rows = "".join(f"{f},20,40\n" for f in HZ[::-1])
    data, told = imported(tmp_path, "f," + ",".join(names) + "\n" + rows, spec)
    volts = [[0.02], [0.04]] if "mV" in head else np.sqrt(2) * np.array([[10.0], [100.0]])
    np.testing.assert_allclose(data["magnitude"], np.tile(volts, (1, HZ.size)))
    np.testing.assert_allclose(data["frequency"], np.tile(HZ, (2, 1)))
    assert data["direction"].values.tolist() == [-1, -1]
    assert "columns.magnitude: in " in told
    spec = spec.replace(names[1], "Z (V)")
    with pytest.raises(MeasurementError, match=r"and 'V' of 'Z \(V\)'; save them in one unit"):
        imported(tmp_path, f"f,{names[0]},Z (V)\n" + rows, spec)


@pytest.mark.parametrize("heads", [("X (1)", "X (2)"), ("X (up)", "X (down)")])
def test_words_in_brackets_may_tell_columns_apart(heads: tuple[str, str], tmp_path: Path) -> None:
    column = f"{{ column = {list(heads)} }}"
    spec = f'kind = "response"\n[columns]\nfrequency = "f"\nmagnitude = {column}\n'
    text = f"f,{','.join(heads)}\n" + "".join(f"{f},1,2\n" for f in HZ)
    data, _ = imported(tmp_path, text, spec)
    assert data["magnitude"].values[:, 0].tolist() == [1, 2]


def test_a_power_that_is_a_control_variable_stays_in_watts(tmp_path: Path) -> None:
    spec = 'kind = "series"\n[columns]\nquality_factor = "Q"\n'
    spec += 'power = { column = "P (mW)", unit = "mW" }\n'
    data, _ = imported(tmp_path, "P (mW),Q\n0,1e5\n1,9e4\n10,7e4\n", spec)
    assert data["power"].values.tolist() == pytest.approx([0, 1e-3, 1e-2])
    assert data["power"].attrs["units"] == "W"


def test_as_many_columns_as_points_are_sweeps_side_by_side(tmp_path: Path) -> None:
    names = [f"R{k}" for k in range(len(HZ))]
    spec = f'kind = "response"\n[columns]\nfrequency = "f"\nmagnitude = {{ column = {names} }}\n'
    rows = "".join(
        ",".join(map(str, [f, *(f + 1e4 * k for k in range(len(HZ)))])) + "\n" for f in HZ
    )
    data, told = imported(tmp_path, ",".join(["f", *names]) + "\n" + rows, spec)
    np.testing.assert_allclose(data["magnitude"].values[3], HZ + 3e4)
    assert "magnitude has one sweep a column" in told


def test_a_drive_in_dbm_is_an_amplitude_over_fifty_ohm(tmp_path: Path) -> None:
    spec = (
        'kind = "response"\n[columns]\nfrequency = "f"\nreal = "X"\nimag = "Y"\ndrive = "P (dBm)"\n'
    )
    text = "f,X,Y,P (dBm)\n" + "".join(f"{f},1,0,-20\n" for f in HZ)
    data, _ = imported(tmp_path, text, spec)
    assert data["drive"].values.tolist() == pytest.approx([np.sqrt(2 * 50 * 1e-5)])


def test_two_levels_by_other_references_are_no_unit_alike(tmp_path: Path) -> None:
    column = '{ column = "P (dBV)", unit = "dBm" }'
    spec = f'kind = "response"\n[columns]\nfrequency = "f"\nmagnitude = {column}\n'
    text = "f,P (dBV)\n" + "".join(f"{f},0\n" for f in HZ)
    with pytest.raises(MeasurementError, match="unit = 'dBm', but the file says 'dBV'"):
        imported(tmp_path, text, spec)


def test_a_unit_that_contradicts_the_heading_is_refused(tmp_path: Path) -> None:
    spec = SWEEP.format(f='{ column = "f / MHz", unit = "Hz" }')
    with pytest.raises(MeasurementError, match="unit = 'Hz', but the file says 'MHz'"):
        imported(tmp_path, table("f / MHz,X,Y"), spec)


def test_a_phase_in_degrees_by_its_heading_is_no_radian(tmp_path: Path) -> None:
    spec = 'kind = "response"\n[columns]\nfrequency = "f"\nmagnitude = "R"\nphase = "P (deg)"\n'
    text = "f,R,P (deg)\n" + "".join(f"{f},1,90\n" for f in HZ)
    data, _ = imported(tmp_path, text, spec)
    np.testing.assert_allclose(data["real"].values[0], 0, atol=1e-12)


def test_levels_in_headings_are_read_as_such(tmp_path: Path) -> None:
    spec = 'kind = "response"\n[columns]\nfrequency = "f"\nmagnitude = "P (dBV)"\n'
    data, _ = imported(tmp_path, "f,P (dBV)\n" + "".join(f"{f},0\n" for f in HZ), spec)
    np.testing.assert_allclose(data["magnitude"].values[0], np.sqrt(2))


def test_root_mean_square_in_a_heading_asks_what_to_do(tmp_path: Path) -> None:
    spec = 'kind = "response"\n{}[columns]\nfrequency = "f"\nmagnitude = "R (mVrms)"\n'
    text = "f,R (mVrms)\n" + "".join(f"{f},1\n" for f in HZ)
    with pytest.raises(MeasurementError, match="is root mean square; give rms = true"):
        imported(tmp_path, text, spec.format(""))
    data, _ = imported(tmp_path, text, spec.format("rms = true\n"))
    np.testing.assert_allclose(data["magnitude"].values[0], np.sqrt(2) * 1e-3)


@pytest.mark.parametrize(("unit", "hertz"), [("rad/s", 1 / (2 * np.pi)), ("rpm", 1 / 60)])
def test_angular_frequencies_become_frequencies(unit: str, hertz: float, tmp_path: Path) -> None:
    spec = SWEEP.format(f=f'{{ column = "f", unit = "{unit}" }}')
    data, _ = imported(tmp_path, table("f,X,Y"), spec)
    np.testing.assert_allclose(data["frequency"].values[0], hertz * HZ)


def test_units_beside_arrays_of_hdf5_are_theirs(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "u.h5", "w") as file:
        for name, values, unit in (("f", HZ, "MHz"), ("X", HZ, "mV"), ("Y", HZ, "a.u.")):
            file[name] = values
            file[name].attrs["units"] = unit
    (tmp_path / "u.toml").write_text(SWEEP.format(f='"f"'))
    (group,) = import_file(tmp_path / "u.h5", tmp_path / "out.nc").children.values()
    data = group.to_dataset()
    np.testing.assert_allclose(data["frequency"].values[0], 1e6 * HZ)
    np.testing.assert_allclose(data["real"].values[0], 1e-3 * HZ)
    np.testing.assert_allclose(data["imag"].values[0], HZ)


@pytest.mark.parametrize(
    ("text", "spec", "words"),
    [
        (
            "t,P\n0,-30\n0.5,-31\n1,-32\n0.25,-50\n0.75,-51\n",
            'kind = "decay"\n[columns]\ntime = "t"\npower = "P"\n',
            "row 4: the time goes back from 1 to 0.25",
        ),
        ("2,1,3\n3,5,7\n", SWEEP.format(f="1"), "its first line holds numbers and no headings"),
        ("f,X,X,Y\n1,2,3,4\n", SWEEP.format(f='"f"'), "heading 'X' stands over two columns"),
        ("f,X,Y\n1,2,3\n", SWEEP.format(f='"X"'), "columns.real and columns.frequency are both"),
        ("f;X;Y\n999,9;1,5;2,5\n", SWEEP.format(f='"f"'), 'give decimal = "," in the TOML'),
        ("f,X,Y\n", SWEEP.format(f='"f"'), "no row of data"),
        ("f,X,Y\n1,2,3\n", SWEEP.format(f='"f"').split("\n", 1)[1], "no kind; give one of"),
        (
            table("f,X,Y"),
            SWEEP.format(f='"f"') + '[values]\nnoise_s = "1 mV"\n',
            "values.noise_s is none of a response; did you mean noise_sd?",
        ),
        (
            "f,X,Y,p\n1,2,3,4\n2,2,3,4\n",
            SWEEP.format(f='"f"') + 'phase = "p"\n',
            "columns.phase is that of a magnitude; leave it out",
        ),
        (
            "t,P,s\n0,-30,1\n1,-31,1\n",
            'kind = "decay"\n[columns]\ntime = "t"\npower = "P"\nsweep = "s"\n',
            "columns.sweep: a table of kind decay",
        ),
    ],
)
def test_what_would_be_misread_is_refused_in_one_line(
    text: str, spec: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(MeasurementError) as caught:
        imported(tmp_path, text, spec)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_points_without_a_frequency_are_counted(tmp_path: Path) -> None:
    text = "f,X,Y\n1000,1,2\nnan,5,5\n1001,2,3\n,7,7\n1002,7,7\n"
    data, told = imported(tmp_path, text, SWEEP.format(f='"f"'))
    assert data.sizes["point"] == 3
    assert "2 points without a frequency left out" in told


def test_the_two_signs_for_micro_are_one(tmp_path: Path) -> None:
    spec = SWEEP.format(f='"f"').replace('"X"', '"X / \u00b5V"')
    data, _ = imported(tmp_path, table("f,X / \u03bcV,Y"), spec)
    np.testing.assert_allclose(data["real"].values[0], 1e-6)


def test_power_in_dbm_is_one_in_db(tmp_path: Path) -> None:
    spec = 'kind = "decay"\n[columns]\ntime = "t"\npower = { column = "P", unit = "dBm" }\n'
    data, _ = imported(tmp_path, "t,P\n" + "".join(f"{k},{-k}\n" for k in range(20)), spec)
    np.testing.assert_allclose(data["power"], -np.arange(20.0))


def test_values_become_attributes_of_what_has_them(tmp_path: Path) -> None:
    spec = 'kind = "spectrum"\n[columns]\nfrequency = "f"\nfrequency_sd = "s"\n[values]\n'
    data, _ = imported(tmp_path, "f,s\n1000,1\n2000,1\n", spec + 'pressure = "2 mBar"\n')
    assert data.attrs["pressure"] == pytest.approx(200.0)


@pytest.mark.parametrize("dest", ["b.csv", "out.toml", "data.nc"])
def test_no_source_is_written_over(dest: str, tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv", "data.nc"):
        (tmp_path / name).write_text(table("f,X,Y"))
    sources = [tmp_path / "a.csv", tmp_path / "data.nc"]
    with pytest.raises(ParameterError, match=r"ends in \.nc|is a source"):
        import_file(sources, tmp_path / dest)
    assert (tmp_path / "b.csv").read_text() == table("f,X,Y")
    assert (tmp_path / "data.nc").read_text() == table("f,X,Y")
