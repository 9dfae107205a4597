"""Studies of a chip: tables, devices, what is refused, and what a user sees."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri

from femnl.chip import fit_chip, read_chip
from femnl.chip.fit import entries_of
from femnl.chip.readings import median_of
from femnl.chip.words import common, deviating
from femnl.cli._main import run
from femnl.core.errors import FemnlError, ParameterError
from femnl.io import measurement

SEED = 20261124
DATA = Path(__file__).parents[3] / "shared" / "data"


STUDY = """
name = "chip"
[table]
file = "table.csv"
chip = "A-"
[positions]
pattern = "(?P<y>[0-9])(?P<x>[0-9])"
pitch = "2 mm"
"""
HEAD = "device,mode,frequency,quality_factor\n"


@pytest.mark.parametrize("count", [1, 2, 25])
def test_repeats_count_by_their_median_with_the_error_of_a_median(count: int) -> None:
    """Against 2000 draws of normal readings, one of which is stated with half of their scatter."""
    rng = np.random.default_rng(SEED)
    draws = 1e6 + rng.normal(0, 10.0, (2000, count))
    numbers = [median_of([(float(value), 5.0) for value in row]) for row in draws]
    assert [n.value for n in numbers] == pytest.approx(np.median(draws, axis=1))
    assert {n.repeats for n in numbers} == {count}
    told = float(np.sqrt(np.mean([n.sd**2 for n in numbers])))
    true = float(np.std(np.median(draws, axis=1)))
    # One reading has no scatter, so what is stated counts
    assert told == pytest.approx(5.0 if count == 1 else true, rel=0.1)


def test_one_wrong_reading_of_five_does_not_move_a_number() -> None:
    found = median_of([(v, 0.0) for v in (100.0, 101.0, 102.0, 103.0, 1e6)])
    assert found.value == 102.0
    # Of normal numbers, half deviate from the median by less than their quartile
    assert found.sd == pytest.approx(np.sqrt(np.pi / 10) / ndtri(0.75))


def device(frequency: str = "1e6") -> str:
    """Return a [[device]] table for one device of one mode."""
    return f"\n[[device]]\nname = '51'\nmodes = [{{frequency = {frequency}}}]\n"


def study(folder: Path, text: str = STUDY, rows: str | None = None) -> Path:
    """Write a study with a table of twelve devices in a plane."""
    if rows is None:
        rng = np.random.default_rng(SEED)
        rows = HEAD + "".join(
            f"A-{y}{x},1,{1e6 * np.exp(4e-3 * x + rng.normal(0, 5e-4)):.2f},{rng.uniform(1, 2)}e6\n"
            for x in range(1, 5)
            for y in range(1, 4)
        )
    (folder / "table.csv").write_text(rows, encoding="utf-8")
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_head_with_a_unit_is_that_of_its_column(tmp_path: Path) -> None:
    rows = "device,mode,frequency_kHz,x [mm],y [mm]\n"
    rows += "".join(f"A-{k},1,{1000 + k},{k},0\n" for k in range(1, 7))
    text = STUDY.partition("[positions]")[0]
    text += '[table.columns]\nfrequency = "frequency_kHz"\nx = "x [mm]"\ny = "y [mm]"\n'
    first = read_chip(study(tmp_path, text, rows)).members[0]
    assert first.frequency["1"].value == pytest.approx(1.001e6)
    assert first.place == pytest.approx((1e-3, 0))


def test_a_head_with_a_unit_that_is_not_known_is_refused(tmp_path: Path) -> None:
    rows = "device,mode,f (khz)\n" + "".join(f"A-{k},1,{1000 + k}\n" for k in range(1, 7))
    text = STUDY.partition("[positions]")[0] + '[table.columns]\nfrequency = "f (khz)"\n'
    with pytest.raises(ParameterError, match=r"'f \(khz\)' states 'khz', which is no unit of Hz"):
        read_chip(study(tmp_path, text, rows))


def test_a_table_of_a_chip_gives_its_gradient_per_metre(tmp_path: Path) -> None:
    fit = fit_chip(read_chip(study(tmp_path)))
    assert fit.frequency.fields["plane"] > 0.8
    assert fit.frequency.slope is not None
    x, y = fit.frequency.slope
    assert x.value == pytest.approx(2.0, abs=3 * x.sd)
    assert abs(y.value) < 3 * y.sd
    assert fit.frequency.left_out.error < 0.5 * fit.frequency.left_out.plain_error
    assert "none is stated" in fit.notes[0]


def test_the_command_writes_a_page_numbers_and_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run(["chip", str(study(tmp_path)), "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert "slope along x" in printed.out
    assert "% by the mean of its design" in printed.err
    numbers = json.loads((out / "chip.json").read_text(encoding="utf-8"))
    assert numbers["femnl_chip"] == "1.0"
    assert len(numbers["frequency"]["devices"]) == 12
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "% a mm" in page
    assert "data:image/webp" in page
    assert "&lt; 0.1 %" in page
    with (out / "devices.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 24
    first = next(r for r in rows if (r["quantity"], r["device"]) == ("frequency", "31"))
    told = next(d for d in numbers["frequency"]["devices"] if d["device"] == "31")
    measured = (tmp_path / "table.csv").read_text(encoding="utf-8").split("A-31,1,")[1]
    assert float(first["value"]) == pytest.approx(float(measured.split(",")[0]))
    # 31: row 3, column 1 of a grid of 2 mm
    assert (float(first["x"]), float(first["y"])) == pytest.approx((2e-3, 6e-3))
    part = np.log(float(first["value"]) / float(first["predicted"]))
    assert float(first["log_ratio"]) == pytest.approx(part)
    assert float(first["sigma"]) == pytest.approx(part / float(first["sd"]))
    assert {key: first[key] for key in ("mode", "design")} == {"mode": "1", "design": "1"}
    assert float(first["sd"]) == told["sd"]


@pytest.mark.parametrize(
    ("text", "rows", "words"),
    [
        (STUDY.replace("[table]", "[tabel]"), None, "tabel: unknown key, did you mean table?"),
        (STUDY.replace('"A-"', '"B-"'), None, "0 devices; a chip has 4 to 2000"),
        (STUDY.replace("<x>", "<z>"), None, "it needs the groups"),
        (STUDY.replace("[0-9])(", "[a-z])("), None, "'11' does not match it"),
        (STUDY.replace("[0-9])(", "[7-9])?("), None, "device 11: y: '' is no finite number"),
        (STUDY + device() + "design = 'a'", None, "has no design; give one for every device"),
        (STUDY, "device,f\nA-11,1e6\n", "no column 'frequency'; it has device, f"),
        (STUDY, HEAD + "A-11,1,zero,1e6\n", "line 2: frequency: 'zero' is no finite number"),
        (STUDY, HEAD + "A-11,1,1e6,1e6\nA-12,1,-1e6,1e6\n", "line 3: frequency: -1e+06 is not"),
        (STUDY + "\n[design.a]\ngeometry = 'circle'", None, "no device is of this design"),
        ("name = 'x'\nname = 'y'", None, "is no TOML"),
        (STUDY + "\n[[device]]\nname = '11'\nposition = ['1 s', '2 m']", None, "position"),
        (STUDY.replace("2 mm", "2 km"), None, "is farther out than 1 m"),
        ("name = 'x'", None, "has no devices; add [table] or [[device]]"),
        (STUDY + 2 * device(), None, "two [[device]] tables have the name '51'"),
        (STUDY + device("nan"), None, "device.0.modes.0.frequency: nan is no finite number"),
        (STUDY + device("'nan Hz'"), None, "device 51: frequency: 'nan Hz' is not a quantity"),
        (STUDY + device("1e6, frequency_sd = -1.0"), None, "frequency_sd: -1 Hz is below zero"),
        (
            STUDY + device("1e6, quality_factor = 1e6, quality_factor_sd = -1.0"),
            None,
            "quality_factor_sd: it is below zero",
        ),
        (STUDY + device("1e31"), None, "frequency: value 1e+31 is beyond any measurement"),
        (
            STUDY + device("1e6, quality_factor = 1e300"),
            None,
            "quality_factor: value 1e+300 is beyond any measurement",
        ),
        (STUDY, HEAD + "A-11,1,1e-300,1e6\n", "line 2: frequency: value 1e-300 is beyond any"),
        (STUDY, "device,frequency,frequency\nA-11,1e6,2e6\n", "two columns 'frequency'"),
        (
            STUDY,
            "device,frequency,design\nA-11,1e6,small\nA-11,2e6,large\n",
            "device A-11 is of the design 'large' here, and of 'small' above",
        ),
        (STUDY, HEAD + "A-11,1,1e6\n", "line 2: has not as many fields as the head (4)"),
        (STUDY, HEAD + "A-11,1,1e6,1e6,1\n", "line 2: has not as many fields as the head (4)"),
    ],
)
def test_a_study_that_cannot_be_used_gets_one_line(
    text: str, rows: str | None, words: str, tmp_path: Path
) -> None:
    with pytest.raises(FemnlError) as error:
        read_chip(study(tmp_path, text, rows))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("none.csv", "none.csv: cannot be read (No such file or directory); check table.file"),
        (".", "cannot be read (not a regular file); check table.file"),
        ("/dev/zero", "/dev/zero: cannot be read (not a regular file); check table.file"),
        ("vast.csv", "vast.csv: is no table of text (16 MiB, and such a file has at most 16)"),
        ("bytes.csv", "bytes.csv: is no table of text ('utf-8' codec can't decode"),
    ],
)
def test_a_table_that_is_no_file_of_text_gets_one_line(
    place: str, words: str, tmp_path: Path
) -> None:
    (tmp_path / "bytes.csv").write_bytes(b"device,frequency\n\xff,1\n")
    with (tmp_path / "vast.csv").open("wb") as file:
        file.truncate(2**24 + 1)
    with pytest.raises(ParameterError) as error:
        read_chip(study(tmp_path, STUDY.replace("table.csv", place)))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_geometry_gets_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["name = 'c'", "[design.a]", "geometry = 'nosuch'"]
    lines += [
        f"[[device]]\nname = '{k}'\ndesign = 'a'\nmodes = [{{frequency = 1.0{k}e6}}]"
        for k in range(5)
    ]
    path = tmp_path / "study.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert run(["chip", str(path)]) != 0
    told = capsys.readouterr().err.strip()
    assert "nosuch: neither a shipped geometry nor a file" in told
    assert "Traceback" not in told


def test_errors_of_quality_factors_are_read_and_counted(tmp_path: Path) -> None:
    head = "device,design,frequency,quality_factor,quality_factor_sd\n"
    rows = head + "".join(f"A-1{k},a,1e6,2e6,4e4\n" for k in range(4))
    more = "\n[[device]]\nname = '14'\ndesign = 'a'\nmodes = [{frequency = 1e6, "
    more += "quality_factor = 1e6, quality_factor_sd = 5e4}]\n"
    chip = read_chip(study(tmp_path, STUDY + more, rows))
    assert [m.quality["1"].sd for m in chip.members] == [4e4] * 4 + [5e4]
    sd = entries_of(chip, {m.name: m.quality for m in chip.members}).values.sd
    # Of the logarithm
    assert sd == pytest.approx([0.02] * 4 + [0.05])


def test_a_device_adds_to_its_row_of_the_table(tmp_path: Path) -> None:
    rows = "device,design,frequency\n" + "".join(f"A-1{k},a,1e6\n" for k in range(4))
    more = "\n[[device]]\nname = '13'\nmodes = [{mode = '2', frequency = 2e6}]\n"
    members = read_chip(study(tmp_path, STUDY + more, rows)).members
    assert [m.design for m in members] == ["a"] * 4
    assert set(members[3].frequency) == {"1", "2"}


@pytest.mark.skipif(not DATA.exists(), reason="../shared/data is not there")
def test_a_real_chip_with_a_gradient_is_predicted_better_than_by_its_mean(tmp_path: Path) -> None:
    """PSE2-41, 16 membranes on a grid of 4 × 4 (qpit/Ringdown-Processor)."""
    text = STUDY.replace("table.csv", str(DATA / "decays.csv")).replace("A-", "PSE2-41-")
    columns = '[table.columns]\ndevice = "sample"\nfrequency = "frequency_Hz"\n'
    path = tmp_path / "study.toml"
    path.write_text(text.replace("[positions]", f"{columns}[positions]"), encoding="utf-8")
    fit = fit_chip(read_chip(path))
    assert fit.frequency.varies > 0.999
    assert fit.frequency.left_out.error < 0.25 * fit.frequency.left_out.plain_error


def test_a_file_gives_the_modes_of_a_device_by_spectrum_response_and_decay(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(SEED)
    f = np.linspace(0.9999e6, 1.0001e6, 81)
    # Q = 50 000 at 1 MHz
    clean = 1e6 * 20.0 / (1e12 - f**2 + 20j * f) * 1e-3
    volts = clean + 1e-6 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    time = np.linspace(0, 2, 400)
    # A decay of 60 dB in a second: γ = 6 ln 10 in energy
    power = 10 * np.log10(1e-4 * np.exp(-6 * np.log(10) * time) + 1e-9)
    groups = {
        "spectrum": measurement.spectrum([1.5e6, 2.0e6], [5.0, 5.0], label=["1,1", "2,2"]),
        "response": measurement.response(
            f[None], volts[None], drive=[1.0], noise_sd=1e-6, mode="a"
        ),
        "decay": measurement.decay(
            time=time,
            power=power + 0.1 * rng.standard_normal(time.size),
            attributes={"mode": "b", "frequency": 1e6},
        ),
    }
    path = study(tmp_path)
    measurement.write(measurement.bundle(groups), tmp_path / "m.nc")
    path.write_text(STUDY + "\n[[device]]\nname = '44'\nmeasurement = 'm.nc'\n", encoding="utf-8")
    found = next(m for m in read_chip(path).members if m.name == "44")
    assert set(found.frequency) == {"1,1", "2,2", "a", "b"}
    assert found.frequency["a"].value == pytest.approx(1e6, abs=1)
    assert found.quality["a"].value == pytest.approx(5e4, rel=0.01)
    assert found.quality["b"].value == pytest.approx(2e6 * np.pi / (6 * np.log(10)), rel=0.02)


def test_a_row_of_devices_tells_no_slope_across(tmp_path: Path) -> None:
    rng = np.random.default_rng(SEED)
    rows = "device,mode,frequency,x [mm],y [mm]\n"
    rows += "".join(
        f"A-{k},1,{1e6 * (1 + 1e-3 * k + rng.normal(0, 1e-5)):.3f},{k},0\n" for k in range(1, 15)
    )
    text = STUDY.partition("[positions]")[0]
    text += '[table.columns]\nx = "x [mm]"\ny = "y [mm]"\n'
    fit = fit_chip(read_chip(study(tmp_path, text, rows)))
    told = dict(common(fit.frequency, fit))
    assert told["slope along y"] == "not told, as all devices have the same y"
    assert told["slope along x"].startswith("0.099")
    value, predicted = (float(text.split()[0]) for text in deviating(fit.frequency)[0][3:5])
    assert value == pytest.approx(predicted, rel=1e-4)
    assert value != predicted
