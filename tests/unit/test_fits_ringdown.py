"""Ring-downs against the closed law and time integration, and the coverage of their intervals."""

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import Fit
from femnl.core.resonator import Array, Complex, Resonator
from femnl.fits.decay.model import Decay, Signal
from femnl.fits.decay.ringdown import fit_ringdown, fit_ringdown_trace
from femnl.io.measurement import trace
from femnl.resonator import couple, integrate, ring_down

MODE = Resonator(2e4, 4000, alpha=3e10, nonlinear_damping=1.2e14)
START = 2e-7
GAIN = 1e6


def pull(fit: Fit, name: str, truth: float) -> float:
    return (fit[name] - truth) / fit.parameters[name].sd


def record(
    kind: Signal, seed: int, noise: float = 2e-3, mode: Resonator = MODE
) -> tuple[Array, Array | Complex]:
    """A decay over ten amplitude decay times, down into the noise."""
    rng = np.random.default_rng(seed)
    count = 60_000 if kind == "voltage" else 800
    time = np.linspace(0, 20 / mode.damping, count)
    amplitude = GAIN * ring_down(mode, START * np.exp(0.4j), time)
    if kind == "voltage":
        return time, amplitude.real + noise * rng.normal(size=count)
    slow = amplitude * np.exp(-2j * np.pi * (mode.frequency + 3) * time) + noise * (
        rng.normal(size=count) + 1j * rng.normal(size=count)
    )
    return time, slow if kind == "complex" else np.abs(slow)


@pytest.mark.parametrize("kind", ["voltage", "complex", "magnitude"])
def test_frequency_quality_factor_and_their_amplitude_dependence_come_back(kind: Signal) -> None:
    time, signal = record(kind, 1)
    tone = MODE.frequency + (3 if kind == "complex" else 0)
    fit = fit_ringdown(
        time, signal, kind, frequency=None if kind == "voltage" else tone, responsivity=GAIN
    )
    truth = {"quality_factor": 4000.0, "eta": MODE.nonlinear_damping, "amplitude": GAIN * START}
    if kind == "magnitude":
        truth["floor"] = 2 * 2e-3**2
    else:
        truth |= {"frequency": MODE.frequency, "alpha": MODE.alpha, "phase": 0.4}
    for name, value in truth.items():
        assert abs(pull(fit, name, value)) < 4, name
        assert fit.parameters[name].sd < 0.15 * abs(value), name
    assert 0.8 < fit.chi2_reduced < 1.2


@pytest.mark.slow
def test_a_decay_integrated_in_time_gives_back_its_equation() -> None:
    mode = Resonator(2e4, 500, alpha=3e10, nonlinear_damping=6e13)
    time = np.linspace(0, 16 / mode.damping, 8_000)
    q, _ = integrate(couple([mode]), [0.0], mode.frequency, [START], [0.0], time)
    fit = fit_ringdown(time, GAIN * q[0], responsivity=GAIN)
    # What is left is second order in α A², 1.2e-3, and in 1/Q: far more than the noise of the
    # integration.
    assert fit["frequency"] == pytest.approx(mode.frequency, rel=1e-5)
    assert fit["quality_factor"] == pytest.approx(500, rel=1e-3)
    assert fit["alpha"] == pytest.approx(3e10, rel=0.02)
    assert fit["eta"] == pytest.approx(6e13, rel=0.01)


def test_a_linear_decay_needs_no_nonlinear_terms() -> None:
    mode = Resonator(2e4, 4000)
    time, signal = record("voltage", 3, mode=mode)
    free = fit_ringdown(time, signal)
    plain = fit_ringdown(time, signal, nonlinear=False)
    assert abs(pull(free, "damping_ratio", 0)) < 4
    assert abs(pull(free, "pull", 0)) < 4
    assert abs(pull(plain, "quality_factor", 4000)) < 4
    assert plain.parameters["quality_factor"].sd < free.parameters["quality_factor"].sd
    assert fit_ringdown(*record("voltage", 3), nonlinear=False, noise_sd=2e-3).chi2_reduced > 5


