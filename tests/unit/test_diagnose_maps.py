"""Maps: what the stage does to the points where the film is read."""

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl import measurement
from femnl.diagnose.film import SimulatedFilm
from femnl.diagnose.fit import fit
from femnl.diagnose.maps import MapProblem
from femnl.diagnose.problem import Extended
from femnl.diagnose.search import FALSE_ALARMS, criticise
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


@pytest.mark.parametrize("deviation", ["", "x y", "x²"])
def test_a_motion_that_deviates_smoothly_is_seen_without_any_cause_to_look_for(deviation: str) -> None:
    axis = np.linspace(-150e-6, 150e-6, 41)
    y, x = (v / 135e-6 for v in np.meshgrid(axis, axis, indexing="ij"))
    uneven = {"": 0.0 * x, "x y": x * y, "x²": x**2}[deviation]
    depth = 4 * np.pi / 632.8e-9 * 3e-7 * FILM.projection.on_grid(axis, axis)[0] * (1 + 3e-3 * uneven)
    phase = 2 * np.pi * np.arange(128) / 128
    volts = 0.02 * np.cos(depth[..., None] * np.cos(phase + 0.3) + 0.8)
    noise = 1e-4
    rng = np.random.default_rng(8)
    harmonics = np.moveaxis(np.fft.rfft(volts)[..., 1:7] / 64, -1, 0)
    harmonics = harmonics + noise * (rng.standard_normal(harmonics.shape) + 1j * rng.standard_normal(harmonics.shape))
    about = {"noise_sd": noise, "wavelength": 632.8e-9, "drive_frequency": float(FILM.modes.frequency[0])}
    posed = MapProblem(measurement.harmonic_map(axis, axis, np.arange(1, 7), harmonics, **about), FILM)
    found = criticise(fit(Extended(posed), posed.start), [])
    assert (found.p_value < FALSE_ALARMS) == bool(deviation), (found.p_value, found.worst)
    # χ² alone would not tell: the deviation is spread over twenty thousand data.
    assert abs(found.solution.chi2 / found.solution.degrees - 1) < 0.03
    if deviation:
        assert found.worst == f"motion that varies as {deviation.replace(' ', '')}"
