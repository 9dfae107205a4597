"""The model that a diagnosis fits to decays: its noise, what it compares, and what it refuses."""

from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.signal import lfilter

from femnl import measurement
from femnl.core.errors import MeasurementError
from femnl.effects import library
from femnl.fits.decay.interruptions import interruptions, spikes, turns
from femnl.fits.decay.pose import pose
from femnl.fits.decay.readout import Noisy, beats, wander_of
from femnl.fits.decay.window import window
from femnl.fits.least_squares import fit
from femnl.io.labfiles import read_lab_files
from femnl.observe.decay.blocks import (
    Filter,
    Wander,
    Whitening,
    filtered,
    in_blocks,
    normal_scale,
    read,
)
from femnl.observe.decay.model import AS_MEASURED, DecayModel, Setting
from femnl.observe.decay.record import DB, power_record, turning
from femnl.observe.extended import ExtendedModel
from tests.unit.decay_records import RATE, TONE, record

Array = NDArray[np.float64]
REAL = Path(__file__).parents[3] / "shared" / "data" / "decays"


def posed(seed: int, *, length: float = 12.0, phase: bool = False) -> DecayModel:
    """Return the model of a simulated record of a mode alone."""
    time, power, begin = record(seed, length=length)
    told = {"frequency": TONE}
    if not phase:
        return pose(measurement.decay(time, power, attributes=told))
    volts = 10 ** (power / 20) * np.exp(1j * 0.3 * (time - time[begin]))
    return pose(measurement.decay(time, real=volts.real, imag=volts.imag, attributes=told))


def test_the_scatter_of_blocks_is_that_of_drawn_records() -> None:
    """Covariance of mean powers of |a + n|² in blocks of 4, from 4000 draws."""
    rng = np.random.default_rng(1)
    memory = 3.0
    rho = np.exp(-1 / memory)
    white = rng.normal(size=(4000, 140, 2)) @ [1, 1j] / np.sqrt(2)
    noise = lfilter([np.sqrt(1 - rho**2)], [1, -rho], white, axis=1)[:, 100:]
    time = np.arange(40.0)
    signal = np.exp(-time / 8) * 30
    power = np.abs(np.sqrt(signal) + noise) ** 2
    blocks = in_blocks(time, np.arange(40) // 4, 4.0)
    means = power.reshape(4000, 10, 4).mean(axis=2)
    mean = means.mean(axis=0)
    share = blocks.mean(signal) / (blocks.mean(signal) + 1)
    found = filtered(blocks, time, share, Filter(memory, 1.0, 1.0))
    drawn = np.cov(means / mean, rowvar=False)
    np.testing.assert_allclose(found, drawn, atol=0.06)
    np.testing.assert_allclose(np.diag(found), np.diag(drawn), rtol=0.12)


def test_drawn_powers_are_normal_on_their_scale_and_have_its_mean() -> None:
    rng = np.random.default_rng(2)
    for signal in (0.0, 1.0, 30.0):
        power = np.abs(np.sqrt(signal) + rng.normal(size=(40000, 2)) @ [1, 1j] / np.sqrt(2)) ** 2
        share = signal / (signal + 1)
        variance = 2 * share * (1 - share) + (1 - share) ** 2
        reference = np.full(1, np.log(signal + 1))
        scale = normal_scale(reference, np.full(1, signal), np.full(1, variance))
        seen = scale.data(np.log(power))
        assert seen.mean() == pytest.approx(float(scale.expected(reference)[0]), abs=0.03)
        assert seen.std() == pytest.approx(np.sqrt(variance), rel=0.1)
        skewness = float(np.mean(((seen - seen.mean()) / seen.std()) ** 3))
        assert abs(skewness) < 0.45


def test_whitening_and_back_is_the_identity_and_its_sd_that_of_the_covariance() -> None:
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(6, 6))
    covariance = roots @ roots.T + np.eye(6)
    whitening = Whitening(cholesky(covariance, lower=True))
    away = rng.normal(size=(3, 6))
    np.testing.assert_allclose(whitening.coloured(whitening.white(away)), away)
    np.testing.assert_allclose(whitening.sd, np.sqrt(np.diag(covariance)))
    assert whitening.white(roots.T).shape == (6, 6)