@pytest.mark.parametrize("kind", [pytest.param("complex", marks=pytest.mark.slow), "magnitude"])
@pytest.mark.slow
def test_intervals_of_ring_downs_hold_the_truth_two_times_in_three(kind: Signal) -> None:
    inside = []
    for seed in range(120):
        time, signal = record(kind, seed)
        fit = fit_ringdown(
            time,
            signal,
            kind,
            frequency=MODE.frequency + (3 if kind == "complex" else 0),
            responsivity=GAIN,
        )
        inside.append(
            [
                abs(pull(fit, "quality_factor", 4000)) < 1,
                abs(pull(fit, "eta", MODE.nonlinear_damping)) < 1,
            ]
        )
    # 0.683 ± 3 √(0.683·0.317/120)
    np.testing.assert_allclose(np.mean(inside, axis=0), 0.683, atol=0.127)


def test_a_trace_of_a_measurement_file_is_fitted() -> None:
    time, signal = record("voltage", 5)
    data = trace(time, signal[None], drive_frequency=[MODE.frequency], noise_sd=2e-3)
    fit = fit_ringdown_trace(data)
    assert abs(pull(fit, "quality_factor", 4000)) < 4
    assert fit.chi2_reduced == pytest.approx(1, abs=0.05)
    with pytest.raises(ParameterError, match="step = 3"):
        fit_ringdown_trace(data, 3)


def test_derivatives_match_differences() -> None:
    time, signal = record("voltage", 7)
    for kind in ("voltage", "complex", "magnitude"):
        decay = Decay(
            time[::50], signal[::50].astype(complex), kind, MODE.frequency, nonlinear=True
        )
        values = np.array(
            [0.2, 30.0, 0.7, 1e-6]
            if kind == "magnitude"
            else [0.2, 30.0, 0.7, 0.4, 3.0, 5.0, 0.01][: len(decay.names)]
        )
        slopes = decay.jacobian(values)
        for k, value in enumerate(values):
            step = np.zeros(len(values))
            step[k] = 1e-6 * value
            numeric = (decay.model(values + step) - decay.model(values - step)) / (2e-6 * value)
            np.testing.assert_allclose(
                slopes[:, k], numeric, atol=1e-5 * np.abs(slopes[:, k]).max()
            )


def test_records_without_a_decay_are_refused_in_one_line() -> None:
    time = np.linspace(0, 1, 1000)
    with pytest.raises(MeasurementError, match="nothing decays"):
        fit_ringdown(time, 1 + 5 * time, "magnitude")
    with pytest.raises(MeasurementError, match="fewer than 64 periods"):
        fit_ringdown(time, np.cos(2 * np.pi * 20 * time))
    with pytest.raises(MeasurementError, match="evenly spaced"):
        fit_ringdown(time**2, np.cos(600 * time))
    with pytest.raises(MeasurementError, match="at least 16 samples"):
        fit_ringdown(time[:5], time[:5])
    with pytest.raises(MeasurementError, match=r"is 0\.5 V throughout"):
        fit_ringdown(time, np.full(1000, 0.5))
    unknown: Any = "power"
    with pytest.raises(ParameterError, match="kind = 'power'"):
        fit_ringdown(time, time, unknown)


def test_a_phase_that_ends_at_zero_is_known() -> None:
    """Of a decay that is real at the frequency of demodulation, with noise in its real part."""
    rng = np.random.default_rng(4)
    time = np.linspace(0, 4.0, 400)
    size = np.exp(-time) + 0.01 * rng.standard_normal(400)
    fit = fit_ringdown(time, size.astype(complex), "complex", frequency=2e4, nonlinear=False)
    phase = fit.parameters["phase"]
    assert abs(phase.value) < 1e-3 * phase.sd
    assert np.isfinite(phase.sd)
    assert not any("do not determine" in note for note in fit.notes)


