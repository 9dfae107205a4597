"""A resonance that drifts while it is swept, not only from sweep to sweep."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from femnl import load
from femnl.fits.response.first_fit import of_weak_sweeps
from femnl.fits.response.fit import fit_response
from femnl.fits.response.pose import pose
from femnl.fits.response.single_sweeps import BENT
from femnl.io import measurement
from femnl.observe.film import SimulatedFilm
from tests.physics.driven_sweeps import F0, Bench, Complex

START = 100.0 * np.arange(8)
RATE = -1.5e-9


def drifting(bench: Bench, duration: float, rate: float = RATE) -> Complex:
    """Return sweeps that take so long [s], in either direction, while f₀ drifts by a rate [1/s]."""
    step = np.arange(bench.points)
    order = np.where(bench.direction[:, None] > 0, step, step[::-1])
    time = START[:, None] + duration * (order + 0.5) / bench.points
    return bench.volts(bench.amplitude(F0 * (1 + rate * time)))


@pytest.mark.parametrize(
    "extra",
    [{"duration": 60.0}, pytest.param({}, marks=pytest.mark.slow)],
    ids=["recorded", "without pause"],
)
@pytest.mark.slow
def test_a_drift_within_sweeps_is_named_with_its_rate(
    extra: dict[str, float], tmp_path: Path
) -> None:
    bench = Bench()
    volts = drifting(bench, extra.get("duration", 100.0))
    found = bench.diagnose(tmp_path / "a.nc", volts, time=START, **extra)
    assert (found.verdict, found.causes) == ("explained", ("frequency_drift",)), found.alternatives
    rate = found.parameters["frequency_drift"]["rate"]
    assert rate.value == pytest.approx(RATE, abs=4 * rate.sd)
    assert found.parameters["base"]["linewidth"].value == pytest.approx(4.0, rel=1e-3)


def test_each_point_has_its_time_whichever_way_the_sweep_went() -> None:
    frequency = F0 + np.linspace(-40, 40, 11)
    volts = 1e-3 / (1 + 0.1j * (frequency - F0)) * np.ones((3, 1))
    volts[0, 4] = np.nan
    data = measurement.response(
        frequency,
        volts,
        noise_sd=1e-6,
        mode="2,2",
        drive=[0.1, 0.1, 0.1],
        direction=[1, -1, 0],
        time=[0.0, 200.0, 500.0],
        duration=[110.0, 220.0, 110.0],
    )
    model = pose(data, SimulatedFilm(load("square-270um"), 12))
    up, down, unknown = (model.time[span] for span in model.sweeps.spans)
    np.testing.assert_allclose(up, 5.0 + 10 * np.delete(np.arange(11), 4))
    np.testing.assert_allclose(down, 200 + 10 + 20 * np.arange(11)[::-1])
    np.testing.assert_allclose(unknown, 555.0)


FALLING = Bench(width=1.0, stretch=1.0, wide=30.0)
"""All its sweeps together bend downwards as it drifts by 2.5 Hz a sweep; each alone stiffens."""


def falling() -> xr.Dataset:
    return FALLING.measured(drifting(FALLING, 100.0, rate=-2.5 / 100.0 / F0), time=START)


def test_sweeps_one_by_one_tell_that_a_film_stiffens_which_drifts_down_as_the_drive_grows() -> None:
    sweeps = falling()
    softer = fit_response(
        sweeps, background="none", delay=True, phase_sign=1, fixed={"alpha_ratio": -20.0}
    )
    found = of_weak_sweeps(sweeps, softer, "alpha_y", 1)
    assert found is not None
    assert found["alpha_y"] > 0
    assert found["linewidth"] == pytest.approx(FALLING.width, rel=0.1)
    straight = FALLING.peak * FALLING.drives[:, None] / (1 + 2j * (FALLING.frequency - F0))
    linear = FALLING.measured(FALLING.volts(straight))
    assert of_weak_sweeps(linear, softer, "alpha_y", 1) is None


def test_sweeps_at_several_positions_of_the_readout_tell_it_together_at_each_drive() -> None:
    level = np.unique(FALLING.drives, return_inverse=True)[1]
    drifted = np.asarray(F0 - 5.0 * level[:, None], dtype=np.float64)
    volts = FALLING.volts(FALLING.amplitude(drifted))
    measured = [
        FALLING.measured(gain * volts).assign_coords(x=("sweep", np.full(len(level), x)))
        for gain, x in ((1.0, 0.0), (0.5, 1e-5))
    ]
    both = xr.concat(measured, "sweep")
    softer = fit_response(
        both, background="none", delay=True, phase_sign=1, fixed={"alpha_ratio": -20.0}
    )
    found = of_weak_sweeps(both, softer, "alpha_y[0]", 1)
    assert found is not None
    assert found["alpha_y[0]"] > 0
    assert found["y_max[1]"] == pytest.approx(0.5 * found["y_max[0]"], rel=0.1)
    # No drive at which both positions were measured
    apart = both.isel(sweep=[0, 1, 10, 11])
    assert of_weak_sweeps(apart, softer, "alpha_y[0]", 1) is None


@pytest.mark.slow
def test_a_mode_that_drifts_down_while_the_drive_grows_does_not_soften() -> None:
    sweeps = falling()
    together = fit_response(sweeps, background="none", duffing=True, delay=True, phase_sign=1)
    assert together["alpha_y"] < 0
    assert together.chi2_reduced > BENT
    posed = pose(sweeps, SimulatedFilm(load("square-270um"), 12))
    assert not posed.softens
    frequency, width, *_ = posed.start
    assert F0 - 20.0 < frequency < F0 + FALLING.width
    assert width == pytest.approx(FALLING.width, rel=0.1)