def test_the_readout_s_noise_is_found_beside_a_bend_and_beats() -> None:
    rng = np.random.default_rng(4)
    blocks = in_blocks(np.arange(300.0), np.arange(300), 1.0)
    truth = Wander(1.0, 0.02, 0.05, 8.0)
    share = np.ones(300)
    factor = np.linalg.cholesky(read(blocks, share, truth))
    time = blocks.time / 300
    bend = -6 * time + 2 * time**3 + 0.4 * np.cos(2 * np.pi * 13 * time)
    found = []
    for _ in range(12):
        values = bend + factor @ rng.normal(size=300)
        noisy = Noisy(blocks, values, np.zeros((300, 300)), share, np.zeros(300, dtype=bool))
        found.append(astuple(wander_of(noisy)[0]))
    _, white, size, memory = np.median(found, axis=0)
    assert white == pytest.approx(truth.white, rel=0.25)
    assert size == pytest.approx(truth.size, rel=0.35)
    assert memory == pytest.approx(truth.memory, rel=0.6)


def test_beats_are_told_from_a_corner_and_from_noise() -> None:
    rng = np.random.default_rng(5)
    time = np.linspace(0, 10, 300)
    noise = 0.1 * rng.normal(size=300)
    line = -4 * time
    deep = 20 * np.log10(np.abs(1 + 0.8 * np.exp(2j * np.pi * 0.7 * time)))
    corner = np.where(time < 2, 0.0, -4 * (time - 2))
    assert beats(time, line + deep + noise, 0.5)
    assert not beats(time, corner + noise, 0.5)
    assert not beats(time, line + 10 * noise, 0.5)


def test_dropouts_and_spikes_interrupt_and_bends_and_beats_do_not() -> None:
    rng = np.random.default_rng(6)
    time = np.arange(400.0)
    power = -0.1 * time + 0.02 * rng.normal(size=400)
    every = np.ones(400, dtype=bool)
    assert interruptions(power, every) == ()
    bent = power - 3e-4 * time**2 + 2 * np.cos(time / 15)
    assert interruptions(bent, every) == ()
    power[100:112] -= 25
    power[200] += 3
    found = interruptions(power, every)
    assert [(one.first, one.stop) for one in found] == [(100, 112), (200, 201)]
    assert found[0].sigma > found[1].sigma > 20
    # What stays away is no interruption
    power[300:] -= 10
    assert len(interruptions(power, every)) == 2


@pytest.mark.parametrize("size", [0.5, -0.5, 3.0, 20.0])
def test_a_jump_that_a_filter_smears_is_left_out_with_its_edges(size: float) -> None:
    rng = np.random.default_rng(8)
    time = np.arange(400.0)
    straight = -0.1 * time + 0.02 * rng.normal(size=400)
    pulse = size * np.exp(-0.5 * ((time - 200) / 1.0) ** 2)
    (found,) = interruptions(straight + pulse, np.ones(400, dtype=bool))
    left = np.abs(pulse) > 0.1
    left[found.first : found.stop] = False
    assert not left.any()
    assert found.stop - found.first <= 13


def falling(rng: np.random.Generator, correlation: float, pulse: Array | float = 0.0) -> Array:
    """Return the power [dB] of 600 points that fall by 40 dB to noise, behind a filter."""
    decay = 10 ** ((40 - 0.13 * np.arange(600.0)) / 20)
    memory = np.exp(-1 / correlation)
    white = rng.normal(size=(700, 2)) @ [1, 1j] / np.sqrt(2)
    noise = lfilter([np.sqrt(1 - memory**2)], [1, -memory], white)[100:]
    return np.asarray(20 * np.log10(np.abs(decay + pulse + noise)))


@pytest.mark.parametrize("correlation", [0.2, 1.0, 4.0])
def test_noise_behind_a_filter_has_no_spikes(correlation: float) -> None:
    rng = np.random.default_rng(11)
    every = np.ones(600, dtype=bool)
    found = [spikes(falling(rng, correlation), every) for _ in range(100)]
    assert sum(map(len, found)) <= 2


@pytest.mark.parametrize("place", [200, 350, 500])
@pytest.mark.parametrize("correlation", [0.2, 1.0])
def test_spikes_stand_out_of_the_floor_and_of_the_end_of_a_decay(
    correlation: float, place: int
) -> None:
    rng = np.random.default_rng(12)
    time = np.arange(600.0)
    pulse = 12 * np.exp(-0.5 * ((time - place) / 0.8) ** 2)
    (found,) = spikes(falling(rng, correlation, pulse), np.ones(600, dtype=bool))
    assert found.first <= place < found.stop <= found.first + 12
    assert found.sigma > 6


