"""A mode that drifts out of the sweeps, by hundreds of linewidths in all, is followed."""

from cProfile import Profile
from pathlib import Path
from pstats import Stats

import numpy as np
import pytest
import xarray as xr

from femnl.diagnose.multistart import followed
from femnl.diagnose.posing import Posing
from femnl.diagnose.sent import sent
from femnl.effects import library
from femnl.fits.least_squares import fit
from femnl.fits.response.first_fit import beside_leak, first_fit
from femnl.fits.response.fit import fit_response
from femnl.fits.response.single_sweeps import SingleSweeps, without_background
from femnl.observe.extended import ExtendedModel
from femnl.observe.model import MeasurementModel
from tests.blind.realistic.files import Draw, make

DRAW = Draw("response", ("frequency_drift",), "correlated noise", "square-270um", 1541494923)
"""The line, 1.7 Hz wide, leaves the sweeps of 43 Hz after the first four of sixteen. Without drift
it looks 62 Hz wide, or as if it softened, and is sought where it was late.
"""


DRIFT = library()["frequency_drift"]


def posed(path: Path) -> MeasurementModel:
    """Return the model of a file."""
    return Posing(path, None, sent([DRIFT], 1))(None)[0]


def test_a_mode_that_leaves_the_sweeps_is_followed_from_the_first_one(tmp_path: Path) -> None:
    path = tmp_path / "drift.nc"
    told = make(DRAW, path)
    model = posed(path)
    first = dict(zip([spec.name for spec in model.base], model.start, strict=True))
    width = told["base"]["linewidth"]
    assert first["frequency"] == pytest.approx(told["base"]["frequency"], abs=width)
    assert first["linewidth"] == pytest.approx(width, rel=0.1)
    np.testing.assert_array_equal(model.order_of_blocks, range(16))
    # The second position sees the mode half as large, in sweeps that have lost it
    allowed = {spec.name: spec.high for spec in model.base}
    assert allowed["height[0]"] > 0.5 * first["height[1]"]
    base = fit(ExtendedModel(model), model.start)
    assert base.chi2 > 100 * base.degrees
    found = followed(base, DRIFT)
    assert found is not None
    assert found.chi2 < 1.05 * found.degrees
    rate = told["causes"]["frequency_drift"]["rate"]
    assert found.vector[-1] == pytest.approx(rate, rel=1e-3)


def drifting(xs: list[float], heights: list[float], phases: list[float]) -> xr.Dataset:
    """Return sweeps of a linear mode, 100 Hz wide, that drifts by many widths between them."""
    rng = np.random.default_rng(1)
    f = np.linspace(998e3, 1002e3, 80)
    lines = np.array([999e3, 999.6e3, 1000.3e3, 1000.9e3])[:, None]
    turned = np.array(heights)[:, None] * np.exp(1j * np.array(phases)[:, None])
    volts = turned / (2 * (lines - f) / 100 + 1j)
    noise = 1e-5 * (rng.standard_normal((2, *volts.shape)))
    rows = ("sweep", "point")
    return xr.Dataset(
        {
            "frequency": (rows, np.tile(f, (4, 1))),
            "real": (rows, volts.real + noise[0]),
            "imag": (rows, volts.imag + noise[1]),
            "drive": ("sweep", np.ones(4)),
            "x": ("sweep", xs),
            "y": ("sweep", np.zeros(4)),
            "time": ("sweep", 10.0 * np.arange(4)),
        },
        attrs={"kind": "response"},
    )


def test_one_sweep_leaves_other_positions_what_all_sweeps_say_of_them() -> None:
    """The first is near a node: a range of twenty times what it reads would end too soon."""
    sweeps = drifting([1e-6, 5e-5, 1e-6, 5e-5], [2e-3, 0.4, 2e-3, 0.4], [0.3, 3.4, 0.3, 3.4])
    _, found = first_fit(sweeps, ("[0]", "[1]"), None)
    assert found["hidden"] == 1
    assert found["frequency"] == pytest.approx(999e3, abs=1)
    assert found["linewidth"] == pytest.approx(100, rel=0.01)
    assert found["y_max[0]"] == pytest.approx(2e-3, rel=0.01)
    assert found["y_max[1]"] > 0.1


def test_a_drift_is_told_before_all_sweeps_are_fitted_in_vain() -> None:
    with Profile() as profile:
        first_fit(drifting([0.0] * 4, [0.02] * 4, [0.3] * 4), ("",), None)
    called = Stats(profile).get_stats_profile().func_profiles
    assert without_background.__name__ in called
    assert beside_leak.__name__ not in called


def test_sweeps_that_agree_show_no_drift() -> None:
    """What leads a fit to all of them astray is something else."""
    drifts = drifting([0.0] * 4, [0.02] * 4, [0.3] * 4)
    astray = fit_response(drifts, "complex", background="none", duffing=True, phase_sign=1)
    still = drifts.copy()
    for name in ("real", "imag"):
        still[name] = drifts[name].copy(data=np.tile(drifts[name].values[0], (4, 1)))
    assert SingleSweeps(still, ("",)).earliest_clear(astray, 1) is not None
    assert SingleSweeps(still, ("",)).of_drift(astray, 1) is None
    assert SingleSweeps(drifts, ("",)).of_drift(astray, 1) is not None


def test_no_sweep_is_fitted_twice() -> None:
    drifts = drifting([0.0] * 4, [0.02] * 4, [0.3] * 4)
    astray = fit_response(drifts, "complex", background="none", duffing=True, phase_sign=1)
    singles = SingleSweeps(drifts, ("",))
    found = singles.of_drift(astray, 1)
    with Profile() as profile:
        assert singles.earliest_clear(astray, 1) is found
    called = Stats(profile).get_stats_profile().func_profiles
    assert without_background.__name__ not in called


def test_a_sweep_of_a_few_points_is_passed_over() -> None:
    """Alone it could not tell its noise, of which the file says nothing."""
    sweeps = drifting([0.0] * 4, [0.02] * 4, [0.3] * 4)
    for name in ("real", "imag"):
        sweeps[name][0, 10:] = np.nan
    sweeps["frequency"][0, 5:10] = sweeps["frequency"].values[0, 4::-1]
    _, found = first_fit(sweeps, ("",), None)
    assert found["hidden"] == 1
    assert found["frequency"] == pytest.approx(999.6e3, abs=1)


def test_where_no_sweep_shows_another_mode_none_is_followed(tmp_path: Path) -> None:
    path = tmp_path / "still.nc"
    make(Draw("response", (), "exact", "square-270um", 3), path)
    model = posed(path)
    assert len(model.order_of_blocks) == 0
    assert followed(fit(ExtendedModel(model), model.start), DRIFT) is None
