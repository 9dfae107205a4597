"""Spectra without labels of which modes are missing, as most real lists of lines are."""

from pathlib import Path

import numpy as np
import pytest

from femnl.cli._main import run
from femnl.device.geometry import load
from femnl.diagnose import diagnose
from femnl.fits.spectrum.without_labels import modes_of
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from femnl.observe.spectrum.matching import by_rank, ranks

NAME = "hexagon-278um"
FILM = SimulatedFilm(load(NAME), 48)
SD = 5.0


def lines(modes: list[int], seed: int = 3) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Frequencies [Hz] of a film of another stress, with noise."""
    rng = np.random.default_rng(seed)
    return np.asarray(
        0.96 * FILM.modes.frequency[modes] + SD * rng.standard_normal(len(modes)), float
    )


@pytest.mark.parametrize("missing", [[1], [0, 3], [2, 3, 4]])
def test_lines_are_given_to_the_modes_that_they_are(missing: list[int]) -> None:
    modes = [k for k in range(10) if k not in missing]
    frequency = lines(modes)
    found, told = modes_of(frequency, np.full(len(modes), SD), FILM)
    off = np.abs(np.log(FILM.modes.frequency[found] / FILM.modes.frequency[modes]))
    assert off.max() < 1e-4  # up to partners of a pair, which frequencies do not tell apart
    assert "label them where that is wrong" in told[0]


def test_the_lowest_modes_are_taken_unless_they_are_far_off() -> None:
    frequency = lines(list(range(8)))
    stretched = frequency * (1 + 0.01 * np.cos(np.arange(8)))
    for measured in (frequency, stretched, frequency[:3]):
        found, told = modes_of(measured, np.full(len(measured), SD), FILM)
        np.testing.assert_array_equal(found, ranks(measured))
        assert told == ()


def test_ranks_go_to_the_modes_that_were_measured() -> None:
    changed = np.array([[1.0, 2.0, 3.0, 4.0, 5.0]])
    order = np.array([1, 4, 3])

    def read_off(
        measured: np.ndarray[tuple[int], np.dtype[np.int64]],
        taken: np.ndarray[tuple[int, int], np.dtype[np.int64]],
    ) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.float64]], np.ndarray]:
        return np.take_along_axis(changed, taken, axis=1), np.empty((1, 0))

    found, _ = by_rank(changed, order, np.array([2.1, 5.1, 4.1]), read_off)
    np.testing.assert_array_equal(found, [[2.0, 5.0, 4.0]])


def test_a_spectrum_with_modes_missing_needs_no_cause(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "lines.nc"
    modes = [0, 2, 3, 5, 6, 7, 9, 10]
    spectrum = measurement.spectrum(lines(modes), np.full(len(modes), SD))
    measurement.write(measurement.bundle({"lines": spectrum}, geometry=NAME), path)
    assert diagnose(path, workers=1).verdict == "adequate"
    assert run(["diagnose", str(path), "--workers", "1", "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "taken for modes (1), (3), (4), (6), (7), (8), (10), (11); label them" in said