@pytest.mark.parametrize("place", [130, 190])
def test_spikes_stand_out_of_a_record_that_ends_before_its_floor(place: int) -> None:
    """The weakest of 200 points is 14 dB above the noise."""
    pulse = 12 * np.exp(-0.5 * ((np.arange(600.0) - place) / 0.8) ** 2)
    power = falling(np.random.default_rng(16), 0.2, pulse)[:200]
    (found,) = spikes(power, np.ones(200, dtype=bool))
    assert found.first <= place < found.stop <= found.first + 12


def test_a_fade_and_a_bend_at_the_begin_are_no_spikes() -> None:
    rng = np.random.default_rng(13)
    time = np.arange(600.0)
    power = falling(rng, 1.0)
    power[:10] += 3 * np.exp(-time[:10] / 3)
    power[400:404] -= 40
    assert spikes(power, np.ones(600, dtype=bool)) == ()


def test_steps_of_what_is_written_are_no_spikes() -> None:
    rng = np.random.default_rng(14)
    time = np.arange(600.0)
    power = np.round(-0.05 * time + 0.003 * rng.normal(size=600), 2)
    assert spikes(power, np.ones(600, dtype=bool)) == ()


def test_points_left_out_hide_no_turns_of_a_fast_phase() -> None:
    time = 0.5 * np.delete(np.arange(300.0), slice(100, 104))
    phase = 2.0 * time + 0.3 * (time > 100)
    rate, beside = turning(np.angle(np.exp(1j * phase)), time)
    assert rate == pytest.approx(2.0, abs=0.01)
    found = rate * (time - time[0]) + beside
    np.testing.assert_allclose(found - found[0], phase - phase[0], atol=1e-9)


def test_points_that_are_missing_in_a_file_hide_no_turns_of_its_phase() -> None:
    time, power, begin = record(8)
    angle = 1.0 * np.arange(len(time))
    volts = 10 ** (power / 20) * np.exp(1j * angle)
    volts[begin + 60 : begin + 64] = np.nan
    model = pose(measurement.decay(time, real=volts.real, imag=volts.imag))
    at = model.blocks_of_phase.time
    line = np.polyfit(at, model.phase, 1)
    assert np.abs(model.phase - np.polyval(line, at)).max() < 0.5
    assert line[0] == pytest.approx(1 / (time[1] - time[0]), rel=1e-3)


def test_jumps_are_seen_in_a_phase_of_nearly_half_a_turn_a_point() -> None:
    """Noise takes its steps over half a turn, which are no jumps."""
    rng = np.random.default_rng(15)
    time = np.arange(400.0)
    angle = 3.1 * time + 0.02 * rng.normal(size=400)
    everywhere = np.ones(400, dtype=bool)

    def jumps() -> list[tuple[int, int]]:
        volts = np.exp(1j * angle)
        record_of = power_record(measurement.decay(time, real=volts.real, imag=volts.imag))
        return [(one.first, one.stop) for one in turns(record_of, everywhere)]

    assert jumps() == []
    angle[200:203] += 1.0
    assert jumps() == [(200, 203)]
    # Beside points that are left out already, where the phase goes on turning
    everywhere[198:201] = False
    assert jumps() == [(201, 203)]


@pytest.mark.parametrize("seen", [0, 1, 5])
def test_a_phase_that_stands_out_nowhere_has_no_jumps(seen: int) -> None:
    time = np.arange(100.0)
    volts = np.exp(1j * time)
    record_of = power_record(measurement.decay(time, real=volts.real, imag=volts.imag))
    assert turns(record_of, time < seen) == ()


def test_a_jump_of_the_phase_alone_is_listed_and_no_residual() -> None:
    time, power, begin = record(8)
    angle = 0.3 * (time - time[begin])
    angle[begin + 60 : begin + 62] += 0.4
    volts = 10 ** (power / 20) * np.exp(1j * angle)
    model = pose(measurement.decay(time, real=volts.real, imag=volts.imag))
    (listed,) = model.left_out
    assert listed[0] == f"phase, {time[begin + 60]:.5g} … {time[begin + 61]:.5g} s"
    assert listed[1] > 8


def test_a_leak_that_takes_over_belongs_to_what_is_compared() -> None:
    """Beats grow while the mode decays into the leak, and go on until it is gone in that."""
    time, _, begin = record(0, length=24.0, points=1200)
    after = time[begin:] - time[begin]
    leak = 0.04 * np.exp(2j * np.pi * 1.3 * RATE * after)
    _, power, _ = record(5, np.exp(-RATE * after / 2) + leak, length=24.0, points=1200)
    seen = window(power_record(measurement.decay(time, power)))
    gone = -2 * np.log(0.04 * 0.02) / RATE
    assert time[seen.decay][-1] - time[begin] == pytest.approx(gone, rel=0.1)
    assert not seen.floor.any()
    assert seen.found.likelihood.terms == ("pair",)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("slow_fall", [3.0, 28.0])