def slow(q: float, interval: float, count: int, drawn: np.random.Generator) -> tuple[Any, Any]:
    """Return times and a linear decay of 20 kHz, with noise of 1 mV."""
    t = np.arange(count) * interval
    v = 0.2 * np.exp(-np.pi * 20e3 / q * t) * np.cos(2 * np.pi * 20e3 * t + 0.4)
    return t, v + 1e-3 * drawn.standard_normal(count)


def test_a_record_from_before_the_switch_off_is_no_ring_down() -> None:
    rng = np.random.default_rng(4)
    _, v = slow(2000, 1e-5, 20_000, rng)
    driven = 0.2 * np.cos(2 * np.pi * 20e3 * 1e-5 * np.arange(-5000, 0) + 0.4)
    v = np.concatenate([driven + 1e-3 * rng.standard_normal(5000), v])
    fit = fit_ringdown(1e-5 * np.arange(len(v)), v)
    assert not np.isfinite(fit.parameters["quality_factor"].sd)
    assert fit.chi2_reduced > 2
    told = " ".join(fit.notes)
    assert "the model misses the data: what is left within" in told
    assert "the amplitude hardly falls at first; the record may begin before the drive" in told
    assert "far from the mode is taken for noise, 0.00" in told


def test_two_modes_in_one_record_are_no_ring_down() -> None:
    rng = np.random.default_rng(5)
    t, v = slow(2000, 1e-5, 20_000, rng)
    v += 0.1 * np.exp(-np.pi * 20e3 / 2000 * t) * np.cos(2 * np.pi * 20_150 * t)
    fit = fit_ringdown(t, v, nonlinear=False)
    assert any("the model misses the data" in note for note in fit.notes)
    q = fit.parameters["quality_factor"]
    assert abs(q.value - 2000) < q.sd < 500


def test_noise_is_not_told_as_a_misfit() -> None:
    """Of 60 decays in white noise, and of 20 whose noise a lock-in filtered, none is."""
    rng = np.random.default_rng(6)
    for k in range(80):
        t, v = slow(2000, 1e-5, 20_000, rng)
        if k < 60:
            fit = fit_ringdown(t, v)
        else:
            turned = 2 * v * np.exp(-2j * np.pi * 20e3 * t)
            low = lfilter([0.2], [1, -0.8], lfilter([0.2], [1, -0.8], turned))[200::8]
            fit = fit_ringdown(t[200::8], low, "complex", frequency=20e3)
        assert not any("misses" in note for note in fit.notes)


def test_a_decay_of_few_periods_names_its_own_line() -> None:
    t = 1e-7 * np.arange(4000)
    v = np.exp(-np.pi * 1e5 / 3 * t) * np.cos(2 * np.pi * 1e5 * t)
    with pytest.raises(
        MeasurementError, match=r"64 periods of (9|10)\d{4}\.?\d* Hz, the strongest"
    ):
        fit_ringdown(t, v)


def test_what_is_far_below_the_stated_noise_is_no_misfit() -> None:
    t, v = slow(2000, 1e-5, 20_000, np.random.default_rng(9))
    v = v + 2e-3 * np.exp(-np.pi * 20e3 / 2000 * t) * np.cos(2 * np.pi * 20_150 * t)
    assert any("misses" in note for note in fit_ringdown(t, v).notes)
    fit = fit_ringdown(t, v, noise_sd=0.1)
    assert not any("misses" in note for note in fit.notes)
    assert fit.parameters["quality_factor"].sd > 20


def test_stamps_that_repeat_and_numbers_without_noise_are_fitted() -> None:
    t = np.repeat(np.arange(60) / 10, 3)
    v = np.exp(-0.5 * t) * np.exp(0.3j)
    fit = fit_ringdown(t, v, "complex", frequency=1e3)
    assert fit["decay_rate"] == pytest.approx(1.0, rel=1e-6)
    assert not any("misses" in note for note in fit.notes)
