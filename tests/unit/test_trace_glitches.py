"""Glitches of traces whose harmonics reach beyond those that the sampling separates."""

import numpy as np
import pytest
import xarray as xr

from femnl.fits.trace.glitches import without_glitches
from femnl.io import measurement

FREQUENCY = 1.466e6
N = 760
TIME = np.arange(N) * 12.27e-9
NOISE = 6e-4
HARMONICS = 21


def clipped(limit: float, rng: np.random.Generator) -> xr.Dataset:
    """A fringe [V] that is cut at some part of its largest value."""
    fringe = 0.02 * np.cos(7.7 * np.cos(2 * np.pi * FREQUENCY * TIME) + 1.1)
    volts = np.clip(fringe, -0.02 * limit, 0.02 * limit) + NOISE * rng.standard_normal(N)
    return measurement.trace(TIME, volts, drive_frequency=FREQUENCY, noise_sd=NOISE)


@pytest.mark.parametrize("limit", [1.0, 0.6, 0.4])
def test_glitches_are_found_beside_corners_that_no_harmonic_follows(limit: float) -> None:
    rng = np.random.default_rng(20261125)
    places = [141, 443, 444, 700]
    sizes = np.array([900.0, 590.0, -120.0, 12.0])
    dataset = clipped(limit, rng)
    dataset["voltage"].values[0, places] += NOISE * sizes
    cleared, told = without_glitches(dataset, HARMONICS)
    assert np.flatnonzero(np.isnan(cleared["voltage"].values[0])).tolist() == places
    found = dict(told)
    assert found[f"step 1, t = {TIME[141]:.6g} s"] == pytest.approx(900, rel=0.2)


def test_without_glitches_little_is_left_out() -> None:
    rng = np.random.default_rng(7)
    left_out = [len(without_glitches(clipped(0.6, rng), HARMONICS)[1]) for _ in range(100)]
    assert np.mean(np.array(left_out) > 0) <= 0.05


def test_glitches_that_crowd_in_one_record_are_found() -> None:
    rng = np.random.default_rng(20261126)
    clean = clipped(1.0, rng)["voltage"].values[0]
    volts = clean + NOISE * rng.standard_normal((6, N))
    places = np.sort(rng.choice(N, 24, replace=False))  # 3 % of one record, 0.5 % of all
    volts[3, places] += NOISE * np.exp(rng.uniform(np.log(20), np.log(900), 24))
    dataset = measurement.trace(
        TIME, volts, drive_frequency=np.full(6, FREQUENCY), noise_sd=1.5 * NOISE
    )
    cleared, _ = without_glitches(dataset, HARMONICS)
    steps, samples = np.nonzero(np.isnan(cleared["voltage"].values))
    assert set(steps) == {3}
    assert samples.tolist() == places.tolist()
