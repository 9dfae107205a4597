"""Decays as analysers write them: noise, phases, and fits of records with a known Q."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from scipy.stats import ncx2

from femnl import measurement
from femnl.core.errors import MeasurementError, ParameterError
from femnl.fits.decay.likelihood import (
    Likelihood,
    averages_of,
    correlation_time,
    start_values,
)
from femnl.fits.decay.power import fit_decay
from femnl.io.labfiles import read_lab_files
from femnl.observe.decay.noise import FAR, log_density, normal_score
from femnl.observe.decay.phases import find_decay, recorded_points
from femnl.observe.decay.pieces import pieces
from femnl.plot.power_decay import local_rates, power_of_ten
from tests.unit.decay_records import QUALITY, RATE, TONE, fitted, pull, record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
REAL = Path(__file__).parents[3] / "shared" / "data" / "decays"


@pytest.mark.parametrize("averages", [1.0, 2.5, 16.0])
def test_power_of_signal_and_noise_is_a_noncentral_chi_square(averages: float) -> None:
    power = np.array([0.05, 1.1, 3.3, 8.0])
    signal = np.array([0.5, 1.0, 2.0, 9.0])
    noise = np.array([1.0, 0.3, 0.5, 0.02])
    scale = 2 * averages / noise
    expected = ncx2.logpdf(power * scale, 2 * averages, signal * scale) + np.log(power * scale)
    np.testing.assert_allclose(
        log_density(np.log(power), signal, noise, averages)[0], expected, atol=1e-10
    )


def test_derivatives_of_the_density_are_those_of_differences_on_both_sides_of_the_expansion() -> (
    None
):
    signal = np.array([1.0, 1.0, 1.0])
    noise = 2 * signal / np.array([30.0, 0.5 * FAR, 2 * FAR])
    y = np.sqrt(noise) * np.array([0.3, -0.7, 1.1])
    step = 1e-6 * noise
    _, by_signal, by_noise = log_density(y, signal, noise, 1.0)
    for name, moves, exact in (("signal", (step, 0), by_signal), ("noise", (0, step), by_noise)):
        up = log_density(y, signal + moves[0], noise + moves[1], 1.0)[0]
        down = log_density(y, signal - moves[0], noise - moves[1], 1.0)[0]
        np.testing.assert_allclose((up - down) / (2 * step), exact, rtol=1e-3, err_msg=name)


def test_normal_scores_of_drawn_powers_are_normal() -> None:
    rng = np.random.default_rng(1)
    for signal in (0.0, 1.0, 100.0):
        drawn = np.abs(np.sqrt(signal) + rng.normal(size=(20000, 2)) @ [1, 1j] / np.sqrt(2)) ** 2
        every = np.ones(20000)
        scores = normal_score(np.log(drawn), signal * every, every, 1.0)
        assert abs(scores.mean()) < 0.03
        assert abs(scores.std() - 1) < 0.05


def test_lines_of_different_noise_are_cut_where_they_meet() -> None:
    rng = np.random.default_rng(2)
    time = np.linspace(0, 10, 300)
    quiet = -2 * time[:150] + 0.01 * rng.normal(size=150)
    loud = -30 + 4 * rng.normal(size=150)
    found = pieces(time, np.concatenate([quiet, loud]))
    assert [piece.first for piece in found] == [0, 150]
    assert found[0].slope == pytest.approx(-2, abs=0.01)


def test_a_bend_far_below_the_noise_of_the_floor_is_a_change_point_to_a_fine_resolution() -> None:
    rng = np.random.default_rng(2)
    # 1001 points make blocks of three, and two points that fill no block.
    time = np.arange(1001) / 100
    bent = -2 * time - 0.3 * np.maximum(time - 5, 0) + 0.01 * rng.normal(size=1001)
    found = pieces(time, bent)
    assert len(found) == 2
    assert abs(found[1].first - 500) <= 15
    assert found[1].stop == 1001
    assert found[1].slope == pytest.approx(-2.3, abs=0.01)
    assert len(pieces(time, bent, 3.0)) == 1


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9])
def test_correlation_time_of_an_autoregressive_series_is_the_closed_form(memory: float) -> None:
    """1 + 2 Σ ρᵏ = (1 + ρ)/(1 − ρ)."""
    white = np.random.default_rng(3).normal(size=40000)
    series = lfilter([1], [1, -memory], white)
    assert correlation_time(series) == pytest.approx((1 + memory) / (1 - memory), rel=0.1)


@pytest.mark.parametrize("averages", [1.0, 3.0, 20.0])
def test_a_floor_shows_how_many_values_the_analyser_averages(averages: float) -> None:
    rng = np.random.default_rng(5)
    floor = np.log(rng.gamma(averages, size=4000))
    assert averages_of(floor) == pytest.approx(averages, rel=0.1)
    # Fewer than 100 independent values may scatter little by chance.
    assert averages_of(floor[:60]) == 1.0


def test_every_phase_is_found_and_the_decay_begins_at_the_switch_off() -> None:
    time, power, begin = record(3, length=24.0)
    fit = fitted(time, power)
    assert [phase.name for phase in fit.phases] == ["before", "driven", "decay", "floor"]
    step = time[1] - time[0]
    decay = next(phase for phase in fit.phases if phase.name == "decay")
    assert abs(decay.begin - time[begin]) <= 4 * step
    assert fit["floor"] == pytest.approx(-60, abs=1)
    assert fit["level"] == pytest.approx(power[begin], abs=0.2)
    assert fit["linewidth"] == pytest.approx(TONE / QUALITY, rel=0.01)
    assert abs(pull(fit)) < 4


def test_a_gain_moves_level_and_floor_and_nothing_else() -> None:
    time, power, _ = record(3, length=24.0)
    plain = fitted(time, power)
    weaker = fitted(time, power - 37)
    for name in ("level", "floor"):
        assert weaker[name] == pytest.approx(plain[name] - 37, abs=1e-3)
    assert weaker["quality_factor"] == pytest.approx(plain["quality_factor"], rel=1e-5)


def test_wander_is_the_rms_of_the_power_about_a_strong_decay() -> None:
    time, power, begin = record(15, length=3.0, floor=1e-9)
    power[begin:] += 0.2 * np.random.default_rng(15).normal(size=len(power) - begin)
    assert fitted(time, power)["wander"] == pytest.approx(0.2, rel=0.1)


def test_what_lies_before_the_drive_is_not_called_driven_where_no_floor_is_reached() -> None:
    time, power, begin = record(12, length=4.0)
    rng = np.random.default_rng(12)
    # The background of another bandwidth: above the floor of the decay, and it drifts down.
    start = len(time) // 20
    power[:start] = -29 - 2 * np.arange(start) / start + 0.1 * rng.normal(size=start)
    fit = fitted(time, power)
    assert [phase.name for phase in fit.phases] == ["before", "driven", "decay"]
    assert abs(fit.phases[1].begin - time[start]) <= 4 * time[1]
    # A mode that rings up is driven from its first point on.
    power[:begin] = np.linspace(-25, 0, begin)
    assert [phase.name for phase in fitted(time, power).phases] == ["driven", "decay"]


def test_a_second_decay_of_the_same_rate_is_another_try() -> None:
    time, power, begin = record(13, length=8.0)
    interval = time[1]
    twice = np.concatenate([power[: begin + 250], power])
    fit = fitted(interval * np.arange(len(twice)), twice)
    assert "other try" in [phase.name for phase in fit.phases]
    assert abs(pull(fit)) < 4


def test_a_floor_that_is_not_fitted_is_told() -> None:
    time, power, begin = record(14, length=4.0)
    after = np.arange(120)
    # The mode is lost: 12 dB in 30 points, then a floor.
    power[-120:] = power[-121] - 12 * np.minimum(after / 30, 1)
    power[-120:] += 0.3 * np.random.default_rng(14).normal(size=120)
    notes = fitted(time, power).fit.notes
    assert any("is not fitted: the power does not come to it" in note for note in notes)
    assert not any("ends before the decay reaches a floor" in note for note in notes)
    short = fitted(time[: begin + 250], power[: begin + 250]).fit.notes
    assert any("ends before the decay reaches a floor" in note for note in short)


@pytest.mark.parametrize(
    ("length", "correlation"),
    [
        (4.0, 3.0),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in ((12.0, 1.0), (24.0, 3.0))),
    ],
)
def test_intervals_hold_as_often_as_they_say_and_the_quality_factor_is_unbiased(
    length: float, correlation: float
) -> None:
    pulls = []
    for seed in range(40):
        time, power, _ = record(100 + seed, length=length, correlation=correlation)
        pulls.append(pull(fitted(time, power)))
    # 40 draws of a normal: the mean is known to 0.16, the part within 1σ to 0.07.
    assert abs(np.mean(pulls)) < 0.55
    assert 0.5 <= np.mean(np.abs(pulls) < 1) <= 0.9
    assert np.sqrt(np.mean(np.square(pulls))) < 1.6


def test_a_decay_far_above_its_floor_is_known_as_well_as_counting_says() -> None:
    """Slope of a line: sd of ln p is √(2N/S), each of n points independent (Rice, large signal)."""
    time, power, begin = record(7, length=1.5, floor=1e-4, correlation=0.05)
    after = time[begin:] - time[begin]
    spread = np.sqrt(2e-4 * np.exp(RATE * after))
    weight = 1 / spread**2
    middle = np.sum(weight * after) / np.sum(weight)
    expected = 1 / np.sqrt(np.sum(weight * (after - middle) ** 2))
    found = fitted(time, power).fit.parameters["decay_rate"]
    assert found.sd == pytest.approx(expected, rel=0.35)


def test_nonlinear_damping_is_found_and_the_quality_factor_is_that_of_small_motion() -> None:
    time, _, begin = record(0)
    after = time[begin:] - time[begin]
    # Amplitude equation with γ(1 + ηA²/4), ηA₀²/4 = 2, integrated step by step.
    solved = solve_ivp(
        lambda _, a: -RATE / 2 * a * (1 + 2 * a**2),
        (0, after[-1]),
        [1.0],
        t_eval=after,
        rtol=1e-9,
        atol=1e-12,
    )
    time, power, _ = record(4, solved.y[0].astype(complex))
    fit = fitted(time, power)
    assert abs(pull(fit)) < 4
    assert fit["damping_ratio"] == pytest.approx(2.0, rel=0.15)


@pytest.mark.parametrize(
    ("length", "points", "seed"), [(9.0, 600, 5), (12.0, 600, 6), (24.0, 1200, 5), (24.0, 1200, 7)]
)
def test_a_beating_pair_gives_splitting_and_the_quality_factor_of_the_stronger(
    length: float, points: int, seed: int
) -> None:
    """Whether the floor after the beats is short or as long as they are."""
    time, _, begin = record(0, length=length, points=points)
    after = time[begin:] - time[begin]
    splitting = 1.7 * RATE / np.pi
    # The weaker mode decays at 1.2 times the rate.
    weaker = 0.4 * np.exp(-0.1 * RATE * after + 2j * np.pi * splitting * after)
    beats = np.exp(-RATE * after / 2) * (1 + weaker)
    fit = fitted(*record(seed, beats, length=length, points=points)[:2])
    assert abs(fit["splitting"]) == pytest.approx(splitting, rel=1e-3)
    assert fit["partner_rate"] == pytest.approx(1.2 * RATE, rel=0.02)
    assert fit["partner"] == pytest.approx(0.4, rel=0.05)
    assert fit["level"] == pytest.approx(20 * np.log10(1.4), abs=0.3)
    assert fit["quality_factor"] == pytest.approx(QUALITY, rel=0.01)


@pytest.mark.parametrize(("size", "periods"), [(0.1, 3.0), (0.1, 6.0), (0.3, 4.0), (0.03, 5.0)])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_decay_into_a_leak_gives_the_rate_of_the_mode(
    size: float, periods: float, seed: int
) -> None:
    """Beats are as long as pieces of the decay, and no floor is below."""
    time, _, begin = record(0, length=15.0)
    after = time[begin:] - time[begin]
    splitting = periods / after[-1]
    leak = size * np.exp(2j * np.pi * splitting * after + 2.5j)
    time, power, _ = record(seed, np.exp(-RATE * after / 2) + leak, length=15.0)
    found = fit_decay(measurement.decay(time, power), frequency=TONE).fit
    rate = found.parameters["decay_rate"]
    assert rate.value == pytest.approx(RATE, rel=0.02)
    assert abs(rate.value - RATE) < 4 * rate.sd
    assert abs(found.parameters["splitting"].value) == pytest.approx(splitting, rel=0.01)
    assert "tone that stays" in found.notes[0]


@pytest.mark.parametrize(("ratio", "beats"), [(0.8, 1.5), (0.95, 3.2)])
def test_beats_of_nearly_equal_modes_are_a_pair(ratio: float, beats: float) -> None:
    """Their dips are deeper than any scatter about one line."""
    time, _, begin = record(0)
    after = time[begin:] - time[begin]
    splitting = beats * RATE / np.pi
    weaker = ratio * np.exp(0.1 * RATE * after + 2j * np.pi * splitting * after)
    fit = fitted(*record(5, np.exp(-RATE * after / 2) * (1 + weaker))[:2])
    assert abs(fit["splitting"]) == pytest.approx(splitting, rel=2e-3)
    # Which of two is the stronger, a fit may tell either way
    rates = sorted([2 * np.pi * TONE / fit["quality_factor"], fit["partner_rate"]])
    assert rates == pytest.approx([0.8 * RATE, RATE], rel=0.05)


def test_a_frequency_that_leaves_the_filter_does_not_lower_the_quality_factor() -> None:
    time, _, begin = record(0, length=8.0)
    after = time[begin:] - time[begin]
    gone = np.exp(-RATE * after / 2) * np.exp(-0.5 * (RATE * after / 4) ** 2)
    fit = fitted(*record(6, gone.astype(complex), length=8.0)[:2])
    # Tuned to 0.1 dB, a mode may lose 2√(0.1 dB/T²) of rate to the filter at the begin.
    detuned = 2 * np.sqrt((RATE / 4) ** 2 * np.log(10) / 100)
    assert fit.fit.parameters["decay_rate"].sd == pytest.approx(detuned, rel=0.05)
    assert fit["exit_rate"] == pytest.approx((RATE / 4) ** 2, rel=0.05)
    assert abs(pull(fit)) < 2


def test_spikes_in_the_floor_are_told() -> None:
    time, power, _ = record(5, length=40.0)
    at = len(time) - 40
    power[at] = -35  # over noise of -60 dB
    fit = fitted(time, power)
    assert not fit.used[at]
    told = f"1 point left out where decay or floor are interrupted, from {time[at]:.4g} s"
    assert told in fit.fit.notes


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_noise_at_the_end_of_a_decay_interrupts_nothing(seed: int) -> None:
    """It scatters by more than the strong part does, and belongs to the decay all the same."""
    time, power, begin = record(seed)
    assert fitted(time, power).used[begin + 5 :].all()


def test_dropouts_and_spikes_are_left_out_and_told() -> None:
    time, power, begin = record(8)
    power[begin + 60 : begin + 72] -= 25
    power[begin + 150 : begin + 153] += 8
    # One point is too short to be a piece of its own.
    power[begin + 100] += 3
    fit = fitted(time, power)
    assert not fit.used[begin + 61 : begin + 71].any()
    assert not fit.used[begin + 150 : begin + 153].any()
    assert not fit.used[begin + 100]
    assert "left out where decay or floor are interrupted" in fit.fit.notes[0]
    assert abs(pull(fit)) < 4


def test_the_smooth_rest_of_a_trace_is_not_taken_for_a_measurement() -> None:
    time, power, _ = record(9)
    power[500:] = power[499] - 3 - 2e-3 * np.arange(100) ** 2 / 2
    assert abs(recorded_points(power) - 500) <= 6
    assert recorded_points(power[:500]) == 500
    assert fitted(time, power).phases[-1].name == "not recorded"


def test_magnitudes_and_complex_amplitudes_give_what_decibels_give() -> None:
    time, power, _ = record(10)
    size = 10 ** (power / 20)
    told = {"frequency": TONE}
    ways = [
        measurement.decay(time, power, attributes=told),
        measurement.decay(time, magnitude=size, attributes=told),
        measurement.decay(time, real=size * 0.6, imag=size * 0.8, attributes=told),
    ]
    found = [fit_decay(way)["quality_factor"] for way in ways]
    np.testing.assert_allclose(found, found[0], rtol=1e-5)


def test_powers_far_below_the_reference_of_a_stretch_are_fitted() -> None:
    time = np.linspace(0.0, 5.0, 60)
    far = Likelihood(time, -80.0 - time, 1.0, ())
    values, _ = far.fit(start_values(far, -80.0, 1.0, -90.0))
    assert values[1] / far.units[1] == pytest.approx(5.0 / far.units[1], rel=0.2)


def test_what_does_not_ring_down_is_refused_in_one_line() -> None:
    rising = measurement.decay(np.arange(40.0), np.arange(40.0))
    with pytest.raises(MeasurementError, match="the power falls nowhere"):
        fit_decay(rising)
    for seed in range(6):
        noise = np.random.default_rng(seed).normal(size=(300, 2)) @ [1, 1j]
        with pytest.raises(MeasurementError, match="the power falls nowhere"):
            fitted(np.arange(300.0), 20 * np.log10(np.abs(noise)))
    with pytest.raises(MeasurementError, match="the power falls nowhere"):
        fitted(np.arange(40.0), np.full(40, -30.0))
    with pytest.raises(MeasurementError, match="kind = 'trace'"):
        fit_decay(xr.Dataset(attrs={"kind": "trace"}))
    with pytest.raises(MeasurementError, match="needs at least 16"):
        fit_decay(measurement.decay(np.arange(5.0), -np.arange(5.0)))


def test_a_short_fall_that_a_coarse_resolution_does_not_see_is_fitted() -> None:
    rng = np.random.default_rng(17)
    power = np.concatenate([np.linspace(-10, -2, 150), np.linspace(-2, -5, 40)])
    power = np.concatenate([power, np.linspace(-5, 3, 150)]) + 0.02 * rng.normal(size=340)
    time = np.arange(340.0)
    assert find_decay(time, power, 3.0) is None
    assert fitted(time, power)["decay_rate"] == pytest.approx(3 / 39 * np.log(10) / 10, rel=0.02)


@pytest.mark.parametrize("frequency", [0.0, -1e6, np.nan, np.inf])
def test_a_frequency_that_cannot_be_is_refused(frequency: float) -> None:
    time, power, _ = record(11)
    with pytest.raises(ParameterError, match="must be positive and finite"):
        fit_decay(measurement.decay(time, power), frequency=frequency)


def test_a_decay_without_a_frequency_has_a_rate_and_no_quality_factor() -> None:
    time, power, _ = record(11)
    fit = fit_decay(measurement.decay(time, power))
    assert "quality_factor" not in fit.fit.parameters
    assert fit["decay_rate"] == pytest.approx(RATE, rel=0.01)
    assert any("frequency is not given" in note for note in fit.fit.notes)
    assert len(fit.plot().axes) == 3
    assert fit.plot().axes[2].get_ylabel() == "decay rate (1/s)"
    assert "Phases of the record" in fit.summary()


def test_pieces_of_a_picture_give_the_decay_rate_within_their_errors() -> None:
    fit = fitted(*record(16, correlation=3.0)[:2])
    _, rate, sd = local_rates(fit)
    strong = rate > 3 * sd
    assert np.count_nonzero(strong) >= 5
    assert np.mean(((rate - RATE) / sd)[strong] ** 2) < 3
    assert rate[0] == pytest.approx(RATE, rel=0.05)
    assert fit.plot().axes[2].get_ylabel() == "quality factor (10⁶)"


def test_pieces_of_beats_in_a_picture_give_the_decay_rate_within_their_errors() -> None:
    time, _, begin = record(0)
    after = time[begin:] - time[begin]
    leak = 0.1 * np.exp(2j * np.pi * 4 * after / after[-1] + 2.5j)
    _, rate, sd = local_rates(fitted(*record(1, np.exp(-RATE * after / 2) + leak)[:2]))
    assert len(rate) >= 5
    assert np.mean(((rate - RATE) / sd) ** 2) < 3


@pytest.mark.parametrize(
    ("value", "power", "text"), [(1.7e7, 1e7, "10⁷"), (0.003, 1e-3, "10⁻³"), (42.0, 1.0, "")]
)
def test_an_axis_writes_its_power_of_ten_into_the_label(
    value: float, power: float, text: str
) -> None:
    found, written = power_of_ten(value)
    assert found == pytest.approx(power)
    assert written == text


@pytest.mark.shared
@pytest.mark.skipif(not REAL.is_dir(), reason="the shared ring-downs are not beside the repository")
@pytest.mark.parametrize(
    ("number", "quality", "tolerance"),
    [(832, 1.59e7, 0.03), (1191, 1.72e7, 0.03), (3807, 3.65e8, 0.03), (1810, 2.06e7, 0.05)],
)
def test_real_records_have_the_quality_factor_that_their_group_found(
    number: int, quality: float, tolerance: float
) -> None:
    """By hand, in the heads of the records of the Ringdown-Processor."""
    (path,) = REAL.glob(f"measID_{number}_*.txt")
    (node,) = read_lab_files(path).children.values()
    assert fit_decay(node.to_dataset())["quality_factor"] == pytest.approx(quality, rel=tolerance)
