"""Maps: what the stage does to the points where the film is read."""

import numpy as np
from numpy.typing import NDArray

from femnl import measurement
from femnl.diagnose.film import SimulatedFilm
from femnl.diagnose.maps import MapProblem
from femnl.effects import library
from femnl.geometry import load

Array = NDArray[np.float64]
FILM = SimulatedFilm(load("square-270um"), 12)
AXIS = np.linspace(-150e-6, 150e-6, 13)
BASE = {"amplitude": 3e-7, "contrast": 0.02, "theta": 0.8, "motion_phase": 0.3, "x": 0.0, "y": 0.0}


def problem(x: Array, y: Array) -> MapProblem:
    """The problem that a map with these axes poses."""
    shape = FILM.projection.on_grid(x, y)[0]
    volts = np.array([shape, 0.1 * shape**2]) * np.exp(0.3j)
    about = {"noise_sd": 1e-4, "wavelength": 632.8e-9, "drive_frequency": float(FILM.modes.frequency[0])}
    return MapProblem(measurement.harmonic_map(x, y, [1, 2], 0.02 * volts, **about), FILM)


def test_a_stage_that_is_off_reads_the_film_where_it_is_not_told_to() -> None:
    values = {"stretch_x": 0.1, "stretch_y": -0.05}
    moved = problem(AXIS, AXIS).predict([library()["stage_scale"]], BASE | {"x": 2e-5}, [values])
    # The film lies 20 µm to the right; seen from there, the steps are longer along x and shorter along y.
    direct = problem(1.1 * AXIS, 0.95 * AXIS).predict([], BASE | {"x": 1.1 * 2e-5}, [])
    np.testing.assert_allclose(moved, direct, atol=1e-6 * np.abs(direct).max())
