"""Fits of sweeps as laboratories record them: any Q, backgrounds, delays, either sign of phase."""

import re
import sys

import numpy as np
import pytest
import xarray as xr

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.readout import Array, ComplexArray
from femnl.fits.response.each import fit_each_sweep
from femnl.fits.response.fit import fit_response, predict_response
from femnl.fits.response.modes import fit_modes
from femnl.fits.spectrum.peaks import find_peaks
from femnl.io import measurement
from femnl.io.measurement import magnitudes_alone, response
from femnl.observe.response.branches import STIFFEN
from femnl.observe.response.extent import extent
from femnl.observe.response.sweeps import collect
from femnl.plot.response import response_figure

SEED = 5
"""Of the study, printed by its test."""


def line(f: Array, f0: float, w: float) -> ComplexArray:
    """Return the closed form of the linear oscillator, −i on resonance."""
    return np.asarray(f0 * w / ((f0 - f) * (f0 + f) + 1j * f * w))


def noise(rng: np.random.Generator, shape: tuple[int, ...], sd: float) -> ComplexArray:
    return np.asarray(sd * (rng.normal(size=shape) + 1j * rng.normal(size=shape)))


@pytest.mark.parametrize("q", [3.0, 10.0, 60.0, 300.0, 1e5])
def test_the_linear_oscillator_is_exact_at_any_quality_factor(q: float) -> None:
    f0 = 4e3
    w = f0 / q
    f = np.linspace(max(f0 - 4 * w, 0.1 * f0), f0 + 5 * w, 201)
    data = response(f[None], (0.2 - 0.1j) * line(f, f0, w)[None], drive=[1.0], noise_sd=2.2e-5)
    fit = fit_response(data)
    assert not fit.duffing
    # Data without noise, errors of a signal-to-noise ratio of 1e4: what is off is the model's
    assert abs(fit["frequency"] - f0) < 0.1 * fit.parameters["frequency"].sd
    assert abs(fit["quality_factor"] - q) < 0.1 * fit.parameters["quality_factor"].sd
    free = fit_response(data, duffing=True)
    assert abs(free["alpha_ratio"]) < 0.1 * free.parameters["alpha_ratio"].sd


def test_the_duffing_response_obeys_its_harmonic_balance_at_low_quality_factor() -> None:
    f0, w, ratio = 1000.0, 100.0, 3.0
    f = np.linspace(600, 1500, 181)
    x = np.full(f.size, 1e-3)
    both = []
    for start in (1e-3, 0.99):
        # The balance |D|² x = 1 by bisection along the sweep, from either side
        x = np.array([_root(g, f0, w, ratio, from_top=start > 0.5) for g in f])
        both.append(x)
    up = both[1]
    d = (f0**2 - f**2) / (f0 * w) + STIFFEN * ratio * up + 1j * f / f0
    rng = np.random.default_rng(2)
    volts = np.exp(0.4j) / d + noise(rng, f.shape, 1e-3)
    fit = fit_response(response(f[None], volts[None], drive=[1.0], direction=[1], noise_sd=1e-3))
    assert fit.duffing
    for name, truth in (("frequency", f0), ("linewidth", w), ("alpha_ratio", ratio)):
        assert abs(fit[name] - truth) < 4 * fit.parameters[name].sd
    assert fit.chi2_reduced < 1.3


def _root(f: float, f0: float, w: float, ratio: float, *, from_top: bool) -> float:
    """Return a root of |D(x)|² x = 1 by the polynomial in x."""
    delta = (f0**2 - f**2) / (f0 * w)
    a = STIFFEN * ratio
    roots = np.roots([a**2, 2 * delta * a, delta**2 + (f / f0) ** 2, -1.0])
    real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    return float(real[-1] if from_top else real[0])


@pytest.mark.parametrize("background", ["constant", "slope"])
def test_a_background_is_found_and_not_taken_for_a_duffing_term(background: str) -> None:
    rng = np.random.default_rng(4)
    f0, w = 3966.7, 66.7
    f = np.linspace(3765, 4168, 200)
    behind = 0.1 + 0.05j + (0.2j - 0.1) * (f - f0) / 400 * (background == "slope")
    volts = line(f, f0, w) + behind + noise(rng, f.shape, 1e-3)
    fit = fit_response(response(f[None], volts[None], drive=[1.0]))
    assert fit.background == background
    assert not fit.duffing
    assert fit.parameters["alpha_ratio"].sd > 0
    assert abs(fit["frequency"] - f0) < 4 * fit.parameters["frequency"].sd
    assert abs(fit["background_real"] - 0.1) < 5 * fit.parameters["background_real"].sd
    assert any("model chosen by evidence" in note for note in fit.notes)


