"""Laws of series: lines, power laws, Arrhenius."""

import numpy as np
import pytest

from femnl.core.errors import ParameterError
from femnl.fits.series.law import BOLTZMANN, fit_series
from femnl.io.measurement import series
from femnl.plot.series import series_fit_figure


def test_a_line_has_its_slope_and_its_interval() -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(200):
        x = np.linspace(280, 320, 12)
        y = 1e4 - 0.0271 * (x - 300) + 0.01 * rng.normal(size=12)
        (found,) = fit_series(series({"temperature": x}, frequency=y))
        low, high = found.interval["slope"]
        held += low < -0.0271 < high
    assert found.fit.parameters["slope"].unit == "Hz/K"
    # 95 % of 200 within three standard deviations
    assert abs(held / 200 - 0.95) < 0.047


def test_power_and_arrhenius_laws_give_back_exponent_and_energy() -> None:
    rng = np.random.default_rng(2)
    x = np.geomspace(1, 1000, 15)
    q = 1e4 * x**-0.5
    sd = 0.01 * q
    data = series(
        {"pressure": x}, quality_factor=q + sd * rng.normal(size=15), quality_factor_sd=sd
    )
    (power,) = fit_series(data, "power")
    assert abs(power.fit["exponent"] + 0.5) < 4 * power.fit.parameters["exponent"].sd
    t = np.linspace(100, 300, 15)
    energy = 0.05 * 1.602176634e-19
    q = 1e5 * np.exp(energy / (BOLTZMANN * t))
    sd = 0.01 * q
    data = series(
        {"temperature": t}, quality_factor=q + sd * rng.normal(size=15), quality_factor_sd=sd
    )
    (found,) = fit_series(data, "arrhenius")
    one = found.fit.parameters["activation_energy"]
    assert abs(one.value + energy) < 4 * one.sd
    assert series_fit_figure(found).axes[1].get_ylabel() == "residual (σ)"
    with pytest.raises(ParameterError, match="temperature"):
        fit_series(series({"pressure": x}, quality_factor=x), "arrhenius")
