"""Every published case loads, its units are right, and the file that it makes is a measurement."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from femnl import published
from femnl.cli._main import run
from femnl.core import resources
from femnl.core.errors import MeasurementError, ParameterError
from femnl.diagnose import diagnose
from femnl.effects import known
from femnl.io import measurement
from femnl.pipeline import measured_device

PATHS = published.find(resources.published())
CASES = {path.stem: published.load(path) for path in PATHS}
DATA = Path(__file__).parents[3] / "shared" / "data"
INSIDE = [name for name, case in CASES.items() if case.data.columns]
OUTSIDE = [name for name, case in CASES.items() if case.data.file]

# One number of each case in SI, worked out by hand from the source: group, dataset, index, value.
KNOWN = {
    "benade1973_duff_timpano": ("spectrum", "frequency", 1, 196.7232),
    "es2m_softening": ("series", "frequency", 2, 417899.07),
    "heidelberg_reed_temperature": ("series", "temperature", 0, 306.39415487142857728),
    "jones_rubber_drum": ("spectrum", "frequency", 2, 158.0),
    "packaging_curing": ("series", "temperature", 3, 663.15),
    "reid2001_kettledrum": ("spectrum", "frequency", 3, 366.0),
    "reid2001_membrane_in_air": ("spectrum", "frequency", 1, 220.5),
    "rossing1982_timpano_without_bowl": ("spectrum", "frequency", 4, 417.0),
    "sommer2025_hexagon": ("spectrum", "frequency", 9, 4.90871244e6),
    "sommer2025_j10": ("spectrum", "frequency", 1, 2.932369e6),
}
SMALL = """
title = "A series"
citation = "Nobody, Nowhere (1900)"
source = "https://example.org"
place = "table 1"
form = "measured"
device = "a square"
geometry = "square-270um"
[authors]
cause = "gas"
names = ["gas_damping"]
proof = "none"
[data]
kind = "series"
uncertainty = "none"
[data.columns]
pressure = { values = [1, 2, 3, 4], unit = "mbar" }
frequency = { values = [1, 2, 3, 4], unit = "kHz" }
quality_factor = { values = [5, 6, 7, 8] }
frequency_sd = { values = [1, 1, 1, 1], unit = "Hz" }
quality_factor_sd = { values = [1, 1, 1, 1] }
"""
TABLE = """name,date,f_kHz,p_mbar,notes
a,2020-01-02 00:00:10,1.5,1,
b,2020-01-01 00:00:00,9.0,9,
a,2020-01-01 00:00:10,1.25,2,
a,2020-01-01 00:00:20,7.0,3,bad
"""


def written(text: str, folder: Path) -> published.Case:
    """The case of a TOML text."""
    path = folder / "case.toml"
    path.write_text(text, encoding="utf-8")
    return published.load(path)


@pytest.mark.parametrize("name", CASES)
def test_a_case_says_where_its_numbers_stand_and_names_causes_that_exist(name: str) -> None:
    case = CASES[name]
    assert set(case.authors.names) <= set(known(None))
    assert "femnl" not in case.citation.lower()
    assert case.device.strip()
    assert len(case.place.split()) > 3


@pytest.mark.parametrize("name", INSIDE)
def test_the_file_that_a_case_makes_is_a_measurement_of_its_device(
    name: str, tmp_path: Path
) -> None:
    case = CASES[name]
    path = tmp_path / "case.nc"
    measurement.write(published.to_measurement(case), path)
    tree = measurement.read(path)
    assert tree.attrs["repairs"] == ()
    assert case.source in tree.attrs["source"]
    group, dataset, index, value = KNOWN[name]
    data = tree[group].to_dataset()
    assert float(data[dataset].values[index]) == pytest.approx(value, rel=1e-12)
    assert np.isfinite(data["frequency_sd"].values).all()
    assert measured_device(tree.attrs, path, None).film.stress > 0


@pytest.mark.shared
@pytest.mark.skipif(not DATA.is_dir(), reason="the published data are not beside the repository")
@pytest.mark.parametrize("name", OUTSIDE)
def test_published_files_make_a_measurement(name: str, tmp_path: Path) -> None:
    if not (DATA / str(CASES[name].data.file)).exists():
        pytest.skip(f"{CASES[name].data.file} is not beside the repository")
    path = tmp_path / "case.nc"
    measurement.write(published.to_measurement(CASES[name], DATA), path)
    (group,) = measurement.read(path).children.values()
    assert group.attrs["kind"] == CASES[name].data.kind


def test_every_case_inside_has_a_known_number() -> None:
    assert set(INSIDE) == set(KNOWN)


def test_units_and_multiples_become_si(tmp_path: Path) -> None:
    case = written(SMALL, tmp_path)
    dataset = published.to_measurement(case)["series"].to_dataset()
    np.testing.assert_allclose(dataset["pressure"], [100, 200, 300, 400])
    np.testing.assert_allclose(dataset["frequency"], [1e3, 2e3, 3e3, 4e3])
    np.testing.assert_allclose(dataset["quality_factor"], [5, 6, 7, 8])
    multiple = written(SMALL.replace('"kHz"', '"1.5 kHz"'), tmp_path)
    dataset = published.to_measurement(multiple)["series"].to_dataset()
    np.testing.assert_allclose(dataset["frequency"], [1.5e3, 3e3, 4.5e3, 6e3])


def test_a_wrong_unit_is_refused(tmp_path: Path) -> None:
    case = written(SMALL.replace('"mbar"', '"kHz"'), tmp_path)
    with pytest.raises(MeasurementError, match="not a unit of this quantity"):
        published.to_measurement(case)


def test_rows_of_a_table_are_picked_and_put_in_order(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(TABLE, encoding="utf-8")
    head = SMALL.split("[data.columns]")[0]
    rows = """