def test_a_decay_that_slows_goes_on_as_far_as_it_falls(seed: int, slow_fall: float) -> None:
    """It falls by 19 dB, and then at a third of its rate by some more: of a floor, or its own."""
    time, _, begin = record(0)
    after = time[begin:] - time[begin]
    fast = 3.3
    bend = 19 / (DB * fast * RATE)
    slowed = np.clip(after - bend, 0, slow_fall / (DB * RATE))
    amplitude = np.exp(-RATE / 2 * (fast * np.minimum(after, bend) + slowed))
    _, power, _ = record(seed, amplitude, floor=2e-5, correlation=0.5)
    seen = window(power_record(measurement.decay(time[begin:], power[begin:])))
    end = after[seen.decay][-1]
    assert end == pytest.approx(bend, rel=0.15) if slow_fall < 19 / 2 else end > 3 * bend


def test_slow_deep_beats_belong_to_what_is_compared_beyond_their_first_minimum() -> None:
    time, _, begin = record(0)
    after = time[begin:] - time[begin]
    turning = 2j * np.pi * 0.43 * RATE * after + 2.9j
    beats = np.exp(-RATE * after / 2) * (1 + 0.57 * np.exp(turning))
    _, power, _ = record(1, beats, floor=2e-5, correlation=0.5)
    seen = window(power_record(measurement.decay(time[begin:], power[begin:])))
    assert after[seen.decay][0] < 0.1 / RATE
    assert after[seen.decay][-1] > 8 / RATE


@pytest.mark.parametrize(("size", "periods"), [(0.1, 2.2), (0.1, 2.8), (0.05, 2.2)])
def test_beats_with_a_leak_begin_at_the_switch_off_and_go_on_until_the_mode_is_gone(
    size: float, periods: float
) -> None:
    """Beats with a leak that the mode falls to after few of their periods."""
    time, _, begin = record(1, length=18.0)
    after = time[begin:] - time[begin]
    equal = 2 * np.log(1 / size) / RATE
    leak = size * np.exp(2j * np.pi * periods * after / equal + 1j)
    _, power, _ = record(1, np.exp(-RATE * after / 2) + leak, length=18.0)
    seen = window(power_record(measurement.decay(time, power)))
    first, last = np.flatnonzero(seen.decay)[[0, -1]]
    assert begin < first < begin + 10
    assert time[last] - time[begin] > 1.5 * equal
    told = seen.found.named
    assert told["decay_rate"] == pytest.approx(RATE, rel=0.03)
    assert told["splitting"] == pytest.approx(periods / equal, rel=0.01)
    assert seen.found.stretch.reference + DB * told["floor"] == pytest.approx(-60, abs=2)


def test_interruptions_are_listed_and_no_residual() -> None:
    time, power, begin = record(8)
    power[begin + 60 : begin + 72] -= 25
    model = pose(measurement.decay(time, power))
    (listed,) = model.left_out
    assert listed[0] == f"power, {time[begin + 60]:.5g} … {time[begin + 71]:.5g} s"
    assert listed[1] > 20
    seen = window(power_record(measurement.decay(time, power)))
    assert not seen.used[begin + 60 : begin + 72].any()
    assert seen.used[begin + 80 : begin + 200].all()


@pytest.mark.slow
def test_a_mode_alone_leaves_white_residuals_and_its_rate_within_the_errors() -> None:
    chi2 = []
    pulls = []
    neighbours = []
    for seed in range(12):
        model = posed(300 + seed)
        result = fit(ExtendedModel(model), model.start)
        chi2.append(result.chi2 / result.degrees)
        sd = float(np.sqrt(result.covariance[1, 1]))
        pulls.append((result.vector[1] - RATE) / sd)
        r = result.residuals
        neighbours.append(float(r[1:] @ r[:-1]) / float(r @ r))
    # 12 records of 160 data: the mean of χ²/ν is known to 0.03
    assert 0.8 < np.mean(chi2) < 1.1
    assert abs(np.mean(neighbours)) < 0.06
    assert np.sqrt(np.mean(np.square(pulls))) < 1.6