def test_a_background_that_grows_with_the_drive_is_told_from_one_that_does_not() -> None:
    rng = np.random.default_rng(6)
    f = np.linspace(1681, 1684, 101)
    drives = np.array([1.0, 2.0, 5.0])
    shape = line(f, 1682.3, 0.4)
    for driven in (True, False):
        behind = (0.2 - 0.1j) * (drives if driven else np.ones(3))
        volts = drives[:, None] * shape + behind[:, None] + noise(rng, (3, 101), 2e-3)
        fit = fit_response(response(f, volts, drive=drives, noise_sd=2e-3))
        assert fit.driven is driven
        assert fit.parameters["background_real"].unit == ("V/V" if driven else "V")


@pytest.mark.parametrize("stiffening", [0.0, 8.0])
def test_a_rising_phase_is_conjugated_and_told(stiffening: float) -> None:
    rng = np.random.default_rng(8)
    f0, w = 1e5, 10.0
    f = np.linspace(f0 - 40, f0 + 120, 301)
    x = np.array([_root(g, f0, w, stiffening or 1e-9, from_top=True) for g in f])
    a = STIFFEN * (stiffening or 1e-9)
    volts = 1 / ((f0 - f) * (f0 + f) / (f0 * w) + a * x + 1j * f / f0) * np.exp(0.8j)
    volts = volts + noise(rng, f.shape, 2e-3)
    falling = response(f[None], volts[None], drive=[1.0], direction=[1], noise_sd=2e-3)
    rising = response(f[None], volts.conj()[None], drive=[1.0], direction=[1], noise_sd=2e-3)
    plain = fit_response(falling)
    turned = fit_response(rising)
    assert (plain.phase_sign, turned.phase_sign) == (1, -1)
    for name in ("frequency", "linewidth", "phase"):
        assert turned[name] == pytest.approx(plain[name], abs=0.01 * plain.parameters[name].sd)
    assert any("exp(−iωt)" in note for note in turned.notes)
    rest = predict_response(turned, rising).values - volts.conj()
    assert np.mean(np.abs(rest) ** 2) < 1.2 * 2 * 2e-3**2


def test_errors_are_scaled_or_withheld_where_the_model_misses_the_data() -> None:
    rng = np.random.default_rng(9)
    f = np.linspace(990, 1010, 200)
    good = line(f, 1000, 2) + noise(rng, f.shape, 3e-3)
    honest = fit_response(response(f[None], good[None], noise_sd=3e-3))
    half = fit_response(response(f[None], good[None], noise_sd=1.5e-3))
    assert (honest.errors, half.errors) == ("stated", "scaled")
    assert half.parameters["frequency"].sd == pytest.approx(
        honest.parameters["frequency"].sd, rel=0.05
    )
    # Noise that is estimated is no statement: what the fit leaves decides
    guessed = fit_response(response(f[None], good[None]))
    assert guessed.errors == "scaled"
    assert guessed.parameters["frequency"].sd == pytest.approx(
        honest.parameters["frequency"].sd, rel=0.1
    )
    two = line(f, 998, 2) + 0.7 * line(f, 1003, 2) + noise(rng, f.shape, 1e-4)
    missed = fit_response(response(f[None], two[None], noise_sd=1e-4))
    assert missed.errors == "withheld"
    assert np.isnan(missed.parameters["frequency"].sd)
    assert any("the model misses the data: χ²/ν" in note for note in missed.notes)


def test_parameters_are_held_and_the_duffing_term_left_out() -> None:
    rng = np.random.default_rng(10)
    f = np.linspace(990, 1010, 200)
    data = response(f[None], (line(f, 1000, 2) + noise(rng, f.shape, 3e-3))[None], noise_sd=3e-3)
    fit = fit_response(data, duffing=False, fixed={"linewidth": 2.5})
    assert fit["linewidth"] == pytest.approx(2.5)
    assert fit.parameters["linewidth"].sd == 0
    assert fit["alpha_ratio"] == 0
    assert fit.covariance.shape == (fit.n_parameters, fit.n_parameters)
    with pytest.raises(ParameterError, match="fixed: 'width' is no parameter"):
        fit_response(data, fixed={"width": 2.5})


