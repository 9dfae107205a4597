"""`femnl modes`: tolerances, an even film for the holes, and errors of every number."""

import json
from pathlib import Path

import numpy as np
import pytest

from femnl.cli._main import run
from femnl.cli._modes_more import bow_of


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_a_tolerance_holds_for_every_frequency_and_every_number_has_an_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert (
        run(
            [
                "modes",
                "square-270um",
                "--no-bending",
                "-n",
                "3",
                "--tolerance",
                "1e-8",
                "--tensor",
                "--json",
            ]
        )
        == 0
    )
    record = json.loads(capsys.readouterr().out)
    frequency = np.array([mode["frequency"] for mode in record["modes"]])
    assert np.all(np.array(record["errors"]["frequency"]) <= 1e-8 * frequency)
    np.testing.assert_allclose(frequency / frequency[0], np.sqrt([1, 2.5, 2.5]), rtol=2e-8)
    assert set(record["errors"]) == {
        "frequency",
        "ratio",
        "effective_mass",
        "k3",
        "alpha",
        "tensor",
    }
    assert np.shape(record["errors"]["tensor"]) == (3, 3, 3, 3)
    assert all(np.all(np.isfinite(np.array(error))) for error in record["errors"].values())


def test_holes_taken_as_an_even_film_cost_a_second_and_say_so(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["modes", "square-270um-perforated", "-n", "4", "--homogenised"]) == 0
    out = capsys.readouterr().out
    assert "an even film in the place of the holes" in out
    assert "±" not in out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ["--tolerance-of", "all"],
            "femnl: --tolerance-of all: there is no tolerance to reach; give one with --tolerance",
        ),
        (
            ["--tolerance", "1e-6", "--resolution", "2"],
            "femnl: --resolution 2: a tolerance sets the resolution; give one of the two",
        ),
        (
            ["--tolerance", "2"],
            "femnl: tolerance = 2: expected a relative error from 2e-11, where rounding sets "
            "in, to 0.1",
        ),
        (
            ["--homogenised", "--tolerance", "1e-6"],
            "femnl: --homogenised: the even film has a mesh of its own; leave out --tolerance, ",
        ),
        (
            ["--homogenised", "--tolerance-of", "all"],
            "femnl: --homogenised: the even film has a mesh of its own; leave out --tolerance, ",
        ),
        (
            ["--homogenised"],
            "femnl: square-270um: holes: the homogenised film needs a rectangular array of at "
            "least two of them",
        ),
    ],
)
def test_contradictory_wishes_are_one_line(
    words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["modes", "square-270um", *words]) == 2
    assert capsys.readouterr().err.startswith(line)


@pytest.mark.parametrize(
    ("words", "meaning"),
    [("-100 nm", (-1e-7, None)), ("10 kPa", (None, 1e4)), ("1 mbar", (None, 100.0))],
)
def test_a_bow_is_a_depth_or_a_pressure(
    words: str, meaning: tuple[float | None, float | None]
) -> None:
    assert bow_of(words) == pytest.approx(meaning)


def test_inertia_a_bow_and_dilution_are_told_where_asked_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = [
        "modes",
        "square-270um",
        "-n",
        "2",
        "--resolution",
        "0.4",
        "--inertia",
        "--bow",
        "200 nm",
        "--dilution",
        "--tensor",
    ]
    assert run(words) == 0
    out = capsys.readouterr().out
    for title in (
        "With in-plane inertia",
        "by in-plane inertia, %",
        "Bent at rest by 200 nm",
        "Dissipation dilution",
    ):
        assert title in out
    assert run([*words, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    alpha = record["modes"][0]["alpha"]
    k = np.array(record["bow"]["stiffness"])
    assert record["bow"]["k2"][0] / k[0] == pytest.approx(3 * alpha * 200e-9, rel=1e-2)
    assert -2e-3 < record["inertia"]["change"][0] < -5e-4
    assert 140 < record["dilution"]["factor"][0] < 170


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ["--bow", "5 kg"],
            'femnl: --bow "5 kg": expected the depth of the bow, such as "100 nm", or the pressure',
        ),
        (
            ["--bow", "3"],
            'femnl: --bow "3": expected the depth of the bow, such as "100 nm", or the pressure',
        ),
        (["--bow", "1 mm"], "femnl: bow: depth = 0.001 m of a film of 0.00027 m is not shallow"),
        (
            ["--dilution", "--no-bending"],
            "femnl: square-270um: bending = false leaves nothing that loses energy",
        ),
        (
            ["--homogenised", "--inertia"],
            "femnl: --homogenised: the even film tells nothing of --inertia, --bow, --dilution, ",
        ),
    ],
)
def test_bows_and_losses_that_mean_nothing_are_one_line(
    words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        run(
            ["modes", "square-270um", "-n", "2", "--resolution", "0.6", *words]
            if "--homogenised" not in words
            else ["modes", "square-270um", *words]
        )
        == 2
    )
    assert capsys.readouterr().err.startswith(line)


def test_modes_near_a_frequency_have_their_numbers_and_no_ratio(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["modes", "square-270um", "--near", "3.3 MHz", "-n", "3", "--resolution", "0.4"]
    assert run(words) == 0
    out = capsys.readouterr().out
    assert "f/f₁" not in out
    rows = [line.split()[:2] for line in out.splitlines() if line.strip()[:1].isdigit()]
    assert [number for number, _ in rows] == ["4", "5", "6"]
    assert rows[0][1] == "(2,2)"
    assert run([*words, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert [mode["number"] for mode in record["modes"]] == [4, 5, 6]
    assert all(mode["ratio"] is None for mode in record["modes"])


def test_q_is_told_with_its_parts_and_bounds(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["modes", "square-270um", "-n", "1", "--resolution", "0.4", "--q"]
    assert run(words) == 0
    out = capsys.readouterr().out
    # 1/(1/28000 + 1/(β · 183.75 nm)) for β = 6e10, 2e10 and 10e10 per metre
    assert "Q_int = 7910 (3249 … 11094)" in out
    assert run([*words, "--pressure", "1e-3 mbar", "--json"]) == 0
    quality = json.loads(capsys.readouterr().out)["quality"]
    assert quality["low"][0] < quality["total"][0] < quality["high"][0]
    inverse = 1 / (quality["intrinsic"][0] * quality["dilution"][0]) + 1 / quality["gas"][0]
    assert 1 / quality["total"][0] == pytest.approx(inverse, rel=1e-12)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--pressure", "1 Pa"], "femnl: --pressure 1 Pa: gas takes part of Q; ask for it with"),
        (["--q", "--pressure", "-1 Pa"], 'femnl: --pressure "-1 Pa": expected 0 or more'),
        (["--q", "--pressure", "1 kg"], "femnl: --pressure: unit 'kg' is not a unit of this"),
        (["--q", "--no-bending"], "femnl: square-270um: bending = false leaves nothing that"),
        (["--near", "0 Hz"], 'femnl: --near "0 Hz": expected a frequency above 0'),
        (["--near", "soon"], "femnl: --near: 'soon' is not a quantity; give a number in 'Hz'"),
        (["--near", "1 MHz", "--tolerance", "1e-6"], "femnl: --near: no tolerance is reached"),
        (["--homogenised", "--near", "1 MHz"], "femnl: --homogenised: the even film tells nothing"),
    ],
)
def test_targets_and_pressures_that_mean_nothing_are_one_line(
    words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["modes", "square-270um", "-n", "1", *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith(line)
    assert error.count("\n") == 1
