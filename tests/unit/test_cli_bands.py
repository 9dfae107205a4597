"""`femnl bands`: the table, its numbers as JSON, and a picture."""

import json
from pathlib import Path

import numpy as np
import pytest

from femnl.cli._main import run
from femnl.mechanics.bands import Bands, Lattice
from femnl.mechanics.bands.words import speeds
from femnl.plot.bands import bands_figure


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


QUICK = ["bands", "square-270um-perforated", "-n", "2", "--steps", "2", "--resolution", "0.6"]


def test_bands_are_told_at_the_corners_of_the_path_and_drawn(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run([*QUICK, "--out", "bands.png"]) == 0
    out = capsys.readouterr().out
    assert "square lattice of pitch 8.56 µm, long waves 580.2" in out
    assert "complete gaps, around and inside Γ–X–M–Γ: none" in out
    assert Path("bands.png").read_bytes().startswith(b"\x89PNG")


def test_bands_as_json_are_in_si(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*QUICK, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    wave = np.array(record["wave"])
    frequency = np.array(record["frequency"])
    assert frequency.shape == (len(wave), 2)
    assert record["corners"] == [["Γ", 0], ["X", 2], ["M", 4], ["Γ", 7]]
    assert wave[2].tolist() == pytest.approx([np.pi / 8.56e-6, 0])
    assert record["speed"] == pytest.approx([580.2, 580.2], abs=0.1)


def test_films_without_a_lattice_are_refused_in_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["bands", "square-270um"]) == 2
    assert capsys.readouterr().err.startswith(
        "femnl: square-270um: holes: 0 of them make no lattice"
    )
    assert run([*QUICK, "--out", "bands.gif"]) == 2
    assert "--out bands.gif" in capsys.readouterr().err


def test_the_picture_names_corners_and_shades_gaps() -> None:
    lattice = Lattice("square", 1e-5)
    wave, corners = lattice.path(3)
    frequency = np.linalg.norm(wave, axis=1)[:, None] * [10.0, 1.0] + [0.0, 2e7]
    none = np.empty((0, frequency.shape[1]))
    bands = Bands(
        lattice, wave, frequency, 0 * frequency, corners, np.diag([1.0, 4.0]), 1.0, none, none
    )
    axes = bands_figure(bands).axes[0]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["Γ", "X", "M", "Γ"]
    assert len(axes.lines) == 2 + 2 + 1  # corners, bands, long waves
    assert len(axes.patches) == 1
    assert axes.get_ylabel() == "f (MHz)"
    assert speeds(bands, 1) == "1.0 to 2.0 m/s, the fastest 90° from x"
    long = axes.lines[-1]
    np.testing.assert_allclose(
        np.array(long.get_ydata()) * 2e6 * np.pi, np.hypot(wave[:, 0], 2 * wave[:, 1])
    )
