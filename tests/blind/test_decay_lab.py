"""The laboratory of decays keeps to what its files tell."""

import numpy as np

from tests.blind.lab.decay import STEPS, DecayBench


def test_the_filter_takes_half_of_the_power_at_half_of_the_told_bandwidth() -> None:
    bench = DecayBench((), np.random.default_rng(5))
    step = bench.interval / STEPS
    tone = np.exp(1j * np.pi * bench.width * step * np.arange(bench.points * STEPS))
    behind = bench._behind(tone)
    middle = len(behind) // 2
    np.testing.assert_allclose(np.abs(behind[middle]) ** 2, 0.5, rtol=0.01)
