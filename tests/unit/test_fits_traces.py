"""Traces: harmonics as they were put in, noise estimated, jitter undone."""

import numpy as np
import pytest
import xarray as xr

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.readout import Array, ComplexArray
from femnl.device.geometry import load
from femnl.fits.trace.decompose import decompose
from femnl.fits.trace.jitter import align, jitter_gain
from femnl.fits.trace.pose import pose
from femnl.io.measurement import trace as record
from femnl.observe.film import SimulatedFilm
from femnl.optics.fringe import SineFringe
from femnl.optics.harmonics import harmonics, trace

RED = 632.8e-9
F = 1.466e6
FRINGE = SineFringe(RED, 0.1, 0.02, 0.6)
TIME = np.arange(1024) / 125e6
"""The oscilloscope of the paper: 1024 samples at 125 MSa/s, 12.01 periods."""
U = 6.5e-7
PHI = 0.4
TRUTH = harmonics(FRINGE, np.arange(22), U, PHI)


def noisy(noise: float, seed: int, n_steps: int = 1, delay: Array | None = None) -> Array:
    rng = np.random.default_rng(seed)
    shift = np.zeros(n_steps) if delay is None else delay
    clean = np.array([trace(FRINGE, TIME - one, F, U, PHI) for one in shift])
    return clean + noise * rng.normal(size=clean.shape)


def test_harmonics_to_the_21st_come_back_from_a_record_of_broken_periods() -> None:
    found = decompose(record(TIME, noisy(0, 0), drive_frequency=[F]), n_harmonics=40)
    assert np.abs(found.values[:22, 0] - TRUTH).max() < 1e-13


def test_deviations_of_the_harmonics_are_of_the_stated_size() -> None:
    found = decompose(
        record(TIME, noisy(2e-3, 1, 200), drive_frequency=np.full(200, F)), n_harmonics=21
    )
    deviation: ComplexArray = (found.values - TRUTH[:, None]) / found.values_sd
    assert np.var(deviation[1:].real) == pytest.approx(1, abs=0.07)
    assert np.var(deviation[1:].imag) == pytest.approx(1, abs=0.07)
    assert found.noise_sd.mean() == pytest.approx(2e-3, rel=0.01)
    assert found.values_sd[5, 0] == pytest.approx(2e-3 * np.sqrt(2 / 1024), rel=0.05)


def test_missing_samples_are_left_out() -> None:
    voltage = noisy(0, 0)
    voltage[0, np.random.default_rng(0).random(1024) < 0.3] = np.nan
    found = decompose(record(TIME, voltage, drive_frequency=[F]), n_harmonics=40)
    assert np.abs(found.values[:22, 0] - TRUTH).max() < 1e-12


def test_each_step_is_decomposed_at_its_own_frequency() -> None:
    frequency = F + np.array([-2e3, 0, 3e3])
    amplitude = np.array([1e-7, 3e-7, 5e-7])
    voltage = np.array(
        [trace(FRINGE, TIME, f, a) for f, a in zip(frequency, amplitude, strict=True)]
    )
    found = decompose(record(TIME, voltage, drive_frequency=frequency), n_harmonics=30)
    assert np.abs(found.values[:10] - harmonics(FRINGE, np.arange(10), amplitude)).max() < 1e-12


def test_recorded_drive_gives_frequency_and_origin_of_the_phase() -> None:
    drive = 0.7 * np.cos(2 * np.pi * F * TIME + 1.1)
    data = record(TIME, trace(FRINGE, TIME, F, U, PHI + 1.1)[None], drive_voltage=drive[None])
    found = decompose(data, n_harmonics=21)
    assert found.drive_frequency[0] == pytest.approx(F, rel=1e-7)
    assert np.abs(found.values[:10, 0] - TRUTH[:10]).max() < 1e-6


def test_jitter_weakens_the_plain_mean_as_predicted_and_alignment_restores_it() -> None:
    s = 12e-9
    delay = s * np.random.default_rng(7).normal(size=400)
    shots = decompose(
        record(TIME, noisy(1e-3, 3, 400, delay), drive_frequency=np.full(400, F)), n_harmonics=21
    )
    gain = jitter_gain(shots.harmonic, F, float(delay.std()))
    plain = shots.values.mean(axis=1) * np.exp(1j * shots.harmonic * 2 * np.pi * F * delay.mean())
    assert np.abs(plain / TRUTH)[1:7] == pytest.approx(gain[1:7], abs=0.03)
    average, fit = align(shots)
    restored = average.values[:, 0] * np.exp(1j * shots.harmonic * 2 * np.pi * F * delay.mean())
    assert np.abs(restored / TRUTH)[1:7] == pytest.approx(np.ones(6), abs=0.01)
    assert abs(fit["jitter"] - s) < 3 * fit.parameters["jitter"].sd < 3e-9
    assert fit.chi2_reduced == pytest.approx(1, abs=0.05)


def test_steady_trigger_is_reported_as_an_upper_limit() -> None:
    shots = decompose(
        record(TIME, noisy(1e-3, 3, 60), drive_frequency=np.full(60, F)), n_harmonics=12
    )
    fit = align(shots)[1]
    assert fit["jitter"] + fit.parameters["jitter"].sd < 0.3e-9
    assert any("upper limit" in note for note in fit.notes)


@pytest.mark.slow
def test_stated_jitter_is_right_to_its_stated_error_over_many_draws() -> None:
    s = 6e-9
    z = []
    for seed in range(30):
        delay = s * np.random.default_rng(500 + seed).normal(size=30)
        shots = decompose(
            record(TIME, noisy(2e-3, seed, 30, delay), drive_frequency=np.full(30, F)),
            n_harmonics=8,
        )
        jitter = align(shots)[1].parameters["jitter"]
        z.append((jitter.value - s) / jitter.sd)
    assert np.mean(np.abs(z) < 1) == pytest.approx(0.68, abs=0.26)
    assert abs(np.mean(z)) < 0.6


@pytest.mark.parametrize(
    ("data", "n_harmonics", "error", "message"),
    [
        (record(TIME, noisy(0, 0), drive_frequency=[F]), 43, ParameterError, "ask for 42 at most"),
        (
            record(TIME[:20], noisy(0, 0)[:, :20], drive_frequency=[F]),
            12,
            ParameterError,
            "20 samples cannot give 12 harmonics",
        ),
        (
            record(TIME[:60], noisy(0, 0)[:, :60], drive_frequency=[F]),
            21,
            MeasurementError,
            "record of 0.69 periods",
        ),
    ],
)
def test_impossible_decompositions_are_refused(
    data: xr.Dataset, n_harmonics: int, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        decompose(data, n_harmonics)


def test_traces_without_any_drive_are_refused() -> None:
    with pytest.raises(MeasurementError, match="neither drive_frequency nor drive_voltage"):
        decompose(record(TIME, noisy(0, 0)))


def test_records_at_different_frequencies_are_not_averaged() -> None:
    shots = decompose(record(TIME, noisy(0, 0, 2), drive_frequency=[F, F + 10]), n_harmonics=5)
    with pytest.raises(ParameterError, match="one drive frequency"):
        align(shots)


def test_a_step_without_a_drive_frequency_is_named() -> None:
    traces = record(
        TIME, noisy(1e-4, 1, n_steps=2), drive_frequency=[F, np.nan], wavelength=RED, noise_sd=1e-4
    )
    told = r"trace: step 2 has no drive_frequency; give it, or leave the step out"
    with pytest.raises(MeasurementError, match=told):
        decompose(traces, 5)
    with pytest.raises(MeasurementError, match=told):
        pose(traces, SimulatedFilm(load("circle"), 1))