file = "table.csv"
[data.rows]
date = "date"
[data.rows.where]
name = "a"
notes = ""
[data.rows.columns]
frequency = ["f_kHz", "kHz"]
pressure = ["p_mbar", "mbar"]
[data.rows.constants]
frequency_sd = "2 Hz"
"""
    case = written(head + rows, tmp_path)
    dataset = published.to_measurement(case, tmp_path)["series"].to_dataset()
    np.testing.assert_allclose(dataset["frequency"], [1250, 1500])
    np.testing.assert_allclose(dataset["pressure"], [200, 100])
    np.testing.assert_allclose(dataset["time"], [0, 86400])
    np.testing.assert_allclose(dataset["frequency_sd"], [2, 2])
    with pytest.raises(MeasurementError, match="not in the folder"):
        published.to_measurement(case, tmp_path / "elsewhere")
    lost = written(head + rows.replace('"a"', '"z"'), tmp_path)
    with pytest.raises(MeasurementError, match="no row matches"):
        published.to_measurement(lost, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('form = "measured"', 'form = "guessed"', "form"),
        ("title =", "titel =", "title"),
        ("[data.columns]", 'file = "x.csv"\n[data.columns]', "data"),
        ("https://example.org", "my desk", "source"),
    ],
)
def test_a_case_that_is_not_one_is_refused(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ParameterError, match=message):
        written(SMALL.replace(old, new), tmp_path)


def found(*causes: str, others: tuple[tuple[str, ...], ...] = (), **more: Any) -> Any:
    """What a diagnosis says, as far as a comparison reads it."""
    alternatives = [SimpleNamespace(causes=other) for other in others]
    verdict = "explained" if causes else "unexplained"
    trials = (
        SimpleNamespace(causes=(), chi2=100.0, log_evidence=0.0),
        SimpleNamespace(causes=("doublet",), chi2=50.0, log_evidence=3.0),
        SimpleNamespace(causes=("gas_damping",), chi2=1.0, log_evidence=9.0),
    )
    parts = {
        "verdict": verdict,
        "causes": causes,
        "alternatives": alternatives,
        "trials": trials,
    }
    return SimpleNamespace(**(parts | more))


@pytest.mark.parametrize(
    ("names", "diagnosis", "agreement"),
    [
        (["gas_damping"], found("gas_damping"), "the authors' cause"),
        (
            ["gas_damping"],
            found("gas_damping", "doublet"),
            "the authors' cause and others",
        ),
        (
            ["gas_damping", "gas_loading"],
            found("gas_loading", "doublet"),
            "one of the authors' causes",
        ),
        (["gas_damping"], found("doublet"), "another cause"),
        (
            ["gas_damping"],
            found("doublet", others=(("gas_damping",),), verdict="ambiguous"),
            "among the alternatives",
        ),
        (["gas_damping"], found("doublet", others=(("gas_damping",),)), "another cause"),
        (["gas_damping"], found(others=(("gas_damping",),)), "no cause"),
        (["gas_damping"], found(), "no cause"),
        (["gas_damping"], found(verdict="adequate"), "no cause"),
        ([], found(verdict="adequate"), "no cause, as the authors"),
        ([], found(), "no cause"),
        ([], found("doublet"), "another cause"),
    ],
)
def test_a_diagnosis_is_held_against_the_authors(
    names: list[str], diagnosis: Any, agreement: str, tmp_path: Path
) -> None:
    text = SMALL.replace('["gas_damping"]', json.dumps(names))
    assert published.compare(written(text, tmp_path), diagnosis) == agreement


def in_gas() -> str:
    """A case in which molecules damp the film: 1/Q = 1e-6 + p/(2400 mbar), with 1 % of noise.

    For 92 nm of silicon nitride at 1.47 MHz, Q = (π/2)^(3/2) ρ h f √(RT/M)/p is about 2400 mbar/p.
    """
    rng = np.random.default_rng(1)
    pressure = np.geomspace(0.01, 10, 12)
    quality = 1 / (1e-6 + pressure / 2400)
    columns = {
        "pressure": (pressure, "mbar"),
        "frequency": (1400 + 5e-4 * rng.standard_normal(12), "kHz"),
        "quality_factor": (quality * (1 + 0.01 * rng.standard_normal(12)), ""),
        "frequency_sd": (np.full(12, 0.5), "Hz"),
        "quality_factor_sd": (0.01 * quality, ""),
    }
    rows = [
        f"{name} = {{ values = {values.tolist()}, unit = {json.dumps(unit)} }}"
        if unit
        else f"{name} = {{ values = {values.tolist()} }}"
        for name, (values, unit) in columns.items()
    ]
    return "\n".join([SMALL.split("[data.columns]")[0] + "[data.columns]", *rows])


def test_a_run_tells_what_it_found_what_was_refused_and_what_is_not_there(tmp_path: Path) -> None:
    written(in_gas(), tmp_path)
    (tmp_path / "far.toml").write_text(
        SMALL.split("[data.columns]")[0] + 'file = "far.csv"\n[data.spec]\nkind = "series"\n',
        encoding="utf-8",
    )
    near, far = published.run(tmp_path, data=tmp_path)
    assert (near.agreement, near.verdict) == ("the authors' cause", "explained")
    assert near.shares is not None
    assert near.shares.keys() == {"gas_damping"}
    assert near.shares["gas_damping"] == pytest.approx(1, abs=0.01)
    assert near.leading == ("gas_damping",)
    assert near.taken == pytest.approx(1, abs=1e-3)
    assert far.agreement == "no data"
    json.dumps(published.record(near))
    assert published.render([near, far]).row_count == 2
    written(SMALL.replace("[5, 6, 7, 8]", "[5, -6, 7, 8]"), tmp_path)
    (case,) = published.run(tmp_path, ["case"])
    assert case.agreement == "refused"
    assert "quality_factor: value -6 is not positive" in case.message
    with pytest.raises(ParameterError, match="no published case is named"):
        published.find(tmp_path, ["nothing"])


def test_the_command_line_tells_of_data_that_are_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["validate", "--published", "qpit_1243_drift", "--data", str(tmp_path)]
    assert run([*words, "--json"]) == 0
    (case,) = json.loads(capsys.readouterr().out)["cases"]
    assert case["agreement"] == "no data"
    assert run(words) == 0
    assert "frequency_drift" in capsys.readouterr().out


def test_the_diagnosis_of_today_can_be_compared(tmp_path: Path) -> None:
    case = written(SMALL, tmp_path)
    path = tmp_path / "case.nc"
    measurement.write(published.to_measurement(case), path)
    assert published.compare(case, diagnose(path)) in (
        "the authors' cause",
        "the authors' cause and others",
        "among the alternatives",
        "another cause",
        "no cause",
    )
