"""Spikes of sweeps before any fit: glitches are, and jumps and narrow resonances are none."""

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.fits.response.spikes import without_spikes
from femnl.io import measurement

F0 = 2.9324e6
NOISE = 1.5e-5
SWEEPS = 8
POINTS = 81
Complex = NDArray[np.complex128]


def resonances(width: float, sweeps: int = SWEEPS) -> tuple[NDArray[np.float64], Complex]:
    """Frequency [Hz] and volts of sweeps through a line of some width [steps], with noise."""
    rng = np.random.default_rng(1)
    steps = np.arange(POINTS) - 40.0
    line = 0.01 / (1 + 2j * steps / width)
    volts = np.linspace(0.2, 1, sweeps)[:, None] * line
    noise = rng.standard_normal(volts.shape) + 1j * rng.standard_normal(volts.shape)
    return np.tile(F0 + 2 * steps, (sweeps, 1)), volts + NOISE * noise


def spikes(frequency: NDArray[np.float64], volts: Complex) -> list[tuple[int, int]]:
    """The sweep and the point of each spike."""
    data = measurement.response(
        frequency, volts, noise_sd=NOISE, drive=np.linspace(0.2, 1, len(volts))
    )
    cleared = without_spikes(data, NOISE)
    at = np.argwhere(np.isnan(cleared["real"].values) & np.isnan(cleared["imag"].values))
    return [(int(i), int(k)) for i, k in at]


def test_glitches_are_spikes_also_beside_a_resonance() -> None:
    frequency, volts = resonances(8.0)
    places = [(0, 70), (3, 12), (5, 46)]
    for (sweep, point), size in zip(places, (600, 40, 300), strict=True):
        volts[sweep, point] += NOISE * size * np.exp(0.7j * point)
    assert spikes(frequency, volts) == places


@pytest.mark.parametrize("width", [0.2, 1.0, 3.0])
def test_a_resonance_narrower_than_a_step_is_no_spike(width: float) -> None:
    assert spikes(*resonances(width)) == []


def test_jumps_are_no_spikes() -> None:
    frequency, volts = resonances(20.0)
    for sweep in range(SWEEPS):
        volts[sweep, 40 + 3 * sweep :] *= 0.1 * np.exp(2j)
    assert spikes(frequency, volts) == []


def test_without_several_sweeps_nothing_is_a_spike() -> None:
    frequency, volts = resonances(8.0)
    volts[0, 70] += 600 * NOISE
    assert spikes(frequency[:2], volts[:2]) == []


def test_neighbours_that_are_off_the_circle_of_all_others_are_spikes_together() -> None:
    frequency, volts = resonances(8.0)
    volts[5, 60:64] += 2e-3 * np.exp(0.7j)
    assert spikes(frequency, volts) == [(5, k) for k in range(60, 64)]
    # Of a mode whose damping grows with the drive there is no one circle
    volts *= 1 / (1 + np.arange(SWEEPS)[:, None] / SWEEPS)
    assert spikes(frequency, volts) == []


@pytest.mark.parametrize("width", [1.0, 3.0])
@pytest.mark.parametrize("sweeps", [1, SWEEPS])
def test_a_narrow_resonance_that_is_on_no_circle_is_no_spike(sweeps: int, width: float) -> None:
    """What is left without it is noise, which is on a circle of its own."""
    rng = np.random.default_rng(1)
    steps = np.arange(800) - 399.7
    drive = np.linspace(0.2, 1, sweeps)[:, None]
    volts = 0.01 * drive / (1 + drive**2 + 2j * steps / width)
    noise = rng.standard_normal(volts.shape) + 1j * rng.standard_normal(volts.shape)
    seen = np.asarray(volts + NOISE * noise, dtype=np.complex128)
    assert spikes(np.tile(F0 + steps, (sweeps, 1)), seen) == []


def test_a_sweep_that_is_off_as_a_whole_keeps_its_points() -> None:
    frequency, volts = resonances(20.0, 60)
    volts[5] += 2e-3 * np.exp(0.7j)
    assert spikes(frequency, volts) == []


@pytest.mark.parametrize("point", [0, 4])
def test_a_glitch_in_a_short_sweep_leaves_enough_to_fit(point: int) -> None:
    frequency, volts = resonances(4.0, 20)
    volts[3, 36 + point] += 0.01
    assert spikes(frequency[:, 36:44], volts[:, 36:44]) == []


def test_spikes_at_either_end_of_sweeps_are_no_neighbours() -> None:
    frequency, volts = resonances(8.0)
    ends = [(1, 80), (2, 80), (5, 0)]
    for sweep, point in ends:
        volts[sweep, point] += 2e-3 * np.exp(0.7j)
    assert spikes(frequency, volts) == ends
