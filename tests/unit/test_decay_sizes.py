"""Long decays: sums over periods by an FFT, and Bessel functions by their expansion."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ive

from femnl import measurement
from femnl.effects import library
from femnl.fits.decay.compared import compared
from femnl.fits.decay.periods import MOST_TERMS, at_cycles
from femnl.fits.decay.pose import pose
from femnl.fits.decay.window import window
from femnl.observe.decay.noise import _bessel
from femnl.observe.decay.record import power_record
from tests.unit.decay_records import RATE, TONE, record

EVEN = np.arange(3200)
GAPS = np.concatenate([np.arange(900), np.arange(1200, 3500)])


@pytest.mark.parametrize("points", [EVEN, GAPS], ids=["even", "gaps"])
@pytest.mark.parametrize(("first", "step"), [(2.0, 0.5), (4.5, 0.25)])
def test_the_fft_of_periods_is_their_sum(
    points: NDArray[np.int64], first: float, step: float
) -> None:
    time = 0.37 * points.astype(np.float64)
    values = np.random.default_rng(1).normal(size=len(time))
    cycles = np.arange(first, len(time) / 4, step)
    assert len(cycles) * len(time) > MOST_TERMS
    expected = np.exp(-2j * np.pi * np.outer(cycles, time / time[-1])) @ values
    assert at_cycles(time, values, cycles) == pytest.approx(expected, abs=1e-9)


def test_the_strongest_period_of_uneven_times_is_found() -> None:
    rng = np.random.default_rng(2)
    time = np.sort(rng.uniform(0, 50, 4000))
    time -= time[0]
    values = np.cos(2 * np.pi * 30 * time / time[-1]) + rng.normal(size=len(time))
    cycles = np.arange(2.0, 1000, 0.5)
    assert len(cycles) * len(time) > MOST_TERMS
    assert cycles[np.argmax(np.abs(at_cycles(time, values, cycles)))] == 30


@pytest.mark.parametrize("order", [0, 0.3, 2.7, 18.3, 199])
def test_bessel_functions_are_scipy_s_on_both_sides_of_the_switch(order: float) -> None:
    switch = max(50, 2 * (order + 1) ** 2)
    x = switch * np.array([0.3, 0.99, 1.01, 1.5, 10, 1000.0])
    value, ratio = _bessel(order, x)
    assert value == pytest.approx(np.log(ive(order, x)), rel=1e-13)
    assert ratio == pytest.approx(ive(order + 1, x) / ive(order, x), rel=1e-13)


def test_bessel_functions_far_out_keep_their_recurrence() -> None:
    """I_v(x) = I_{v+2}(x) + 2(v + 1)/x I_{v+1}(x), where no library can be asked."""
    x = np.array([1e6, 1e9, 1e14])
    for order in (0.0, 3.5):
        first = _bessel(order, x)[1]
        second = _bessel(order + 1, x)[1]
        assert first * (second + 2 * (order + 1) / x) == pytest.approx(1, rel=1e-13)


@pytest.mark.slow
def test_laws_at_some_points_of_long_blocks_have_the_means_of_all() -> None:
    time, power, _ = record(3, points=60_000, correlation=3.0)
    dataset = measurement.decay(time, power, attributes={"frequency": TONE})
    some = pose(dataset)
    known = power_record(dataset)
    points = compared(known, window(known))
    every = replace(some, time=points.time, blocks_of_power=points.blocks)
    assert len(some.time) < 0.3 * len(every.time)
    base = {"level": 0.0, "decay_rate": RATE, "floor": -60.0}
    (pair,) = [one for one in some.usable_effects(library().values()) if one.name == "beating_pair"]
    splitting = 40 / (12 / RATE)
    values = {one.name: 0.5 * (one.low + one.high) for one in pair.parameters}
    values |= {"splitting": splitting, "partner_rate": RATE}
    for effects, given in (((), ()), ((pair,), (values,))):
        found = some.predict(effects, base, given).log_power
        full = every.predict(effects, base, given).log_power
        assert found == pytest.approx(full, abs=2e-4)
