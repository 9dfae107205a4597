"""Ring-downs as a signal analyser writes them become decays, or one line says why not."""

import json
from pathlib import Path

import numpy as np
import pytest

from femnl import measurement
from femnl.cli._main import run
from femnl.core.errors import MeasurementError
from femnl.io.labfiles import import_file

HEAD = """% Measurement ID: 7
% Mode ID: 2
% Sample ID: XY12-34
% Frequency [Hz]: 1000000.0
% Quality factor: 5e6
% Temperature [K]: 293.0
% Pressure [mBar]: 2e-6
% Notes:
% initial nonlinear damping
%
% measurement data
"""
HEADING = "% time [s], power [dBm]\n"


def rows(count: int = 80) -> str:
    """A decay at 2 dB a second that wobbles by the last digit."""
    time = 0.1 * np.arange(count)
    power = -30 - 2 * time + 0.01 * np.sin(7.0 * np.arange(count))
    return "".join(f"{t:.2f}, {p:.4f}\n" for t, p in zip(time, power, strict=True))


def test_head_and_rows_become_a_decay_in_si(tmp_path: Path) -> None:
    source = tmp_path / "measID_7.txt"
    source.write_text(HEAD + HEADING + rows())
    tree = import_file(source, tmp_path / "out.nc")
    group = measurement.read(tmp_path / "out.nc")["measID_7"].to_dataset()
    assert tree.attrs["femnl_measurement"] == "1.2"
    assert group.attrs["kind"] == "decay"
    assert group["power"].attrs["units"] == "dB"
    assert group["power"].values[0] == -30
    expected = {"frequency": 1e6, "temperature": 293.0, "pressure": 2e-4}
    for name, value in expected.items():
        assert group.attrs[name] == pytest.approx(value, rel=1e-12)
    assert group.attrs["notes"] == "initial nonlinear damping"
    assert group.attrs["mode"] == "2"
    assert "quality_factor" not in group.attrs


def test_a_folder_becomes_one_file_and_its_spectra_are_named(tmp_path: Path) -> None:
    folder = tmp_path / "records"
    folder.mkdir()
    for name in ("a", "b"):
        (folder / f"{name}.txt").write_text(HEAD + HEADING + rows())
    (folder / "c.txt").write_text(HEAD + "% frequency [Hz], power [dBm]\n" + rows())
    tree = import_file(folder, tmp_path / "all.nc")
    assert list(tree.children) == ["a", "b"]
    assert any("c.txt: power against frequency, a spectrum" in r for r in tree.attrs["repairs"])
    with pytest.raises(MeasurementError, match="a spectrum and no ring-down"):
        import_file(folder / "c.txt", tmp_path / "c.nc")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (HEADING + "0.1, -30\n0.2, x3\n0.3, -31\n", "line 14, column 2: 'x3' is not a number"),
        (HEADING + "0.1, -30\n0.2\n0.3, -31\n", "line 14, column 2: 1 numbers for the columns"),
        (HEADING + "0.1, -30\n", "line 13: only 1 rows of data"),
        ("% time [s], power [dBm], odd\n0, 1, 2\n", "line 12, column 3: heading 'odd' is not"),
        (HEADING + "0.1, -30\n0.3, -31\n0.2, -32\n", "line 15: the time goes back from 0.3 to 0.2"),
        ("% time [s], power [W]\n0, 1\n1, 2\n2, 3\n", "power [W]: a ring-down needs power [dB"),
    ],
)
def test_damage_is_named_by_line_and_column(text: str, expected: str, tmp_path: Path) -> None:
    source = tmp_path / "bad.txt"
    source.write_text(HEAD + text)
    with pytest.raises(MeasurementError) as caught:
        import_file(source, tmp_path / "out.nc")
    assert expected in str(caught.value)
    assert str(source) in str(caught.value)


def test_a_head_that_cannot_be_read_is_named_by_its_line(tmp_path: Path) -> None:
    source = tmp_path / "bad.txt"
    source.write_text(HEAD.replace("1000000.0", "fast") + HEADING + rows())
    with pytest.raises(MeasurementError, match="line 4: Frequency"):
        import_file(source, tmp_path / "out.nc")


def test_times_that_rounding_made_equal_are_taken_as_evenly_spaced(tmp_path: Path) -> None:
    source = tmp_path / "r.txt"
    rounded = "".join(f"{0.04 * k:.1f}, {-30 - 0.3 * k:.1f}\n" for k in range(26))
    source.write_text(HEAD + HEADING + rounded)
    tree = import_file(source, tmp_path / "out.nc")
    time = tree["r"].to_dataset()["time"].values
    np.testing.assert_allclose(np.diff(time), time[1] - time[0])
    np.testing.assert_allclose(time, 0.04 * np.arange(26), atol=0.005)
    assert any("taken as an even clock" in line for line in tree.attrs["repairs"])


def test_equal_times_of_no_even_clock_are_not_spread(tmp_path: Path) -> None:
    source = tmp_path / "r.txt"
    times = [0, 1, 1, *range(10, 60)]
    source.write_text(HEAD + HEADING + "".join(f"{t}, {-30 - k}\n" for k, t in enumerate(times)))
    with pytest.raises(MeasurementError, match="time"):
        import_file(source, tmp_path / "out.nc")


def test_what_a_head_does_not_know_is_left_out(tmp_path: Path) -> None:
    source = tmp_path / "r.txt"
    head = HEAD.replace("2e-6", "nan").replace("293.0", "0")
    source.write_text(head + HEADING + rows())
    tree = import_file(source, tmp_path / "out.nc")
    assert {"pressure", "temperature"}.isdisjoint(tree["r"].attrs)
    assert any("temperature is 0, taken as not known" in line for line in tree.attrs["repairs"])


def test_a_table_with_its_toml_becomes_a_decay(tmp_path: Path) -> None:
    table = tmp_path / "trace.csv"
    table.write_text("t,R\n" + rows().replace("-", ""))
    (tmp_path / "trace.toml").write_text(
        'kind = "decay"\n[columns]\ntime = "t"\nmagnitude = { column = "R", unit = "mV" }\n'
        '[values]\nfrequency = "1 MHz"\nnotes = "cold"\n'
    )
    group = import_file(table, tmp_path / "out.nc")["measurement"].to_dataset()
    assert group["magnitude"].values[0] == pytest.approx(0.030)
    assert group.attrs["frequency"] == 1e6
    assert group.attrs["notes"] == "cold"


def test_records_and_folders_are_fitted_without_being_imported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        Path(f"{name}.txt").write_text(HEAD + HEADING + rows())
    assert run(["fit", "a.txt", "--as", "decay", "--json", "--out", "pictures"]) == 0
    found = json.loads(capsys.readouterr().out)["fits"]["a"]
    # 2 dB/s: γ = 2 ln 10/10 per second.
    expected = 2 * np.pi * 1e6 / (0.2 * np.log(10))
    assert found["parameters"]["quality_factor"]["value"] == pytest.approx(expected, rel=1e-3)
    assert [phase["phase"] for phase in found["phases"]] == ["decay"]
    assert Path("pictures/a-a-decay.png").is_file()
    Path("c.txt").write_text(HEAD + "% frequency [Hz], power [dBm]\n" + rows())
    Path("d.txt").write_text(HEAD + HEADING + rows().replace(", -", ", "))
    Path("e.txt").write_text("")
    assert run(["fit", "."]) == 0
    captured = capsys.readouterr()
    assert "2 decays" in captured.out
    assert "c.txt: power against frequency" in captured.err
    assert "d.txt: decay: the power falls nowhere" in captured.err
    assert "e.txt: holds no table" in captured.err