def test_magnitudes_alone_are_fitted_with_their_background() -> None:
    rng = np.random.default_rng(11)
    f = np.linspace(3765, 4168, 300)
    clean = 1e-2 * line(f, 3966.7, 66.7) + 2e-3 * np.exp(0.5j)
    size = np.abs(clean + noise(rng, f.shape, 2e-5))
    data = magnitudes_alone(response(f[None], size[None], drive=[1.0], noise_sd=2e-5))
    fit = fit_response(data)
    assert fit.use == "magnitude"
    assert fit.background != "none"
    assert abs(fit["frequency"] - 3966.7) < 5 * fit.parameters["frequency"].sd
    assert abs(fit["linewidth"] - 66.7) < 5 * fit.parameters["linewidth"].sd
    with pytest.raises(ParameterError, match="magnitudes alone"):
        fit_response(data, "complex")


def test_alpha_of_the_signal_is_per_square_volt() -> None:
    f = np.linspace(990, 1010, 200)
    rng = np.random.default_rng(12)
    volts = line(f, 1000, 2)[None] + noise(rng, (1, 200), 1e-3)
    fit = fit_response(response(f[None], volts, drive=[0.1], noise_sd=1e-3), duffing=True)
    assert fit.parameters["alpha_y"].unit == "V⁻²"


def test_each_sweep_makes_a_series_and_two_modes_are_fitted_in_one_span() -> None:
    rng = np.random.default_rng(13)
    f = np.linspace(990, 1010, 300)
    temperature = np.array([4.0, 5.0, 6.0, 7.0])
    volts = np.array([line(f, 1000 - 0.5 * t, 2) for t in temperature]) + noise(rng, (4, 300), 2e-3)
    data = response(f, volts, drive=np.ones(4), temperature=temperature, noise_sd=2e-3)
    fits, series = fit_each_sweep(data)
    assert len(fits) == 4
    np.testing.assert_allclose(series["frequency"], 1000 - 0.5 * temperature, atol=0.02)
    assert list(series.coords) == ["temperature"]
    with pytest.raises(MeasurementError, match="no control variable differs"):
        fit_each_sweep(data.drop_vars("temperature"))
    alone = data.isel(sweep=[0])
    one = fit_modes(alone, 1).fit.parameters["frequency[1]"].sd
    # The other estimator, whose background has one degree less
    other = fit_response(alone, background="slope", duffing=False, delay=False)
    assert one == pytest.approx(other.parameters["frequency"].sd, rel=0.3)
    both = line(f, 998, 2) + 0.7j * line(f, 1001, 1.5) + 0.1 + noise(rng, f.shape, 1e-3)
    found = fit_modes(response(f[None], both[None], noise_sd=1e-3), 2).fit
    for name, truth in (("frequency[1]", 998), ("frequency[2]", 1001), ("linewidth[2]", 1.5)):
        assert abs(found[name] - truth) < 5 * found.parameters[name].sd


@pytest.mark.parametrize("linewidths", [3, 8, 15, 30, 120, 400])
def test_an_overview_finds_one_line_in_a_span_of_any_number_of_linewidths(linewidths: int) -> None:
    rng = np.random.default_rng(14)
    f = np.linspace(1e4 - 4.5 * linewidths, 1e4 + 5.5 * linewidths, 401)
    volts = 1e-3 * line(f, 1e4, 10.0) + 1e-4 + noise(rng, f.shape, 1e-6)
    peaks = find_peaks(response(f[None], volts[None], noise_sd=1e-6))
    assert len(peaks.frequency) == 1
    assert abs(peaks.frequency[0] - 1e4) < 5 * peaks.frequency_sd[0]
    assert abs(peaks.linewidth[0] - 10) < 5 * peaks.linewidth_sd[0]


def test_a_figure_of_a_fit_draws_what_it_leaves() -> None:
    f = np.linspace(990, 1010, 200)
    volts = line(f, 1000, 2)[None] + noise(np.random.default_rng(15), (1, 200), 1e-3)
    data = response(f[None], volts, noise_sd=1e-3)
    figure = response_figure(data, predict_response(fit_response(data), data))
    assert figure.axes[2].get_ylabel() == "residual (σ)"
    drawn = np.concatenate([np.asarray(one.get_ydata()) for one in figure.axes[2].lines[:2]])
    assert np.std(drawn) == pytest.approx(1, abs=0.1)


