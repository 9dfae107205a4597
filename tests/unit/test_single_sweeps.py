"""What single sweeps tell of the sign of the phase, and searches that are not made twice."""

from cProfile import Profile
from pstats import Stats

import numpy as np
import pytest
import xarray as xr

from femnl.fits.response.first_fit import first_fit
from femnl.fits.response.fit import first_layout
from femnl.fits.response.limits import Limits
from femnl.fits.response.single_sweeps import SingleSweeps, beside_background, without_background
from femnl.fits.response.solve import settle, solve
from femnl.io.measurement import response
from femnl.observe.response.sweeps import collect

DRIVES = np.array([1.0, 2.0, 4.0, 8.0])
PUSHES = np.array([1.0, 1.6, 2.2, 2.6])
"""What the drives do, of which the strong ones are compressed."""


def compressed(sign: int = 1, leak: complex = 0.0) -> xr.Dataset:
    """Return sweeps of a linear mode, 100 Hz wide, whose drive is compressed."""
    rng = np.random.default_rng(2)
    f = np.linspace(999e3, 1001e3, 80)
    line = 0.02 * np.exp(0.3j) / (2 * (1e6 - f) / 100 + 1j)
    volts = PUSHES[:, None] * (line + leak)
    volts = volts + 1e-5 * (rng.standard_normal((2, *volts.shape)).T @ [1, 1j]).T
    turned = volts if sign > 0 else volts.conj()
    return response(f, turned, drive=DRIVES, noise_sd=1e-5)


@pytest.mark.parametrize("sign", [1, -1])
def test_clear_sweeps_show_the_sign_of_the_phase(sign: int) -> None:
    singles = SingleSweeps(compressed(sign), ("",))
    assert singles.show(sign)
    assert not singles.show(-sign)


def test_sweeps_that_a_leak_bends_do_not_show_it() -> None:
    assert not SingleSweeps(compressed(leak=0.02 + 0.02j), ("",)).show(1)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_other_sign_is_not_fitted_where_sweeps_show_this_one(sign: int) -> None:
    sweeps = compressed(sign)
    with Profile() as profile:
        found, _ = first_fit(sweeps, ("",), None)
    assert found == sign
    called = Stats(profile).get_stats_profile().func_profiles
    # For all sweeps and the first of them under the right sign, and for that under the other
    assert called[without_background.__name__].ncalls == "2"
    assert called[beside_background.__name__].ncalls == "2"


def test_a_full_search_is_remembered() -> None:
    sweeps = collect(compressed())
    layout = first_layout(sweeps, "complex")
    misfit, theta = solve(sweeps, layout, "complex", Limits.none(layout))
    cost = misfit.cost(theta)
    theta[:] = 0.0
    misfit.assign(theta)
    with Profile() as profile:
        again, same = solve(sweeps, layout, "complex", Limits.none(layout))
    assert settle.__name__ not in Stats(profile).get_stats_profile().func_profiles
    assert again.cost(same) == cost
    with Profile() as profile:
        solve(collect(compressed(-1)), layout, "complex", Limits.none(layout))
    assert settle.__name__ in Stats(profile).get_stats_profile().func_profiles
