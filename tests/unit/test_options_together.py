"""Options that mean nothing, or not together, are refused in one line and never left aside."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from femnl import measurement
from femnl.cli._main import run

F = np.linspace(999.9e3, 1000.1e3, 41)


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def sweeps(count: int = 1) -> xr.Dataset:
    """Return sweeps of one line with noise, at rising temperatures."""
    rng = np.random.default_rng(20261130)
    line = np.stack([0.05 / (1 + 2j * (F - 1e6 - k) / 20) for k in range(count)])
    noise = 1e-4 * (rng.normal(size=line.shape) + 1j * rng.normal(size=line.shape))
    return measurement.response(
        np.tile(F, (count, 1)),
        line + noise,
        drive=np.full(count, 0.01),
        noise_sd=1e-4,
        temperature=300 + np.arange(count),
    )


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["modes", "circle", "--near", "7 MHz", "--bow", "10 Pa"], "--bow: modes of a bent film"),
        (
            ["modes", "square-270um-perforated", "--homogenised", "--out", "x.vtu"],
            "the even film",
        ),
        (["geometry", "check", "circle", "--cell", "X"], "are for layouts"),
        (
            ["maps", "circle", "--z", "1", "--fringe", "multilayer", "--theta", "1"],
            "--theta 1:",
        ),
        (["maps", "circle", "--z", "1", "--seed", "3"], "--seed 3: there is no noise to draw"),
        (["validate", "--data", "x"], "--data x: is for published measurements"),
        (["fit", "r.nc", "--fringe", "nonsense"], "--fringe nonsense: expected one of"),
        (["fit", "r.nc", "--modes", "1", "--use", "magnitude"], "--use: --modes fits linear modes"),
        (["fit", "r.nc", "--modes", "1", "--linear"], "--linear: --modes fits linear modes"),
    ],
)
def test_an_option_without_effect_is_refused(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    measurement.write(measurement.bundle({"sweep": sweeps()}), "r.nc")
    assert run(words) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1


def test_sweeps_become_a_series_beside_what_else_a_file_holds() -> None:
    law = measurement.series({"temperature": np.arange(300.0, 308)}, frequency=1e6 + np.arange(8))
    measurement.write(measurement.bundle({"sweeps": sweeps(3), "law": law}), "mix.nc")
    assert run(["fit", "mix.nc", "--each-sweep", "out.nc"]) == 0
    (found,) = measurement.read("out.nc").children
    assert found == "sweeps"