def test_a_point_within_a_jump_does_not_press_other_residuals_onto_zero() -> None:
    f = np.linspace(990, 1010, 200)
    model = line(f, 1000, 2)[None]
    volts = model + noise(np.random.default_rng(18), (1, 200), 1e-3)
    fitted = xr.DataArray(model, dims=("sweep", "point"))
    plain = response_figure(response(f[None], volts, noise_sd=1e-3), fitted).axes[2]
    assert plain.get_yscale() == "linear"
    volts[0, 100] += 2
    panel = response_figure(response(f[None], volts, noise_sd=1e-3), fitted).axes[2]
    assert panel.get_yscale() == "symlog"
    low, high = panel.get_ylim()
    # All points are within the panel, 2 V at 1 mV a standard deviation
    assert high > 2000
    assert low == -high


def test_magnitudes_are_kept_by_a_file_and_negative_ones_refused(tmp_path: object) -> None:
    f = np.linspace(1, 2, 20)
    data = magnitudes_alone(response(f[None], np.ones((1, 20))))
    path = f"{tmp_path}/m.nc"
    measurement.write(measurement.bundle({"m": data}), path)
    assert "magnitude" in measurement.read(path)["m"].to_dataset()
    with pytest.raises(MeasurementError, match="is negative"):
        measurement.bundle({"m": data.assign(magnitude=-data["magnitude"])})


def test_weak_magnitudes_are_those_of_a_signal_in_noise() -> None:
    rng = np.random.default_rng(19)
    f = np.linspace(960, 1040, 1200)
    sd = 0.05
    # Far from resonance the signal is half of the noise, whose mean magnitude is √(π/2) σ
    size = np.abs(line(f, 1000, 2) + noise(rng, f.shape, sd))
    data = magnitudes_alone(response(f[None], size[None], drive=[1.0], noise_sd=sd))
    fit = fit_response(data, background="none", duffing=False)
    assert fit.chi2_reduced < 1 + 4 * np.sqrt(2 / 1200)
    assert abs(fit["frequency"] - 1000) < 4 * fit.parameters["frequency"].sd
    assert abs(fit["linewidth"] - 2) < 4 * fit.parameters["linewidth"].sd
    assert abs(fit["y_max"] - 1) < 4 * fit.parameters["y_max"].sd


def test_alike_residuals_count_only_as_many_as_are_independent() -> None:
    rng = np.random.default_rng(20)
    f = np.linspace(990, 1010, 200)
    two = line(f, 1000, 2) + 0.05 * line(f, 1003, 1) + noise(rng, f.shape, 3e-3)
    data = response(f[None], two[None], noise_sd=3e-3)
    fit = fit_response(data, background="none", duffing=False, delay=False)
    assert 4 < fit.chi2_reduced < 25
    (told,) = [note for note in fit.notes if "the model misses the data" in note]
    alike, factor = re.findall(r"correlation ([\d.]+)\).*scaled by ([\d.]+)", told)[0]
    # Of residuals with a correlation r, n(1 − r)/(1 + r) are independent
    r = float(alike)
    assert float(factor) == pytest.approx(np.sqrt(fit.chi2_reduced * (1 + r) / (1 - r)), rel=0.03)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_delay_has_its_value_and_its_sign(sign: int) -> None:
    rng = np.random.default_rng(16)
    f0, w = 1e5, 10.0
    f = np.linspace(f0 - 60, f0 + 60, 241)
    tau = sign * 2e-3
    # A signal that comes later by τ has the phase −2πfτ
    volts = line(f, f0, w) * np.exp(-2j * np.pi * (f - f0) * tau) + noise(rng, f.shape, 2e-3)
    fit = fit_response(response(f[None], volts[None], noise_sd=2e-3), duffing=False)
    assert abs(fit["delay"] - tau) < 4 * fit.parameters["delay"].sd
    assert fit.parameters["delay"].sd < 0.02 * abs(tau)


