"""From a wide sweep to a labelled spectrum, on sweeps and lists of lines whose truth is known."""

from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import binom, binomtest

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.spectrum import Peaks
from femnl.fits.spectrum import assignment
from femnl.fits.spectrum.assignment import assign
from femnl.fits.spectrum.film import need_assignable
from femnl.fits.spectrum.lines import line
from femnl.fits.spectrum.overview import identify, to_spectrum
from femnl.fits.spectrum.peaks import find_peaks
from femnl.io.measurement import response, spectrum

Array = NDArray[np.float64]
NOISE = 1e-5


@dataclass(frozen=True)
class Truth:
    """Lines that were put in: frequency, linewidth [Hz] and height [V]."""

    frequency: Array
    linewidth: Array
    height: Array


def sweep(
    truth: Truth, seed: int, n: int = 4000, top: float = 4e6, with_noise: bool = True
) -> xr.Dataset:
    """Return a sweep from 1 MHz with lines of random phase on a large background.

    The background slopes, rotates, and is larger than many lines.
    """
    rng = np.random.default_rng(seed)
    f = np.linspace(1e6, top, n)
    volts = np.zeros(n, dtype=complex)
    for frequency, width, height in zip(
        truth.frequency, truth.linewidth, truth.height, strict=True
    ):
        # The driven resonator itself, written out: m(ω₀² − ω² + iωγ)x = F, scaled to the height.
        omega = 2 * np.pi * f
        omega0 = 2 * np.pi * frequency
        gamma = 2 * np.pi * width
        volts += (
            height
            * np.exp(2j * np.pi * rng.uniform())
            * omega0
            * gamma
            / (omega0**2 - omega**2 + 1j * omega * gamma)
        )
    u = 2 * (f - f[0]) / (f[-1] - f[0]) - 1
    volts += 5e-4 * ((1 + 0.5j) + (0.4 - 0.3j) * u + 0.2 * u**2) * np.exp(-2j * np.pi * f * 1e-7)
    if with_noise:
        volts += NOISE * (rng.normal(size=n) + 1j * rng.normal(size=n))
    return response(f, volts, noise_sd=NOISE)


def random_truth(seed: int, n_lines: int = 6) -> Truth:
    """Wide and narrow, strong and weak lines, and one doublet that overlaps by 0.8…2 linewidths."""
    rng = np.random.default_rng(seed)
    frequency = rng.uniform(1.1e6, 3.9e6, n_lines)
    width = 10 ** rng.uniform(3.1, 4.2, n_lines)
    height = 10 ** rng.uniform(-4.0, -2.5, n_lines)
    partner = width[0] * rng.uniform(0.7, 1.4)
    frequency = np.append(frequency, frequency[0] + rng.uniform(0.8, 2.0) * max(width[0], partner))
    return Truth(
        frequency, np.append(width, partner), np.append(height, height[0] * rng.uniform(0.5, 2.0))
    )


def matches(found: Peaks, truth: Truth, sigma: float = 5.0) -> bool:
    """Whether every line was found, each within sigma standard deviations, and no other."""
    if found.frequency.size != truth.frequency.size:
        return False
    order = np.argsort(truth.frequency)
    close = np.abs(found.frequency - truth.frequency[order]) < sigma * found.frequency_sd
    return bool(
        np.all(
            close & (np.abs(found.linewidth - truth.linewidth[order]) < sigma * found.linewidth_sd)
        )
    )


def test_the_line_is_minus_i_on_resonance_and_falls_to_half_its_power_at_half_a_linewidth() -> None:
    at = line(np.array([1e6, 1e6 + 50, 1e6 - 50]), 1e6, 100.0)
    assert at[0] == pytest.approx(-1j, abs=1e-12)
    np.testing.assert_allclose(np.abs(at[1:]) ** 2, 0.5, rtol=2e-4)


def test_one_line_without_noise_is_found_exactly() -> None:
    truth = Truth(np.array([2.3456789e6]), np.array([8e3]), np.array([2e-3]))
    found = find_peaks(sweep(truth, 1, with_noise=False))
    assert found.frequency.size == 1
    assert found.frequency[0] == pytest.approx(truth.frequency[0], abs=1.0)
    assert found.linewidth[0] == pytest.approx(truth.linewidth[0], rel=1e-3)
    assert abs(found.amplitude[0]) == pytest.approx(truth.height[0], rel=1e-3)


def test_noise_on_a_sloping_background_holds_no_line() -> None:
    empty = Truth(np.empty(0), np.empty(0), np.empty(0))
    counts = [find_peaks(sweep(empty, seed, n=1500)).frequency.size for seed in range(40)]
    assert sum(count > 0 for count in counts) <= binom.ppf(0.999, 40, 1e-2)


def study(seeds: range) -> tuple[int, Array]:
    """Return how many random sweeps were read without a fault, and errors in sd."""
    good = 0
    pulls = [np.empty(0)]
    for seed in seeds:
        truth = random_truth(seed)
        found = find_peaks(sweep(truth, 1000 + seed))
        if matches(found, truth):
            good += 1
            pulls.append((found.frequency - np.sort(truth.frequency)) / found.frequency_sd)
    return good, np.concatenate(pulls)


