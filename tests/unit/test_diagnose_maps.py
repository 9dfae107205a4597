"""Maps: what the stage does to the points where the film is read."""

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.core.comparison import Curves
from femnl.device.geometry import load
from femnl.diagnose.criticism import criticise
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.effects import library
from femnl.fits.least_squares import fit
from femnl.fits.map.pose import pose as pose_map
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.observe.map.model import MapModel

Array = NDArray[np.float64]
FILM = SimulatedFilm(load("square-270um"), 12)
AXIS = np.linspace(-150e-6, 150e-6, 13)
BASE = {"amplitude": 3e-7, "contrast": 0.02, "theta": 0.8, "motion_phase": 0.3, "x": 0.0, "y": 0.0}


def base_model(x: Array, y: Array) -> MapModel:
    """The problem that a map with these axes poses."""
    shape = FILM.projection.on_grid(x, y)[0]
    volts = np.array([shape, 0.1 * shape**2]) * np.exp(0.3j)
    about = {
        "noise_sd": 1e-4,
        "wavelength": 632.8e-9,
        "drive_frequency": float(FILM.modes.frequency[0]),
    }
    return pose_map(measurement.harmonic_map(x, y, [1, 2], 0.02 * volts, **about), FILM)


def test_a_stage_that_is_off_reads_the_film_where_it_is_not_told_to() -> None:
    values = {"stretch_x": 0.1, "stretch_y": -0.05}
    moved = base_model(AXIS, AXIS).predict([library()["stage_scale"]], BASE | {"x": 2e-5}, [values])
    # The film lies 20 µm to the right; seen from there, the steps are longer along x and shorter
    # along y.
    direct = base_model(1.1 * AXIS, 0.95 * AXIS).predict([], BASE | {"x": 1.1 * 2e-5}, [])
    np.testing.assert_allclose(moved, direct, atol=1e-6 * np.abs(direct).max())


def signal(deviation: str, across: Array, up: Array, tau: Array) -> Array:
    """v(t) of a driven film, (n_y, n_x, n_times), with one thing a little otherwise.

    Across, up (n_y, n_x) in m.
    """
    x = across / 150e-6
    y = up / 150e-6
    turn = 5e-3 * (deviation == "axes that are turned")
    shapes = FILM.projection.at((across + turn * up).ravel(), (up - turn * across).ravel()).reshape(
        12, *across.shape
    )[..., None]
    uneven = (
        6e-3
        * {"motion that varies as x": x, "motion that varies as x²": x**2}.get(deviation, 0 * x)[
            ..., None
        ]
    )
    overtone = 4e-10 * (deviation == "sin motion at 2f as mode 4") * shapes[3]
    u = 3e-7 * (1 + uneven) * shapes[0] * np.cos(tau + 0.3) + overtone * np.sin(2 * (tau + 0.3))
    phase = (
        4 * np.pi / 632.8e-9 * u
        + 0.8
        + 2e-3 * (deviation == "phase of the fringe that varies as y") * y[..., None]
    )
    v = np.cos(phase) + 2e-3 * (deviation == "term cos 3φ of the fringe") * np.cos(3 * phase)
    hum = 2e-5 * np.cos(3 * tau) * (deviation == "constant in harmonic 3")
    return np.asarray(
        hum + 0.02 * v * (1 + 4e-3 * (deviation == "signal that varies as y²") * y[..., None] ** 2)
    )


@pytest.mark.parametrize(
    "deviation",
    [
        "",
        "motion that varies as x",
        "motion that varies as x²",
        "phase of the fringe that varies as y",
        "signal that varies as y²",
        "term cos 3φ of the fringe",
        "sin motion at 2f as mode 4",
        "axes that are turned",
        "blur along x",
        "constant in harmonic 3",
    ],
)
def test_what_deviates_a_little_at_any_stage_is_seen_without_a_cause_to_look_for(
    deviation: str,
) -> None:
    axis = np.linspace(-150e-6, 150e-6, 41)
    up, across = np.meshgrid(axis, axis, indexing="ij")
    tau = 2 * np.pi * np.arange(128) / 128
    noise = 1e-4
    rng = np.random.default_rng(8)
    sides = (-1.2e-6, 1.2e-6) if deviation == "blur along x" else (0.0,)
    volts = np.mean([signal(deviation, across + side, up, tau) for side in sides], axis=0)
    harmonics = np.moveaxis(np.fft.rfft(volts)[..., 1:7] / 64, -1, 0)
    harmonics = harmonics + noise * (
        rng.standard_normal(harmonics.shape) + 1j * rng.standard_normal(harmonics.shape)
    )
    about = {
        "noise_sd": noise,
        "wavelength": 632.8e-9,
        "drive_frequency": float(FILM.modes.frequency[0]),
    }
    posed = pose_map(
        measurement.harmonic_map(axis, axis, np.arange(1, 7), harmonics, **about), FILM
    )
    found = criticise(fit(ExtendedModel(posed), posed.start), [])
    assert (found.p_value < THRESHOLDS.base_inadequate) == bool(deviation), (
        found.p_value,
        found.worst,
    )
    # χ² alone would not tell: the deviation is spread over twenty thousand data.
    assert abs(found.result.chi2 / found.result.degrees - 1) < 0.03
    if deviation:
        assert found.worst == deviation, (found.p_value, found.worst)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_map_of_a_single_line_is_diagnosed_and_drawn_as_curves(axis: str) -> None:
    along = np.linspace(-150e-6, 150e-6, 61)
    across = np.array([2e-5])
    x, y = (along, across) if axis == "x" else (across, along)
    tau = 2 * np.pi * np.arange(128) / 128
    rng = np.random.default_rng(9)
    there, above = np.meshgrid(x, y)
    harmonics = np.moveaxis(np.fft.rfft(signal("", there, above, tau))[..., 1:7] / 64, -1, 0)
    harmonics = harmonics + 1e-4 * (
        rng.standard_normal(harmonics.shape) + 1j * rng.standard_normal(harmonics.shape)
    )
    about = {
        "noise_sd": 1e-4,
        "wavelength": 632.8e-9,
        "drive_frequency": float(FILM.modes.frequency[0]),
    }
    posed = pose_map(measurement.harmonic_map(x, y, np.arange(1, 7), harmonics, **about), FILM)
    found = criticise(
        fit(ExtendedModel(posed), posed.start), posed.usable_effects(library().values())
    )
    assert found.p_value > THRESHOLDS.base_inadequate, found.worst
    assert len(np.unique(posed.blocks)) == 3
    base, _ = found.result.model.split(found.result.vector)
    (drawn,) = posed.compare([("base model", (), base, ())])
    assert isinstance(drawn, Curves)
    assert (drawn.x, [curve.name for curve in drawn.curves]) == (
        axis,
        ["1f", "2f", "3f", "4f", "5f", "6f"],
    )
    away = np.concatenate(
        [(curve.data - curve.predictions[0]) / curve.sd for curve in drawn.curves]
    )
    assert np.mean(away**2) == pytest.approx(1.0, abs=0.25)
