"""Words, tables and pictures that claim no more than the data hold."""

from pathlib import Path

import numpy as np
import pytest

from femnl.cli._fit_series import _digits
from femnl.cli._main import run
from femnl.core.errors import MeasurementError
from femnl.fits.covariance import strongest_correlation
from femnl.fits.response import fit_response
from femnl.io.labfiles import import_file
from femnl.io.measurement import response
from femnl.plot.response import response_figure

F = np.linspace(999e3, 1001e3, 60)
V = 1e-3 / (2 * (1e6 - F) / 200 + 1j)


def test_magnitudes_are_drawn_without_a_phase() -> None:
    whole = response(F, V[None], drive=[1.0], noise_sd=1e-6)
    assert len(response_figure(whole).axes) == 2
    alone = whole.drop_vars("imag").rename({"real": "magnitude"})
    alone["magnitude"] = abs(alone["magnitude"])
    assert [axes.get_ylabel() for axes in response_figure(alone).axes] == ["magnitude |V| (µV)"]


def test_detunings_are_no_frequencies() -> None:
    with pytest.raises(MeasurementError, match="add the frequency that they count from"):
        fit_response(response(F - 1e6, V[None], drive=[1.0]))


def test_one_quadrature_of_a_decay_is_refused(tmp_path: Path) -> None:
    text = "t,X\n" + "".join(f"{k / 10},{np.exp(-k / 10)}\n" for k in range(40))
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    spec = 'kind = "decay"\n[columns]\ntime = "t"\nreal = "X"\n'
    (tmp_path / "a.toml").write_text(spec, encoding="utf-8")
    with pytest.raises(MeasurementError, match="imag"):
        import_file(tmp_path / "a.csv", tmp_path / "a.nc")


def test_uncorrelated_parameters_are_a_pair_of_two() -> None:
    assert strongest_correlation(np.diag([1.0, 4.0]), ["a", "b"]) == (
        "the most correlated pair is a and b, +0.000"
    )
    found = np.array([[1.0, -0.9, 0.1], [-0.9, 1.0, 0.2], [0.1, 0.2, 1.0]])
    assert strongest_correlation(found, ["a", "b", "c"]).endswith("a and b, -0.900")


@pytest.mark.parametrize(
    ("low", "high", "digits"), [(1.0, 2.0, 6), (1e6, 1e6 + 0.5, 9), (0.0, 0.0, 6)]
)
def test_ends_of_an_interval_are_told_apart(low: float, high: float, digits: int) -> None:
    assert _digits(low, high) == digits
    assert low == high or f"{low:.{digits}g}" != f"{high:.{digits}g}"


def test_decays_of_several_files_are_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    time = np.linspace(0, 2, 200)
    files = []
    for name in ("first", "second"):
        noisy = np.hypot(np.exp(-3 * time), 1e-3)
        rows = "".join(f"{t:.5f},{v:.8e}\n" for t, v in zip(time, noisy, strict=True))
        (tmp_path / f"{name}.csv").write_text("t,R\n" + rows, encoding="utf-8")
        spec = 'kind = "decay"\n[columns]\ntime = "t"\nmagnitude = "R"\n'
        (tmp_path / f"{name}.toml").write_text(spec, encoding="utf-8")
        import_file(tmp_path / f"{name}.csv", tmp_path / f"{name}.nc")
        files.append(str(tmp_path / f"{name}.nc"))
    assert run(["fit", *files]) == 0
    out = capsys.readouterr().out
    assert "first, measurement" in out
    assert "second, measurement" in out
