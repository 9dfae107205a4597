"""Errors of decays whose noise is slow, against closed forms and against draws."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from femnl.fits.decay.memory import block_means, residual_covariance
from femnl.observe.decay.phases import find_decay
from tests.unit.decay_records import RATE, fitted, pull, record

Array = NDArray[np.float64]


def slow(seed: int, count: int, memory: float) -> Array:
    """Return a process of Ornstein and Uhlenbeck with unit variance."""
    kept = np.exp(-1 / memory)
    white = np.random.default_rng(seed).normal(size=count + 500)
    return np.asarray(lfilter([np.sqrt(1 - kept**2)], [1, -kept], white)[500:])


def test_means_of_blocks_count_the_last_points_too() -> None:
    values = np.stack([np.arange(7.0), np.ones(7)], axis=1)
    np.testing.assert_allclose(block_means(values, 3), np.array([[1.0, 1.0], [4.5, 1.0]]))


@pytest.mark.parametrize("memory", [0.1, 3.0, 8.0])
def test_the_error_of_a_slope_is_that_of_the_process_that_was_drawn(memory: float) -> None:
    """Var = A C Aᵀ, C of the process; residuals of a line forget sooner than that."""
    count = 80
    place = np.linspace(-1, 1, count)
    design = np.stack([np.ones(count), place], axis=1)
    lever = np.linalg.pinv(design)[1]
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    known = lever @ np.exp(-apart / memory) @ lever
    found = []
    for seed in range(60):
        values = slow(seed, count, memory)
        rest = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
        found.append(lever @ residual_covariance(rest, design) @ lever)
    assert np.median(found) == pytest.approx(known, rel=0.35)


@pytest.mark.slow
@pytest.mark.parametrize(("floor", "correlation", "points"), [(1e-4, 5.0, 360), (1e-3, 20.0, 240)])
def test_intervals_hold_where_few_values_are_independent(
    floor: float, correlation: float, points: int
) -> None:
    pulls = []
    for seed in range(60):
        time, power, _ = record(
            3000 + seed, length=4.0, floor=floor, correlation=correlation, points=points
        )
        fit = fitted(time, power)
        assert not {"partner", "damping_ratio", "exit_rate"} & set(fit.fit.parameters)
        pulls.append(pull(fit))
    # 60 draws of a normal: the part within 1σ is known to 0.06
    assert 0.52 <= np.mean(np.abs(pulls) < 1) <= 0.84
    assert np.sqrt(np.mean(np.square(pulls))) < 1.7


def test_a_noisy_end_of_the_same_slope_belongs_to_the_decay() -> None:
    rng = np.random.default_rng(4)
    time = np.arange(200.0)
    power = -0.1 * time + rng.normal(size=200) * np.where(time < 120, 0.02, 1.0)
    found = find_decay(time, power)
    assert found is not None
    assert found.pieces[found.decay[-1]].stop == 200
    assert found.line.slope == pytest.approx(-0.1, abs=0.001)


def test_a_gain_that_bends_a_record_wanders_by_a_tenth_of_a_decibel_at_least() -> None:
    """Slow bumps that grow towards the floor leave none of the scatter to the gain."""
    time = np.arange(200) / 200 * 5 / RATE
    decibels = RATE * 10 / np.log(10) * time
    late = 0.02 * np.exp(RATE * time / 2) * slow(1, 200, 20.0)
    assert fitted(time, -decibels + late)["wander"] == pytest.approx(0.1)