@pytest.mark.slow
def test_wide_narrow_and_overlapping_lines_are_found_in_most_of_a_few_random_sweeps() -> None:
    good, pulls = study(range(4))
    assert good == 4
    assert np.mean(pulls**2) == pytest.approx(1, abs=0.5)


@pytest.mark.slow
def test_at_least_85_percent_of_random_sweeps_are_read_without_a_fault_and_with_honest_errors() -> (
    None
):
    good, pulls = study(range(100, 220))
    interval = binomtest(good, 120).proportion_ci(0.95, "wilson")
    assert interval.low > 0.85, f"{good} of 120, {interval}"
    assert np.mean(np.abs(pulls) < 1) == pytest.approx(0.6827, abs=0.06)


def test_a_line_narrower_than_the_points_is_found_and_its_width_called_unknown() -> None:
    truth = Truth(np.array([2e6 + 300.0]), np.array([2.0]), np.array([0.5]))
    found = find_peaks(sweep(truth, 3, n=3001))
    assert found.frequency.size == 1
    assert found.frequency[0] == pytest.approx(2e6 + 300, abs=500)
    assert not found.linewidth_sd[0] < 0.3 * found.linewidth[0]


def test_a_weak_line_on_the_flank_of_a_strong_one_is_found() -> None:
    truth = Truth(np.array([2.0e6, 2.03e6]), np.array([12e3, 4e3]), np.array([3e-3, 1.5e-4]))
    assert matches(find_peaks(sweep(truth, 5)), truth)


def test_too_few_points_and_a_missing_sweep_are_refused() -> None:
    with pytest.raises(MeasurementError, match="a search for lines needs 24"):
        find_peaks(response(np.arange(1e6, 1e6 + 10), np.ones(10), noise_sd=1.0))
    with pytest.raises(ParameterError, match="sweep 3: the measurement has sweeps 0 to 0"):
        find_peaks(response(np.arange(1e6, 1e6 + 50), np.ones(50), noise_sd=1.0), 3)


PAIRS = [(m, n) for m in range(1, 10) for n in range(1, 10)]


def modes(aspect: float, count: int = 20) -> tuple[list[str], Array]:
    """Labels and frequencies [Hz] of an ideal rectangle: f ∝ √(m² a² + n²)."""
    frequency = 1.0365e6 * np.array([np.hypot(m * aspect, n) for m, n in PAIRS])
    order = np.argsort(frequency)[:count]
    return [f"{PAIRS[index][0]},{PAIRS[index][1]}" for index in order], frequency[order]


@dataclass(frozen=True)
class Case:
    """Lines in random order, their labels (None: spurious), the simulation and the band."""

    lines: Array
    truth: list[str | None]
    labels: list[str]
    simulated: Array
    band: tuple[float, float]
    scale: float


def case(
    seed: int, model_sd: float, missing: int = 2, spurious: int = 2, highest: int = 12
) -> Case:
    """A film of unknown stress and an imperfect simulation.

    Two modes not seen, two lines that are none. highest: of the modes within the band.
    """
    rng = np.random.default_rng(seed)
    labels, simulated = modes(1 + 0.01 * rng.uniform(0.5, 1.0), highest + 8)
    scale = float(np.exp(0.2 * rng.normal()))
    true = scale * simulated * (1 + model_sd * rng.normal(size=simulated.size))
    band = (0.9 * true[0], 0.5 * scale * (simulated[highest - 1] + simulated[highest]))
    seen = np.flatnonzero((true > band[0]) & (true < band[1]))
    kept = rng.permutation(seen)[: seen.size - missing]
    stray = np.exp(rng.uniform(np.log(band[0]), np.log(band[1]), size=spurious))
    lines = np.concatenate([true[kept], stray]) + 5.0 * rng.normal(size=kept.size + spurious)
    truth = [labels[index] for index in kept] + [None] * spurious
    order = rng.permutation(lines.size)
    return Case(
        np.clip(lines, *band)[order],
        [truth[index] for index in order],
        labels,
        simulated,
        band,
        scale,
    )


def test_modes_are_given_their_labels_with_missing_and_spurious_lines_and_an_unknown_scale() -> (
    None
):
    one = case(3, 1e-4)
    found = assign(one.lines, np.full(one.lines.size, 5.0), one.labels, one.simulated, one.band)
    assert list(found.best.label) == one.truth
    assert abs(found.scale / one.scale - 1) < 4 * found.scale_sd / found.scale
    assert found.best.probability > 0.5
    assert found.runner_up is not None
    assert found.runner_up.probability < found.best.probability
    assert len(found.missing) == 2
    assert np.isnan(found.deviation).tolist() == [label is None for label in one.truth]


