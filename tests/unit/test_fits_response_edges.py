"""Fits of responses at their edges: what is held, missing, withheld, or of another harmonic."""

from typing import Literal

import numpy as np
import pytest
import xarray as xr

from femnl.core.errors import ParameterError
from femnl.core.fit import Fit, Parameter
from femnl.fits.response.each import fit_each_sweep
from femnl.fits.response.first_fit import of_weak_sweeps
from femnl.fits.response.fit import fit_response, predict_response
from femnl.fits.response.linescan import _mean
from femnl.fits.response.misfit import Misfit
from femnl.fits.response.modes import fit_modes
from femnl.fits.response.single_sweeps import BENT
from femnl.io.measurement import response
from femnl.observe.response.curves import described
from femnl.observe.response.sweeps import collect
from femnl.observe.response.theta import Layout
from tests.unit.test_fits_response import F0, MODE, simulate
from tests.unit.test_fits_sweeps import line, noise

FREQUENCY = np.linspace(990, 1010, 200)
BENT_DOWN = Fit({"alpha_y": Parameter("alpha_y", -1.0, 0.1, "V⁻²")}, np.eye(1), 10 * BENT, 99, 1)
"""A fit to all drives that misses them, and says that the mode softens."""


def linear(seed: int, sizes: tuple[float, ...] = (1.0,)) -> xr.Dataset:
    """Return sweeps of a linear mode with the phase 0.5 rad, 2 Hz wide."""
    rng = np.random.default_rng(seed)
    volts = np.exp(0.5j) * np.outer(sizes, line(FREQUENCY, 1000, 2))
    volts += noise(rng, volts.shape, 3e-3)
    return response(FREQUENCY, volts, noise_sd=3e-3)


@pytest.mark.parametrize(
    "held",
    [
        {"linewidth": 2.0},
        {"frequency": 1000.0},
        {"frequency": 1000.0, "linewidth": 2.0, "phase": 0.5},
    ],
)
def test_what_is_held_leaves_the_error_of_no_duffing_term(held: dict[str, float]) -> None:
    data = linear(11)
    fit = fit_response(data, background="none", fixed=held)
    bent = fit_response(data, background="none", fixed=held, duffing=True)
    assert not fit.duffing
    sd = bent.parameters["alpha_ratio"].sd
    assert fit.parameters["alpha_ratio"].sd == pytest.approx(sd, rel=0.05)


@pytest.mark.parametrize(("use", "other"), [("complex", 4), ("magnitude", 1)])
def test_a_fit_predicts_at_as_many_positions_as_it_has(
    use: Literal["complex", "magnitude"], other: int
) -> None:
    data = linear(1, (1.0, 0.5, 0.7, 0.3)).assign_coords(x=("sweep", 1e-5 * np.arange(4)))
    two = data.isel(sweep=slice(2))
    fit = fit_response(two, use, background="none", duffing=False)
    assert np.isfinite(predict_response(fit, two)).all()
    with pytest.raises(ParameterError, match=f"{other} positions, but the fit has 2"):
        predict_response(fit, data.isel(sweep=slice(other)))


def test_the_offset_that_is_told_is_that_of_the_worst_drive() -> None:
    sweeps = collect(linear(2, (1.0, 2.0)).assign_coords(drive=("sweep", [1.0, 2.0])))
    residuals = np.zeros((2, 2, 200))
    residuals[:, 0] = 3.0
    residuals[:, 0, 20] = 4.0
    residuals[:, 1, 150] = 10.0
    told = described(sweeps, residuals.ravel(), FREQUENCY[20] + 5)
    assert told.startswith("the drive of 1 V deviates most, most strongly −5 Hz from resonance")


def test_a_jump_between_two_readings_at_one_frequency_tells_no_fold() -> None:
    data = simulate(drives=(1.0,), noise=2e-3).isel(sweep=[0])
    size = np.hypot(data["real"].values[0], data["imag"].values[0])
    jump = int(np.argmax(-np.diff(size)))
    twice = data["frequency"].values.copy()
    twice[0, jump + 1] = twice[0, jump]
    counts = []
    for frequency in (data["frequency"].values, twice):
        sweeps = collect(data.assign_coords(frequency=(("sweep", "point"), frequency)))
        layout = Layout(F0, MODE.linewidth, sweeps.span, 1.0, 1, False, True, False)
        misfit = Misfit.of(sweeps, layout, "magnitude")
        theta = np.array([0.0, 0.0, 10.0, np.log(0.17)])
        misfit.assign(theta)
        assert np.isfinite(misfit.residual(theta)).all()
        assert np.isfinite(misfit.jacobian(theta)).all()
        counts.append(len(misfit.jumps))
    assert counts == [1, 0]


def test_a_position_without_an_error_does_not_count_in_the_mean() -> None:
    values = np.array([1.0, 7.0, 3.0])
    assert _mean(values, np.array([0.5, np.nan, 0.5])) == pytest.approx((2, 0.5 / np.sqrt(2), 8))
    mean, sd, _ = _mean(values, np.full(3, np.nan))
    assert mean == pytest.approx(values.mean())
    assert np.isnan(sd)


def test_no_sweep_is_weak_where_no_drive_is_known() -> None:
    assert of_weak_sweeps(linear(3, (1.0, 2.0)), BENT_DOWN, "alpha_y", 1) is None


def test_the_weakest_drive_of_a_second_harmonic_is_none_of_the_mode() -> None:
    data = simulate(drives=(0.1, 0.3, 1.0))
    data = data.assign_coords(harmonic=("sweep", [2, 2, 1, 1, 1, 1]))
    weak = of_weak_sweeps(data, BENT_DOWN, "alpha_y", 1)
    assert weak is not None
    assert weak["drive"] == pytest.approx(0.3)
    assert weak["alpha_y"] > 0


def test_sweeps_of_a_second_harmonic_are_left_out_of_a_series() -> None:
    data = linear(4, (1.0, 0.1, 1.0)).assign_coords(
        temperature=("sweep", [4.0, 5.0, 6.0]), harmonic=("sweep", [1, 2, 1])
    )
    fits, series = fit_each_sweep(data)
    assert len(fits) == 2
    np.testing.assert_array_equal(series["temperature"], [4.0, 6.0])


def test_modes_are_predicted_where_something_was_measured() -> None:
    data = linear(5)
    missing = np.isin(np.arange(200), [5, 90])
    data = data.where(~xr.DataArray(missing, dims="point"))
    for fixed in (None, {"linewidth[1]": 2.0}):
        prediction = fit_modes(data, 1, fixed=fixed).prediction
        np.testing.assert_array_equal(np.isnan(prediction), missing)