def test_residuals_follow_the_law_that_fits_use() -> None:
    """Power of the model without noise against e^{−γτ} and a floor, block by block."""
    model = posed(301)
    base = {"level": 3.0, "decay_rate": 0.5, "floor": -40.0}
    found = model.predict((), base, ())
    blocks = model.blocks_of_power
    signal = 10**0.3 * np.exp(-0.5 * model.time)
    mean = np.add.reduceat(signal, blocks.first) / blocks.count + 1e-4
    np.testing.assert_allclose(found.log_power, np.log(mean), atol=1e-9)


def test_deviations_are_in_the_sd_of_each_datum() -> None:
    model = posed(302)
    base = dict(zip(("level", "decay_rate", "floor"), model.start, strict=True))
    other = base | {"level": base["level"] + 1.0}
    moved = model.deviations(model.residuals((), base, ())) - model.deviations(
        model.residuals((), other, ())
    )
    sd, unit = model.quantity
    assert unit == "dB"
    strong = model.blocks_of_power.time < 3 / RATE
    np.testing.assert_allclose((moved * sd)[strong], 1.0, rtol=0.02)


def test_a_phase_adds_its_own_residuals_and_the_causes_that_only_it_shows() -> None:
    known = library().values()
    plain = posed(303)
    phased = posed(303, phase=True)
    names = {effect.name for effect in phased.usable_effects(known)}
    assert names - {effect.name for effect in plain.usable_effects(known)} == {
        "duffing_shift",
        "frequency_drift",
    }
    result = fit(ExtendedModel(phased), phased.start)
    found = dict(zip((spec.name for spec in phased.base), result.vector, strict=True))
    assert found["detuning"] == pytest.approx(0.3 / (2 * np.pi), rel=1e-3)
    assert [quantity.name for quantity in phased.quantities] == ["power", "phase"]
    assert phased.locate(len(phased.log_power)).startswith("phase at ")
    assert len(phased.compare([("base model", (), found, ())])) == 2


def test_other_settings_change_what_they_say() -> None:
    model = posed(304)
    base = dict(zip(("level", "decay_rate", "floor"), model.start, strict=True))
    exit_ = (library()["filter_exit"],)
    pace = ({"exit_rate": 0.02},)
    plain = model.predict((), base, ())
    wide = model.predict(exit_, base, pace, Setting(bandwidth=1e4))
    near = model.predict(exit_, base, pace, AS_MEASURED)
    np.testing.assert_allclose(wide.log_power, plain.log_power, atol=1e-6)
    assert (near.log_power - plain.log_power).min() < -0.5
    weaker = model.predict((), base, (), Setting(begin=-1.0))
    np.testing.assert_allclose((weaker.log_power - plain.log_power)[:40], -1.0, atol=1e-3)


def test_too_few_points_of_a_decay_are_refused_in_one_line() -> None:
    time, power, begin = record(9)
    with pytest.raises(MeasurementError, match=r"diagnosis needs at least 16: record faster"):
        pose(measurement.decay(time[: begin + 14], power[: begin + 14]))
    with pytest.raises(MeasurementError, match="the power falls nowhere"):
        pose(measurement.decay(np.arange(40.0), np.arange(40.0)))


def late_excess(model: DecayModel, blocks: int) -> float:
    """Return how far [dB] the last data lie above the curve of the mode alone, as mean powers."""
    found = fit(ExtendedModel(model), model.start)
    base, _ = found.model.split(found.vector)
    curve = model.predict((), base, ()).log_power
    mean = np.mean(np.exp(model.log_power[-blocks:])) / np.mean(np.exp(curve[-blocks:]))
    return float(10 * np.log10(mean))


@pytest.mark.parametrize("seed", [2, 9])
def test_a_floor_that_fades_slowly_does_not_draw_the_curve_below_it(seed: int) -> None:
    time, power, _ = record(seed, length=40.0, floor=1e-4, correlation=8.0)
    model = pose(measurement.decay(time, power, attributes={"frequency": TONE}))
    assert abs(late_excess(model, 20)) < 4


@pytest.mark.shared
@pytest.mark.skipif(not REAL.is_dir(), reason="the shared ring-downs are not beside the repository")
@pytest.mark.parametrize("number", [1568, 3317, 3388])
def test_the_curve_of_a_real_decay_ends_in_its_floor(number: int) -> None:
    (path,) = REAL.glob(f"measID_{number}_*.txt")
    (group,) = read_lab_files(path).children.values()
    assert abs(late_excess(pose(group.to_dataset()), 30)) < 8
