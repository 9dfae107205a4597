"""`femnl fit` of sweeps and series from the command line: --each-sweep, --modes, --law."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.cli._main import run
from femnl.io import measurement

BOLTZMANN = 1.380649e-23
"""Boltzmann constant [J/K], exact in the SI."""
F0 = 1e5
"""Resonance [Hz] at a temperature of 0."""
FALL = 2.0
"""By how much it falls per kelvin [Hz/K]."""
WIDTH = 10.0
"""Linewidth [Hz]."""
NOISE = 2e-3
"""Of each quadrature, where the peak is 1 V."""
TEMPERATURE = np.array([4.0, 5.0, 6.0, 8.0, 10.0])


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def fit(capsys: pytest.CaptureFixture[str]) -> Callable[..., dict[str, Any]]:
    """Run `femnl fit … --json`; the fits of the file by name."""

    def call(*words: str) -> dict[str, Any]:
        capsys.readouterr()
        assert run(["fit", *words, "--json"]) == 0, capsys.readouterr().err
        return dict(json.loads(capsys.readouterr().out)["fits"])

    return call


def line(f: NDArray[np.float64], f0: float, w: float) -> NDArray[np.complex128]:
    """Return the closed form of the linear oscillator, −i on resonance."""
    return np.asarray(f0 * w / ((f0 - f) * (f0 + f) + 1j * f * w))


def noise(shape: tuple[int, ...], seed: int) -> NDArray[np.complex128]:
    rng = np.random.default_rng(seed)
    return np.asarray(NOISE * (rng.normal(size=shape) + 1j * rng.normal(size=shape)))


def warming(path: str) -> None:
    """Write sweeps of one linear line that falls with temperature."""
    f = np.linspace(F0 - 70, F0 + 40, 121)
    volts = np.array([line(f, F0 - FALL * t, WIDTH) for t in TEMPERATURE])
    volts = volts + noise(volts.shape, 21)
    sweeps = measurement.response(
        f, volts, drive=np.ones(5), temperature=TEMPERATURE, noise_sd=NOISE
    )
    measurement.write(measurement.bundle({"cold": sweeps}), path)


def test_each_sweep_is_fitted_and_its_series_has_the_slope_of_a_line(
    fit: Callable[..., dict[str, Any]],
) -> None:
    warming("w.nc")
    sweeps = fit("w.nc", "--each-sweep", "s.nc", "--linear", "--background", "constant")["cold"][
        "sweeps"
    ]
    for one, t in zip(sweeps, TEMPERATURE, strict=True):
        found = one["parameters"]["frequency"]
        assert abs(found["value"] - (F0 - FALL * t)) < 4 * found["sd"]
        # What was asked for reaches the fit of every sweep
        assert (one["model"]["duffing"], one["model"]["background"]) == (False, "constant")
    law = fit("s.nc", "--law", "line", "--out", "o")["cold, frequency"]
    slope = law["parameters"]["slope"]
    assert slope["unit"] == "Hz/K"
    assert abs(slope["value"] + FALL) < 4 * slope["sd"]
    low, high = law["interval_95"]["slope"]
    assert low < slope["value"] < high
    assert {file.name for file in Path("o").iterdir()} == {
        "s-cold-frequency-line.png",
        "s-cold-quality-factor-line.png",
    }


def test_two_modes_are_fitted_to_every_sweep(fit: Callable[..., dict[str, Any]]) -> None:
    f = np.linspace(F0 - 60, F0 + 60, 241)
    volts = line(f, F0 - 12, WIDTH) + 0.7j * line(f, F0 + 9, 6.0) + 0.1
    volts = volts + noise((2, 241), 22)
    data = measurement.response(f, volts, drive=np.ones(2), noise_sd=NOISE)
    measurement.write(measurement.bundle({"pair": data}), "p.nc")
    found = fit("p.nc", "--modes", "2", "--out", "o")
    assert set(found) == {"pair, sweep 1", "pair, sweep 2"}
    for one in found.values():
        for name, truth in (
            ("frequency[1]", F0 - 12),
            ("frequency[2]", F0 + 9),
            ("linewidth[1]", WIDTH),
            ("linewidth[2]", 6.0),
        ):
            value = one["parameters"][name]
            assert abs(value["value"] - truth) < 5 * value["sd"]
    assert {file.name for file in Path("o").iterdir()} == {
        "p-pair-sweep-1-modes.png",
        "p-pair-sweep-2-modes.png",
    }


def test_power_and_arrhenius_laws_are_chosen_by_their_names(
    fit: Callable[..., dict[str, Any]],
) -> None:
    rng = np.random.default_rng(23)
    pressure = np.geomspace(1, 1000, 12)
    quality = 1e4 * pressure**-0.5 * (1 + 0.01 * rng.normal(size=12))
    measurement.write(
        measurement.bundle(
            {"gas": measurement.series({"pressure": pressure}, quality_factor=quality)}
        ),
        "g.nc",
    )
    power = fit("g.nc", "--law", "power")["gas, quality factor"]["parameters"]["exponent"]
    assert abs(power["value"] + 0.5) < 4 * power["sd"]
    kelvin = np.linspace(100, 300, 12)
    energy = 8e-21
    quality = 1e5 * np.exp(energy / (BOLTZMANN * kelvin)) * (1 + 0.01 * rng.normal(size=12))
    measurement.write(
        measurement.bundle(
            {"film": measurement.series({"temperature": kelvin}, quality_factor=quality)}
        ),
        "t.nc",
    )
    law = fit("t.nc", "--law", "arrhenius")["film, quality factor"]
    found = law["parameters"]["activation_energy"]
    assert found["unit"] == "J"
    # Q = A exp(−E/(k_B T)): a quality factor that falls as it warms has a negative E
    assert abs(found["value"] + energy) < 4 * found["sd"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ["w.nc", "--law", "cubic"],
            "--law cubic: expected one of line, power, arrhenius",
        ),
        (
            ["w.nc", "--fix", "linewidth"],
            "--fix linewidth: expected NAME=VALUE in SI units or with its unit, such as "
            'linewidth=66.7 or linewidth="66.7 Hz"',
        ),
        (
            ["w.nc", "--law", "power"],
            "--law: is for series, and has no effect on response",
        ),
        (
            ["w.nc", "--modes", "9"],
            "response: 121 points for 9 modes; a fit needs 16 a mode",
        ),
        (
            ["w.nc", "--modes", "2", "--each-sweep", "s.nc"],
            "--each-sweep fits one mode a sweep, and --modes several; leave one of them out",
        ),
        (
            ["one.nc", "--each-sweep", "s.nc"],
            "response: has one sweep, and a series needs two; fit it without --each-sweep",
        ),
    ],
)
def test_what_cannot_be_fitted_to_a_sweep_is_one_line_and_status_2(
    words: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    warming("w.nc")
    whole = measurement.read("w.nc")["cold"].to_dataset()
    measurement.write(measurement.bundle({"cold": whole.isel(sweep=[0])}), "one.nc")
    assert run(["fit", *words]) == 2
    captured = capsys.readouterr()
    assert captured.err.splitlines() == [f"femnl: {expected}"]
    assert not captured.out
    assert not Path("s.nc").exists()
