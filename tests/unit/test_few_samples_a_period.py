"""Traces with few samples a period: the harmonics beyond half the sampling rate are seen too."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from femnl.cli._main import run
from femnl.core.fit import MotionFit
from femnl.diagnose import diagnose
from femnl.fits.trace.decompose import decompose, most_harmonics
from femnl.fits.trace.folding import _folding, beyond
from femnl.fits.trace.glitches import without_glitches
from femnl.fits.trace.spot import fit_spot
from femnl.fits.trace.spot_model import SpotModel
from femnl.io import measurement
from femnl.optics.fringe import SineFringe
from femnl.optics.harmonics import trace
from femnl.optics.unit_fringe import cosine
from femnl.plot.harmonics import harmonics_figure

RED = 632.8e-9
F = 7.118e5
NOISE = 8e-5


def traces(detuning: list[float], per_period: float, samples: int, largest: float) -> xr.Dataset:
    """Sweep a drive through a resonance [linewidths], with its largest amplitude [m]."""
    rng = np.random.default_rng(20)
    time = np.arange(samples) / (per_period * F)
    off = 2 * np.array(detuning)
    fringe = SineFringe(RED, 0.0, 0.02, 0.41)
    volts = [
        trace(fringe, time, F, largest / np.hypot(1, x), -np.arctan(x) + 0.7 * i)
        for i, x in enumerate(off)
    ]
    noisy = volts + NOISE * rng.standard_normal((len(off), samples))
    frequency = np.full(len(off), F)
    return measurement.trace(time, noisy, drive_frequency=frequency, noise_sd=NOISE, wavelength=RED)


def motion(found: xr.Dataset) -> MotionFit:
    spectrum = decompose(found, most_harmonics(found))
    return fit_spot(spectrum, RED, beyond=beyond(found, spectrum))


def test_deep_motion_is_found_from_the_five_harmonics_below_half_the_sampling_rate() -> None:
    detuning = np.linspace(-2, 2, 12)
    found = motion(traces(list(detuning), 10.0157, 1585, 8e-7))
    true = 8e-7 / np.hypot(1, 2 * detuning)
    assert found.prediction.shape == (5, 12)
    np.testing.assert_allclose(found.amplitude, true, rtol=1e-3)


def test_known_noise_tells_motions_apart_that_differ_by_less_than_what_is_folded() -> None:
    detuning = np.linspace(-2, 2, 20)
    data = traces(list(detuning), 10.0157, 1585, 7.945e-7)
    spectrum = decompose(data, most_harmonics(data))
    found = fit_spot(spectrum, RED, beyond=beyond(data, spectrum, NOISE))
    off = (np.abs(found.amplitude) - 7.945e-7 / np.hypot(1, 2 * detuning)) / found.amplitude_sd
    assert 0.3 < np.mean(off**2) < 2.5
    assert found.amplitude_sd.max() < 1e-10
    assert 0.7 < found.fit.chi2_reduced < 1.4


def test_a_steep_fringe_between_the_phases_of_samples_is_no_glitch() -> None:
    data = traces(list(np.linspace(-2, 2, 20)), 10.0157, 1585, 7.945e-7)
    data["voltage"][10, 700] += 8 * NOISE
    _, left_out = without_glitches(data, most_harmonics(data))
    assert len(left_out) < 4
    assert left_out[0][0] == f"step 11, t = {float(data['time'][700]):.6g} s"


def test_two_harmonics_are_not_taken_for_a_motion_whose_others_would_be_left() -> None:
    found = motion(traces([-2, 0.1, 2], 5.2205, 1575, 5.8e-8))
    assert np.all(np.abs(found.amplitude) < 2e-7)
    assert found.fit["contrast"] == pytest.approx(0.02, abs=4 * found.fit.parameters["contrast"].sd)


def test_as_many_parameters_as_data_are_said_to_test_nothing() -> None:
    found = motion(traces([0.0], 4.8017, 282, 5.2e-8)).fit
    assert found.n_points == found.n_parameters == 4
    assert math.isnan(found.chi2_reduced)
    assert "there are as many parameters as data, so that nothing tests the fit" in found.notes


@pytest.mark.parametrize(
    ("detuning", "per_period", "samples", "largest"),
    [([-2, 0.1, 2], 5.2205, 1575, 5.8e-8), ([-1, 0.1, 1], 10.0157, 1585, 8e-7)],
)
def test_traces_of_a_sinusoidal_motion_need_no_cause(
    tmp_path: Path, detuning: list[float], per_period: float, samples: int, largest: float
) -> None:
    path = tmp_path / "traces.nc"
    data = traces(detuning, per_period, samples, largest)
    measurement.write(measurement.bundle({"traces": data}, geometry="square-270um"), path)
    assert diagnose(path, workers=1).verdict == "adequate"


def test_a_fit_takes_the_harmonics_that_there_are_and_needs_no_device(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "traces.nc"
    data = traces([-1, 0.1, 1], 10.0157, 1585, 8e-7)
    measurement.write(measurement.bundle({"traces": data}), path)
    assert run(["fit", str(path)]) == 0
    assert "traces, motion: 30 numbers, 8 free parameters" in capsys.readouterr().out


def test_a_record_of_less_than_two_samples_a_period_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "traces.nc"
    measurement.write(measurement.bundle({"a": traces([0.0], 1.5, 200, 8e-7)}), path)
    assert run(["fit", str(path)]) == 2
    said = capsys.readouterr().err
    assert "show no harmonic of 711800 Hz; sample faster or record longer" in said


def test_products_of_the_columns_fold_as_the_columns_do() -> None:
    time = np.sort(np.random.default_rng(4).uniform(0, 9.0, 300))
    turns = 2 * np.pi * np.outer(time, np.arange(1, 13))
    low = np.column_stack([np.ones(300), np.cos(turns[:, :3]), -np.sin(turns[:, :3])])
    high = np.column_stack([np.cos(turns[:, 3:]), -np.sin(turns[:, 3:])])
    solved = np.linalg.lstsq(low, high, rcond=None)[0]
    left = high - low @ solved
    fold, beat = _folding(time, 1.0, 3, 12)
    np.testing.assert_allclose(fold, solved[1:4] + 1j * solved[4:], atol=1e-12)
    np.testing.assert_allclose(beat, left.T @ left, atol=1e-10)


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_derivatives_see_the_folded_harmonics_and_what_they_leave(noise: float) -> None:
    data = traces([-1, 0.1, 1], 5.2, 1000, 2e-7)
    spectrum = decompose(data, most_harmonics(data))
    kept = spectrum.harmonic > 0
    spot = SpotModel(
        cosine(RED),
        spectrum.harmonic[kept],
        spectrum.values[kept],
        spectrum.values_sd[kept],
        beyond(data, spectrum, noise),
    )
    vector = np.array([0.025, 0.5, 1e-7, 2.2e-7, 1.1e-7, 0.3, 0.2, 1.0])
    steps = np.diag([1e-8, 1e-6, 1e-14, 1e-14, 1e-14, 1e-6, 1e-6, 1e-6])
    by_hand = np.stack(
        [(spot.residuals(vector + h) - spot.residuals(vector - h)) / (2 * h.max()) for h in steps],
        axis=1,
    )
    assert by_hand.shape == (2 * 2 * 3 + 3, 8)
    assert np.all(np.abs(by_hand[12:]).max(axis=1) > 0)
    off = np.abs(spot.jacobian(vector) - by_hand)
    assert np.all(off < 1e-7 * np.abs(by_hand).max(axis=0))


def test_one_step_of_two_harmonics_is_told_by_what_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "traces.nc"
    data = traces([0.0], 5.15, 300, 3e-7)
    measurement.write(measurement.bundle({"traces": data}, geometry="square-270um"), path)
    assert diagnose(path, workers=1).verdict == "adequate"
    assert run(["fit", str(path)]) == 0
    told = re.search(r"largest amplitude (\S+) ± (\S+) nm", capsys.readouterr().out)
    assert told
    value, sd = map(float, told.groups())
    assert sd < 2
    assert value == pytest.approx(300, abs=3 * sd)


def test_phases_of_a_recorded_drive_fold_as_its_motion_does() -> None:
    data = traces([-1, 0.1, 1], 10.0157, 1585, 8e-7)
    late = 0.9
    time = data["time"].values
    drive = np.tile(np.cos(2 * np.pi * F * time + late), (3, 1))
    whole = data.assign(drive_voltage=(("step", "time"), drive))
    found = motion(whole)
    np.testing.assert_allclose(found.amplitude, motion(data).amplitude, rtol=1e-4)
    off = found.phase - motion(data).phase + late
    assert np.all(np.abs((off + np.pi) % (2 * np.pi) - np.pi) < 1e-3)


@pytest.mark.parametrize("per_period", [10.0157, 60.0])
def test_glitches_of_a_record_are_left_out_of_its_fit(
    per_period: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "traces.nc"
    data = traces([-1, -0.3, 0.1, 0.5, 1], per_period, 1585, 3e-7)
    data["voltage"][2, [200, 431, 777, 1301]] += 300 * NOISE
    measurement.write(measurement.bundle({"traces": data}, geometry="square-270um"), path)
    assert run(["fit", str(path)]) == 0
    said = capsys.readouterr().out
    assert "left out as glitches: 4, the largest of" in said
    assert "largest amplitude 294.1" in said


def test_a_tone_in_one_record_is_not_taken_for_the_harmonics_of_a_deep_motion() -> None:
    data = traces([-1, -0.3, 0.1, 0.5, 1], 60.0, 1585, 3e-7)
    data["voltage"][2] += 20 * NOISE * np.cos(2 * np.pi * 0.37 * F * data["time"].values)
    spectrum = decompose(data, most_harmonics(data))
    found = fit_spot(spectrum, RED, beyond=beyond(data, spectrum, NOISE))
    true = 3e-7 / np.hypot(1, 2 * np.array([-1, -0.3, 0.1, 0.5, 1]))
    assert np.all(np.abs(np.abs(found.amplitude) - true) < 4 * found.amplitude_sd)
    assert "it counts as noise" in found.fit.notes[-1]
    clean = traces([-1, -0.3, 0.1, 0.5, 1], 60.0, 1585, 3e-7)
    spectrum = decompose(clean, most_harmonics(clean))
    assert "counts as" not in str(
        fit_spot(spectrum, RED, beyond=beyond(clean, spectrum, NOISE)).fit.notes
    )


def test_steps_that_share_a_frequency_are_drawn_by_their_number() -> None:
    data = traces([-1, 0.1, 1], 10.0157, 1585, 3e-7)
    figure = harmonics_figure(decompose(data, most_harmonics(data)), motion(data))
    amplitudes = figure.axes[2]
    assert amplitudes.get_xlabel() == "step of the drive"
    drawn = np.asarray(amplitudes.containers[0][0].get_xydata())
    np.testing.assert_allclose(drawn[:, 0], [1, 2, 3])
    np.testing.assert_allclose(drawn[:, 1], 300 / np.hypot(1, [2, 0.2, 2]), rtol=1e-2)