def test_a_duffing_term_must_gain_five_beyond_its_price() -> None:
    f0, w, sd = 1e5, 10.0, 2e-2
    f = np.linspace(f0 - 40, f0 + 40, 161)
    # About three standard deviations of α_y/α_c, so that gains lie on either side of 0 and 5
    x = np.array([_root(g, f0, w, 0.03, from_top=True) for g in f])
    clean = 1 / ((f0 - f) * (f0 + f) / (f0 * w) + STIFFEN * 0.03 * x + 1j * f / f0)
    gains = []
    for seed in range(8):
        volts = clean + noise(np.random.default_rng([17, seed]), f.shape, sd)
        data = response(f[None], volts[None], direction=[1], noise_sd=sd)
        fit = fit_response(data, background="none", delay=False, phase_sign=1)
        linear = min(v for key, v in fit.evidence.items() if key.endswith("linear"))
        duffing = min(v for key, v in fit.evidence.items() if key.endswith("a Duffing term"))
        gains.append(linear - duffing)
        assert fit.duffing == (linear - duffing > 5)
    assert any(0 < gain < 5 for gain in gains)
    assert any(gain > 5 for gain in gains)


def draw(rng: np.random.Generator) -> tuple[xr.Dataset, dict[str, float]]:
    """Draw a linear oscillator of Q 3…1e8 with background, delay, phase and noise."""
    q = 10 ** rng.uniform(np.log10(3), 8)
    f0 = 10 ** rng.uniform(1, 8)
    w = f0 / q
    n = int(rng.integers(80, 400))
    left, right = rng.uniform(2.5, 12, 2)
    f = np.linspace(max(f0 - left * w, 0.05 * f0), f0 + right * w, n)
    size = 10 ** rng.uniform(-6, 0)
    sd = size / 10 ** rng.uniform(np.log10(20), 4)
    terms = int(rng.choice([0, 1, 2]))
    c0 = size * 10 ** rng.uniform(-1.5, 0.5) * np.exp(2j * np.pi * rng.uniform()) * (terms > 0)
    c1 = size * 10 ** rng.uniform(-1.5, 0) * np.exp(2j * np.pi * rng.uniform()) * (terms > 1)
    tau = rng.choice([0, 1]) * rng.uniform(-1, 1) / np.ptp(f)
    turn = np.exp(-2j * np.pi * (f - f0) * tau)
    behind = (c0 + c1 * (f - f0) / np.ptp(f)) * (turn if rng.uniform() < 0.5 else 1)
    volts = size * np.exp(2j * np.pi * rng.uniform()) * line(f, f0, w) * turn + behind
    volts = volts + noise(rng, f.shape, sd)
    sign = int(rng.choice([1, -1]))
    volts = volts if sign > 0 else volts.conj()
    stated = sd if rng.uniform() < 0.5 else None
    data = response(f[None], volts[None], drive=[1.0], noise_sd=stated)
    return data, {"frequency": f0, "quality_factor": q, "sign": sign}


def study(count: int) -> tuple[int, int, Array]:
    """Return how many fits fail, how many have a Duffing term, and the share within 68 %."""
    failed = 0
    duffing = 0
    within = []
    for k in range(count):
        data, truth = draw(np.random.default_rng([SEED, k]))
        fit = fit_response(data)
        names = ("frequency", "quality_factor")
        pulls = np.array([(fit[name] - truth[name]) / fit.parameters[name].sd for name in names])
        failed += not (np.all(np.abs(pulls) < 5) and fit.phase_sign == truth["sign"])
        duffing += fit.duffing
        within.append(np.abs(pulls) < 1)
    return failed, duffing, np.asarray(np.mean(within, axis=0))


@pytest.mark.slow
def test_thirty_random_oscillators_are_found() -> None:
    failed, duffing, within = study(30)
    assert failed == 0
    assert duffing <= 1
    np.testing.assert_allclose(within, 0.683, atol=0.26)


@pytest.mark.slow
def test_a_thousand_random_oscillators_are_found() -> None:
    failed, duffing, within = study(1000)
    sys.stdout.write(f"seed {SEED}: {failed} failed, {duffing} Duffing, {within} within 68 %\n")
    assert failed <= 10
    assert duffing <= 20
    np.testing.assert_allclose(within, 0.68, atol=0.03)


def test_one_frequency_of_strong_motion_is_as_wide_as_a_step() -> None:
    """A place of a partner mode is sought in that range, which must not vanish."""
    rng = np.random.default_rng(3)
    frequency = np.tile(1e6 + 2.0 * np.arange(20), (3, 1))
    volts = 1e-5 * (rng.standard_normal((3, 20)) + 1j * rng.standard_normal((3, 20)))
    volts[:, 7] += 1.0
    data = measurement.response(frequency, volts, noise_sd=1e-5, drive=[0.5, 0.7, 1.0])
    seen = extent(collect(data), np.ones(1), np.ones(60, dtype=bool))
    assert (seen.middle, seen.width) == (1e6 + 14.0, 2.0)
