"""Laws of series: lines, power laws, Arrhenius."""

import numpy as np
import pytest

from femnl.core.choices import Law
from femnl.core.errors import ParameterError
from femnl.fits.series.forms import BOLTZMANN
from femnl.fits.series.law import fit_series
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


@pytest.mark.parametrize("law", ["power", "arrhenius"])
def test_values_over_decades_without_errors_have_honest_intervals(law: Law) -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(100, 300, 12)
    name = {"power": "exponent", "arrhenius": "activation_energy"}[law]
    truth = {"power": -3.5, "arrhenius": -8e-21}[law]
    held = 0
    for _ in range(200):
        clean = (x / 200) ** truth if law == "power" else np.exp(-truth / (BOLTZMANN * x))
        y = 1e4 * clean * np.exp(0.05 * rng.normal(size=12))
        (found,) = fit_series(series({"temperature": x}, quality_factor=y), law)
        low, high = found.interval[name]
        held += low < truth < high
    # 95 % of 200 within three standard deviations
    assert abs(held / 200 - 0.95) < 0.047
    assert any("of each value" in note for note in found.fit.notes)


@pytest.mark.parametrize("law", ["line", "power", "arrhenius"])
def test_large_values_with_large_errors_are_determined(law: Law) -> None:
    t = np.linspace(100, 300, 12)
    q = 1e7 * np.exp(8e-21 / (BOLTZMANN * t))
    data = series({"temperature": t}, quality_factor=q, quality_factor_sd=0.1 * q)
    (found,) = fit_series(data, law)
    assert not any("do not determine" in note for note in found.fit.notes)
    assert all(0 < one.sd < np.inf for one in found.fit.parameters.values())


def test_stated_errors_are_taken_as_they_are_or_enlarged_by_the_scatter() -> None:
    rng = np.random.default_rng(4)
    x = np.linspace(0, 10, 40)
    y = 1e4 + 3 * x + 0.5 * rng.normal(size=40)
    # sd of a slope by linear regression: σ/√Σ(x − x̄)²
    exact = 0.5 / np.sqrt(np.sum((x - x.mean()) ** 2))
    for stated, enlarged in ((0.5, False), (0.1, True), (5.0, False)):
        data = series({"drive": x}, frequency=y, frequency_sd=np.full(40, stated))
        (found,) = fit_series(data)
        left = y - np.polyval(np.polyfit(x, y, 1), x)
        scatter = np.sqrt(np.sum(left**2) / 38)
        size = exact * (scatter if enlarged else stated) / 0.5
        assert found.fit.parameters["slope"].sd == pytest.approx(size, rel=1e-6)
        # The points are drawn with the errors that were used
        np.testing.assert_allclose(found.sd, scatter if enlarged else stated, rtol=1e-6)


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


def test_a_constant_without_errors_is_a_line_without_slope() -> None:
    (found,) = fit_series(series({"pressure": np.linspace(1, 300, 12)}, frequency=np.full(12, 7e5)))
    assert found.fit.parameters["value"].value == pytest.approx(7e5)
    assert found.fit.parameters["slope"].value == pytest.approx(0, abs=1e-12)
    assert found.fit.parameters["slope"].sd == pytest.approx(0, abs=1e-12)
