"""Maps of a motion so faint that the data know little more than its product with the contrast."""

import numpy as np
import pytest
from scipy.special import jv

from femnl.core.readout import Array
from femnl.device.geometry import load
from femnl.fits.least_squares import fit
from femnl.fits.map.pose import pose as pose_map
from femnl.fits.minimise import _Data
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm
from femnl.observe.map.model import MapModel

FILM = SimulatedFilm(load("square-270um"), 12)
AXIS = np.linspace(-150e-6, 150e-6, 25)
Q = 4 * np.pi / 632.8e-9
TRUE = {
    "amplitude": 2.6e-9,
    "contrast": 0.02,
    "theta": 0.9,
    "motion_phase": 0.3,
    "x": 1e-6,
    "y": -2e-6,
}
NOISE = 3e-7


def faint() -> MapModel:
    """A map of 1f and 2f with noise; its first harmonic stands 3400 times above that."""
    rng = np.random.default_rng(7)
    volts = np.zeros((2, len(AXIS), len(AXIS)), complex)
    about = {
        "noise_sd": NOISE,
        "wavelength": 632.8e-9,
        "drive_frequency": float(FILM.modes.frequency[0]),
    }
    shape = FILM.projection.on_grid(AXIS - TRUE["x"], AXIS - TRUE["y"])[0]
    z = Q * TRUE["amplitude"] * shape
    turn = np.exp(1j * TRUE["motion_phase"])
    volts[0] = -2 * TRUE["contrast"] * jv(1, z) * np.sin(TRUE["theta"]) * turn
    volts[1] = -2 * TRUE["contrast"] * jv(2, z) * np.cos(TRUE["theta"]) * turn**2
    noise = rng.standard_normal((2, *volts.shape))
    noisy = volts + NOISE * (noise[0] + 1j * noise[1])
    return pose_map(measurement.harmonic_map(AXIS, AXIS, [1, 2], noisy, **about), FILM)


def start_of(model: MapModel, factor: float) -> Array:
    """A motion larger by a factor, under less contrast."""
    other = {"amplitude": factor * TRUE["amplitude"], "contrast": TRUE["contrast"] / factor}
    return ExtendedModel(model).pack(TRUE | other, [])


def test_a_fit_from_a_larger_motion_under_less_contrast_arrives_in_few_steps() -> None:
    model = faint()
    there = fit(ExtendedModel(model), start_of(model, 1.0))
    assert there.chi2 < 1.1 * 2 * model.measured.size
    assert fit(ExtendedModel(model), start_of(model, 9.0), most=30).chi2 < there.chi2 + 0.1


def test_no_product_is_known_where_the_motion_is_deep_or_the_fringe_dark() -> None:
    model = faint()
    assert model.known_product(TRUE) is not None
    assert model.known_product(TRUE | {"amplitude": 1.01 / Q}) is None
    assert model.known_product(TRUE | {"amplitude": 0.0}) is None
    assert model.known_product(TRUE | {"theta": 0.009}) is None


def test_the_factor_is_that_of_the_first_harmonic() -> None:
    product = faint().known_product(TRUE)
    assert product is not None
    assert (product.name, product.others) == ("contrast", ("amplitude", "theta"))
    z = 0.3
    factor, slopes = product.factor(z / Q, 0.9)
    assert factor == pytest.approx(2 * jv(1, z) * np.sin(0.9), rel=1e-4)
    step = 1e-6
    by_hand = [
        np.log(product.factor(z * (1 + step) / Q, 0.9)[0] / factor) / (step * z / Q),
        np.log(product.factor(z / Q, 0.9 + step)[0] / factor) / step,
    ]
    assert slopes == pytest.approx(by_hand, rel=1e-4)


def test_derivatives_follow_the_product() -> None:
    base_model = faint()
    model = ExtendedModel(base_model)
    data = _Data(model, slice(None), start_of(base_model, 3.0))
    low, high = model.bounds
    part = (start_of(base_model, 2.0) - low) / (high - low)
    steps = 1e-7 * (high - low)
    slopes = data.slopes(part, steps)
    by_hand = np.stack(
        [
            (data.residuals(part + step) - data.residuals(part - step)) / 2e-7
            for step in 1e-7 * np.eye(len(part))
        ],
        axis=1,
    )
    assert np.all(np.abs(slopes - by_hand) < 1e-3 * np.abs(by_hand).max(axis=0))
    vector = data.place(part)
    plain = np.stack(
        [
            (model.residuals(vector + step) - model.residuals(vector - step)) / 2
            for step in 1e-7 * np.diag(high - low)
        ],
        axis=1,
    ) / (1e-7 * (high - low))
    curved = data.curved(slopes / (high - low), vector)
    assert np.all(np.abs(curved - plain) < 1e-3 * np.abs(plain).max(axis=0))
