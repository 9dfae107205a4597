"""Labels of measured modes where the simulated film has hybrids in their place."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl import load
from femnl.effects import library
from femnl.fits.spectrum.labels import named_modes
from femnl.fits.spectrum.pose import pose
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm

HYBRIDS = ("(2,4)+(4,2)", "(2,4)−(4,2)")


@pytest.fixture(scope="module")
def film() -> SimulatedFilm:
    """A square whose bending splits (2,4) and (4,2) into their sum and difference."""
    model = load("square-270um")
    found = SimulatedFilm(replace(model, film=replace(model.film, thickness=1e-6)), 48)
    assert set(HYBRIDS) <= set(found.modes.label)
    return found


def test_a_mode_that_became_two_hybrids_is_their_sum(film: SimulatedFilm) -> None:
    found = named_modes(("2,4", "4,2"), film)
    places = [film.modes.label.index(name) for name in HYBRIDS]
    assert sorted(found.order) == sorted(places)
    assert np.abs(found.target[:, places]) == pytest.approx(np.full((2, 2), np.sqrt(0.5)))
    assert found.target @ found.target.T == pytest.approx(np.eye(2), abs=1e-12)
    # (2,4) has two half waves along x: the shape on the grid says so
    shape = np.tensordot(found.target[0], film.projection.shapes, 1)
    x, y = film.projection.grid_x, film.projection.grid_y
    waves = {
        (m, n): np.sin(n * np.pi * (y / (2 * y[-1]) + 0.5))
        @ shape
        @ np.sin(m * np.pi * (x / (2 * x[-1]) + 0.5))
        for m, n in ((2, 4), (4, 2))
    }
    assert waves[2, 4] > 20 * abs(waves[4, 2])


def test_modes_that_mix_half_and_half_exchange_labels_as_they_fit_best() -> None:
    """Under shear (1,2) and (2,1) of a square become their sum and difference."""
    known = SimulatedFilm(load("square-270um"), 12)
    labels = ["1,1", "2,1", "1,2", "2,2"]
    shear = [library()["shear_stress"]]

    def residuals(frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        data = measurement.spectrum(frequency, np.ones(4), labels)
        posed = pose(data, known)
        base = dict(zip([spec.name for spec in posed.base], posed.start, strict=True))
        base["speed"] = known.speed
        return posed.residuals(shear, base, [{"shear": 0.01}])[:4]

    start = known.modes.frequency[[known.modes.label.index(f"({name})") for name in labels]]
    predicted = start - residuals(start)
    assert abs(predicted[1] - predicted[2]) > 1000
    for order in ([0, 1, 2, 3], [0, 2, 1, 3]):
        assert residuals(predicted[order]) == pytest.approx(np.zeros(4), abs=1e-3)
    # Others keep theirs
    assert np.abs(residuals(predicted[[3, 1, 2, 0]])).max() > 1e5