def promised_and_right(cases: list[Case]) -> tuple[Array, NDArray[np.bool_]]:
    """The probability of the best labelling of each case, and whether it is the true one."""
    found = [
        assign(one.lines, np.full(one.lines.size, 5.0), one.labels, one.simulated, one.band)
        for one in cases
    ]
    promised = np.array([result.best.probability for result in found])
    return promised, np.array(
        [list(result.best.label) == one.truth for one, result in zip(cases, found, strict=True)]
    )


@pytest.mark.slow
def test_the_probabilities_of_labellings_add_up_to_how_many_are_right() -> None:
    promised, right = promised_and_right(
        [case(50 + k, 10 ** (-4 + 0.5 * (k % 4))) for k in range(20)]
    )
    assert abs(right.sum() - promised.sum()) < 3 * np.sqrt(np.sum(promised * (1 - promised)))
    assert 0.2 < promised.mean() < 0.95


@pytest.mark.slow
@pytest.mark.parametrize("model_sd", [1e-4, 3e-4, 1e-3, 3e-3])
def test_the_probability_of_a_labelling_is_how_often_it_is_right(model_sd: float) -> None:
    promised, right = promised_and_right([case(100 + k, model_sd) for k in range(60)])
    assert abs(right.sum() - promised.sum()) < 3 * np.sqrt(np.sum(promised * (1 - promised)))


def test_of_many_scales_those_are_tried_that_most_others_are_near() -> None:
    rng = np.random.default_rng(20261126)
    spread = rng.uniform(-1, 1, 3 * assignment.MOST_SCALES)
    near = 0.3 + 1e-5 * rng.standard_normal(30)
    found = assignment.likely_scales(np.sort(np.concatenate([spread, near])), 1e-4)
    assert found.size == assignment.MOST_SCALES
    assert np.abs(found - 0.3).min() < 1e-4


def test_few_scales_of_many_hold_the_one_at_which_most_lines_meet_their_modes() -> None:
    one = case(3, 1e-4, highest=36)
    assert one.lines.size * one.simulated.size > assignment.MOST_SCALES
    found = assign(one.lines, np.full(one.lines.size, 5.0), one.labels, one.simulated, one.band)
    assert list(found.best.label) == one.truth


def test_more_lines_than_can_be_assigned_are_refused_and_labelled_ones_are_not() -> None:
    many = assignment.MOST_LINES + 1
    frequency = np.linspace(1e6, 2e6, many)
    bare = spectrum(frequency, np.full(many, 1.0))
    with pytest.raises(MeasurementError, match=r"spectrum: 161 lines without labels, and at most"):
        need_assignable(bare)
    need_assignable(bare.isel(mode=slice(1, None)))
    need_assignable(spectrum(frequency, np.full(many, 1.0), label=["1,1"] * many))


def test_exactly_degenerate_modes_share_the_probability_and_are_called_ambiguous() -> None:
    labels, simulated = modes(1.0, 8)
    lines = 1.1 * np.delete(simulated, 2)
    found = assign(lines, np.full(lines.size, 5.0), labels, simulated, (1.2e6, 5e6))
    assert found.runner_up is not None
    assert found.runner_up.probability == pytest.approx(found.best.probability, rel=1e-9)
    assert any(set(group) == {"1,2", "2,1"} for group in found.ambiguous)


def test_assignment_refuses_what_does_not_fit() -> None:
    with pytest.raises(ParameterError, match="give as many sd as lines"):
        assign([1e6], [1.0, 2.0], ["a"], [1e6], (1e5, 1e7))
    with pytest.raises(ParameterError, match="leave the band 2e\\+06 to 3e\\+06 Hz; widen it"):
        assign([1e6], [1.0], ["a"], [1e6], (2e6, 3e6))


def test_an_overview_becomes_a_labelled_spectrum() -> None:
    labels, simulated = modes(1.006, 8)
    rng = np.random.default_rng(8)
    true = np.append(np.delete(simulated, 4) * 1.02 * (1 + 1e-4 * rng.normal(size=7)), 2.7e6)
    truth = Truth(true, np.full(8, 3e3), np.append(np.full(7, 1e-3), 6e-4))
    dataset = sweep(truth, 9, n=6000, top=4.2e6)
    peaks, assignment = identify(dataset, [f"({label})" for label in labels], simulated)
    expected = dict(zip(np.delete(labels, 4), true, strict=False))
    spectrum = to_spectrum(peaks, assignment)
    assert set(spectrum["label"].values) == set(expected)
    for label, frequency, sd in zip(
        spectrum["label"].values,
        spectrum["frequency"].values,
        spectrum["frequency_sd"].values,
        strict=True,
    ):
        assert abs(frequency - expected[label]) < 5 * sd
    assert assignment.missing == (f"({labels[4]})",)
    assert sum(label is None for label in assignment.best.label) == 1
    np.testing.assert_allclose(
        spectrum["quality_factor"].values, spectrum["frequency"].values / 3e3, rtol=0.05
    )


def test_a_sweep_without_lines_is_named_so() -> None:
    empty = Truth(np.empty(0), np.empty(0), np.empty(0))
    with pytest.raises(MeasurementError, match="no line stands out"):
        identify(sweep(empty, 2, n=1000), ["1,1"], [1e6])
