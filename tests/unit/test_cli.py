"""The command line as a user meets it.

What it prints, what it writes, and one line for every wrong request.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.special import jv

from femnl.cli._main import run
from femnl.io import measurement


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def lines(capsys: pytest.CaptureFixture[str]) -> tuple[str, list[str]]:
    """What went to standard output, and the lines of standard error."""
    captured = capsys.readouterr()
    return captured.out, captured.err.splitlines()


def test_help_lists_every_command_with_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    out, _ = lines(capsys)
    for command in ("geometries", "maps", "mesh", "modes", "validate"):
        assert f"\n  {command} " in out
    assert "..." not in out.split("Options:")[1], "a line is cut off"


@pytest.mark.parametrize("group", ["geometry", "cache"])
def test_a_group_of_commands_shows_what_it_has(
    group: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([group]) == 0
    out, err = lines(capsys)
    assert not err
    assert "Commands:" in out


def test_geometries_lists_what_ships(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["geometries", "--json"]) == 0
    names = {entry["name"] for entry in json.loads(lines(capsys)[0])["geometries"]}
    assert {
        "square-270um",
        "square-270um-perforated",
        "square-270um-etched",
        "hexagon-278um",
        "circle",
        "trampoline",
    } <= names


def test_modes_prints_one_json_object_in_si_and_nothing_else(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert (
        run(["modes", "square-270um", "--count", "4", "--no-bending", "--edge", "paper", "--json"])
        == 0
    )
    out, err = lines(capsys)
    assert not err
    record = json.loads(out)
    assert record["geometry"] == "square-270um"
    assert [mode["label"] for mode in record["modes"]] == ["(1,1)", "(2,1)", "(1,2)", "(2,2)"]
    first = record["modes"][0]
    speed = np.sqrt(1101.5e6 / 3100)
    assert first["frequency"] == pytest.approx(speed / np.sqrt(2) / 270e-6, rel=1e-8)
    assert first["effective_mass"] == pytest.approx(3100 * 183.75e-9 * 270e-6**2 / 4, rel=1e-6)
    assert first["alpha"] == pytest.approx(
        3 * np.pi**2 / 16 * 250e9 / 1101.5e6 / 270e-6**2, rel=1e-5
    )
    assert first["k3"] == pytest.approx(
        first["alpha"] * first["effective_mass"] * (2 * np.pi * first["frequency"]) ** 2, rel=1e-12
    )
    ideal = np.sqrt([1, 2.5, 2.5, 4])
    ratios = np.array([mode["ratio"] for mode in record["modes"]])
    assert np.all(np.abs(ratios - ideal) <= np.array(record["errors"]["ratio"]) + 1e-15)
    assert len(record["errors"]["alpha"]) == 4


def test_modes_prints_a_table_and_writes_files_that_others_open(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run(["modes", "rectangle", "--count", "3", "--tensor", "--out", "modes.nc"]) == 0
    out, err = lines(capsys)
    assert "(1,1)" in out
    assert "Cubic force" in out
    assert err == ["wrote modes.nc"]
    with xr.open_dataset(tmp_path / "modes.nc", group="modes", engine="h5netcdf") as stored:
        assert stored.frequency.shape == (3,)
    assert run(["modes", "rectangle", "--count", "3", "--out", "modes.vtu"]) == 0
    assert (tmp_path / "modes.vtu").stat().st_size > 10_000


def test_maps_writes_a_measurement_file_and_a_figure(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    words = [
        "maps",
        "hexagon-278um",
        "--mode",
        "1",
        "--z",
        "4.218",
        "--wavelength",
        "632.8 nm",
        "--harmonics",
        "6",
        "--points",
        "41",
    ]
    assert run(words) == 0
    _, err = lines(capsys)
    assert err == ["wrote hexagon-278um-mode-1-maps.nc and hexagon-278um-mode-1-maps.png"]
    tree = measurement.read(tmp_path / "hexagon-278um-mode-1-maps.nc")
    maps = tree["map"].to_dataset()
    assert tree.attrs["geometry"] == "hexagon-278um"
    assert maps["real"].shape == (6, 41, 41)
    assert maps.attrs["wavelength"] == pytest.approx(632.8e-9)
    # At the antinode J_n(z) gives |V_n| = 2 V_C |sin θ or cos θ| J_n(4.218); there J_1 has changed
    # sign against its rim.
    centre = maps["real"].values[:, 20, 20]
    expected = 2 * np.sqrt(0.5) * np.abs(jv(np.arange(1, 7), 4.218))
    np.testing.assert_allclose(np.abs(centre), expected, rtol=1e-6)
    assert (tmp_path / "hexagon-278um-mode-1-maps.png").stat().st_size > 20_000


def test_mesh_tells_what_it_made(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["mesh", "hexagon-278um", "--symmetry", "twelfth", "--json"]) == 0
    record = json.loads(lines(capsys)[0])
    assert record["copies"] == 12
    assert set(record["boundaries"]) == {"clamped", "mirror-0", "mirror-1"}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ["modes", "square-270"],
            "femnl: square-270: neither a shipped geometry nor a file; did you mean square-270um?",
        ),
        (
            ["modes", "circle", "--edge", "hinged"],
            "femnl: --edge hinged: expected one of clamped, sliding, paper",
        ),
        (
            ["modes", "circle", "--out", "x.xyz"],
            "femnl: --out x.xyz: expected a name that ends in .nc or .vtu",
        ),
        (
            ["modes", "circle", "--resolution", "0"],
            "femnl: resolution = 0: expected a number from 0.1 to 20",
        ),
        (
            ["modes", "circle", "--resolution", "nan"],
            "femnl: resolution = nan: expected a number from 0.1 to 20",
        ),
        (
            ["modes", "rectangle", "--symmetry", "eighth"],
            'femnl: symmetry = "eighth": outline and holes of rectangle do not have it; use '
            "auto or full",
        ),
        (
            ["modes", "rectangle", "--symmetry", "x"],
            'femnl: symmetry = "x": expected auto, full, half, quarter, eighth, twelfth',
        ),
        (
            ["maps", "circle", "--z", "-1"],
            "femnl: --z -1: expected a positive modulation up to 1000, such as 4.218",
        ),
        (
            ["maps", "circle", "--z", "nan"],
            "femnl: --z nan: expected a positive modulation up to 1000, such as 4.218",
        ),
        (
            ["maps", "circle", "--z", "2", "--mode", "0"],
            "femnl: --mode 0: modes are counted from 1",
        ),
        (
            ["maps", "circle", "--z", "2", "--fringe", "x"],
            "femnl: --fringe x: expected sine or multilayer",
        ),
        (
            ["maps", "circle", "--z", "2", "--noise", "0 V"],
            'femnl: --noise "0 V": expected a positive voltage; write "0.3 mV"',
        ),
        (["mod"], "femnl: No such command 'mod'. Did you mean 'modes'?"),
    ],
)
def test_a_wrong_request_is_one_line_and_status_2(
    words: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(words) == 2
    out, err = lines(capsys)
    assert err == [expected]
    assert not out


@pytest.mark.parametrize("wavelength", ["633", "633 kg", "-633 nm", "red"])
def test_a_wrong_wavelength_is_one_line_that_names_it(
    wavelength: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["maps", "circle", "--z", "2", "--wavelength", wavelength]) == 2
    out, (line,) = lines(capsys)
    assert "wavelength" in line
    assert wavelength.split()[0].lstrip("-") in line
    assert not out


def test_a_folder_that_does_not_exist_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["modes", "circle", "--count", "1", "--json", "--out", "none/x.nc"]) == 2
    _, (line,) = lines(capsys)
    assert line.startswith("femnl: none/x.nc: cannot write there")


def simulated_response(path: Path) -> None:
    """A linear resonator at 1 MHz, Q = 1e4, and a trace that is no response, in one file."""
    rng = np.random.default_rng(5)
    frequency = np.linspace(0.9998e6, 1.0002e6, 201)
    volts = 0.1 * 50 / (1e6 - frequency + 50j) + 1e-4 * (
        rng.normal(size=201) + 1j * rng.normal(size=201)
    )
    data = measurement.response(
        frequency[None], volts[None], drive=[1.0], direction=[1], noise_sd=1e-4
    )
    measurement.write(measurement.bundle({"sweep": data}, geometry="square-270um"), path)


def test_fit_reports_the_parameters_of_a_response(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    simulated_response(tmp_path / "r.nc")
    assert run(["fit", "r.nc", "--json"]) == 0
    found = json.loads(lines(capsys)[0])["fits"]["sweep"]
    frequency = found["parameters"]["frequency"]
    width = found["parameters"]["linewidth"]
    assert abs(frequency["value"] - 1e6) < 4 * frequency["sd"]
    assert abs(width["value"] - 100) < 4 * width["sd"]
    assert found["chi2_reduced"] == pytest.approx(1, abs=0.3)
    assert run(["fit", "r.nc"]) == 0
    assert "linewidth" in lines(capsys)[0]


def test_fit_finds_the_amplitude_of_maps_that_femnl_predicted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["maps", "square-270um", "--z", "5", "--points", "31", "--out", "m.nc"]) == 0
    assert run(["fit", "m.nc", "--json"]) == 0
    found = json.loads(lines(capsys)[0])["fits"]["map"]["parameters"]
    assert found["amplitude"]["value"] == pytest.approx(5 * 632.8e-9 / (4 * np.pi), rel=1e-4)
    assert abs(np.sin(found["fringe_phase"]["value"])) == pytest.approx(np.sqrt(0.5), rel=1e-3)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["fit", "none.nc"], "femnl: none.nc: no such file; check the path"),
        (
            ["fit", "r.nc", "--use", "everything"],
            "femnl: --use everything: expected one of complex, magnitude, phase, phase-mod-pi",
        ),
    ],
)
def test_a_wrong_fit_is_one_line(
    words: list[str], expected: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    simulated_response(tmp_path / "r.nc")
    assert run(words) == 2
    assert lines(capsys)[1] == [expected]


def test_show_prints_what_a_file_holds_and_draws_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    simulated_response(tmp_path / "r.nc")
    assert run(["show", "r.nc", "--out", "pictures"]) == 0
    out, err = lines(capsys)
    assert "1 sweep × 201 point" in out
    assert "noise_sd" in out
    assert err == ["wrote pictures/r-sweep.png"]
    assert (tmp_path / "pictures" / "r-sweep.png").stat().st_size > 10_000


def test_import_turns_a_text_table_into_a_measurement_file(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "scope.csv").write_text(
        "V1,V2\n" + "".join(f"{np.sin(k / 5):.6f},{np.cos(k / 5):.6f}\n" for k in range(200))
    )
    (tmp_path / "scope.toml").write_text(
        'kind = "trace"\n[columns]\nvoltage = { column = "V2", unit = "mV" }\ndrive_voltage = '
        '"V1"\ntime = { rate = "1 '
        'kHz" }\n'
    )
    assert run(["import", "scope.csv", "scope.nc"]) == 0
    assert lines(capsys)[1][-1] == "wrote scope.nc"
    trace = measurement.read(tmp_path / "scope.nc")["measurement"].to_dataset()
    assert trace["voltage"].values[0, 0] == pytest.approx(1e-3)
    assert trace["time"].values[1] == pytest.approx(1e-3)
    assert run(["import", "none.csv", "x.nc"]) == 2
    assert lines(capsys)[1] == ["femnl: none.csv: no such file; check the path"]


def test_import_without_a_destination_says_what_is_missing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["import", "scope.csv"]) == 2
    told = "femnl: scope.csv alone: name the measurement file to write last, such as scope.nc"
    assert lines(capsys)[1] == [told]
