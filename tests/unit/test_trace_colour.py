"""The colour of the noise of traces: autoregressive noise as its closed forms say, and lines."""

import numpy as np
import pytest
from scipy.signal import lfilter

from femnl.core.readout import Array
from femnl.fits.trace.colour import WHITE, Colour, noise_colour
from femnl.fits.trace.decompose import decompose
from femnl.io.measurement import trace as record
from femnl.optics.fringe import SineFringe
from femnl.optics.harmonics import harmonics, trace

F = 1.466e6
TIME = np.arange(1024) / 125e6
FRINGE = SineFringe(632.8e-9, 0.1, 0.02, 0.6)
U = 6.5e-7
SD = 5e-4
STEPS = 8
LOW_PASS = (0.6,)
"""The noise behind one pole."""
PEAKED = (1.456, -0.81)
"""The noise of a resonance at 0.1 cycles a sample: poles 0.9 e^{±0.2πi}."""
COLOURS = pytest.mark.parametrize("following", [LOW_PASS, PEAKED], ids=["low pass", "peak"])


def noise(following: tuple[float, ...], rng: np.random.Generator, n_steps: int = STEPS) -> Array:
    """Autoregressive noise of variance SD², after what is not settled."""
    white = rng.standard_normal((n_steps, 400 + len(TIME)))
    coloured = lfilter([1.0], [1.0, *(-a for a in following)], white, axis=-1)[:, 400:]
    impulse = lfilter([1.0], [1.0, *(-a for a in following)], np.eye(1, 2000))
    return np.asarray(SD * coloured / np.sqrt(np.sum(impulse**2)))


@COLOURS
def test_power_and_length_are_those_of_the_noise(following: tuple[float, ...]) -> None:
    rng = np.random.default_rng(20261126)
    found = noise_colour(noise(following, rng, 64))
    cycles = np.linspace(0, 0.5, 11)
    assert found is not None
    exact = Colour(np.array(following)).relative_power(cycles)
    assert found.relative_power(cycles) == pytest.approx(exact, rel=0.08)


def test_closed_forms_of_noise_behind_one_pole() -> None:
    rho = LOW_PASS[0]
    colour = Colour(np.array(LOW_PASS))
    cycles = np.array([0.0, 0.03, 0.2])
    power = (1 - rho**2) / (1 + rho**2 - 2 * rho * np.cos(2 * np.pi * cycles))
    assert colour.relative_power(cycles) == pytest.approx(power, rel=1e-9)
    assert colour.correlation_length == pytest.approx((1 + rho) / (1 - rho), rel=1e-9)
    assert colour.independent == pytest.approx((1 - rho**2) / (1 + rho**2), rel=1e-9)
    assert (WHITE.correlation_length, WHITE.independent) == (1.0, 1.0)


def test_white_noise_is_told_as_white() -> None:
    rng = np.random.default_rng(3)
    lengths = [
        decompose(
            record(TIME, SD * rng.standard_normal((STEPS, 1024)), drive_frequency=np.full(STEPS, F))
        ).correlation_length
        for _ in range(40)
    ]
    assert np.mean(np.array(lengths) != 1) <= 0.05


def test_a_tone_is_no_colour() -> None:
    rng = np.random.default_rng(5)
    tone = 0.5 * SD * np.cos(2 * np.pi * 0.0713 * np.arange(1024) + 1.0)
    assert noise_colour(noise(LOW_PASS, rng) + tone) is None


@COLOURS
def test_harmonics_and_noise_scatter_as_told(following: tuple[float, ...]) -> None:
    rng = np.random.default_rng(11)
    clean = trace(FRINGE, TIME, F, U, 0.4)
    truth = harmonics(FRINGE, np.arange(22), U, 0.4)[:, None]
    away, sizes, told = [], [], []
    for _ in range(24):
        volts = clean + noise(following, rng)
        found = decompose(record(TIME, volts, drive_frequency=np.full(STEPS, F)))
        away.append((found.values - truth) / found.values_sd)
        sizes.append(found.noise_sd)
        told.append(found.independent)
    apart = np.concatenate(away, axis=1)[1:]
    rms = np.sqrt((np.mean(apart.real**2, axis=1) + np.mean(apart.imag**2, axis=1)) / 2)
    assert rms == pytest.approx(np.ones(21), abs=0.15)
    assert rms.mean() == pytest.approx(1, abs=0.03)
    spread = np.std(np.log(sizes)) * np.sqrt(2 * np.mean(told) * (1024 - 43))
    assert spread == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize("periods", [3.2, 4.7])
@COLOURS
def test_harmonics_of_few_periods_scatter_as_told(
    following: tuple[float, ...], periods: float
) -> None:
    rng = np.random.default_rng(12)
    time = np.linspace(0, periods / F, 1025)[:-1]
    clean = trace(FRINGE, time, F, U, 0.4)
    truth = harmonics(FRINGE, np.arange(22), U, 0.4)[:, None]
    away, sizes = [], []
    for _ in range(40):
        volts = clean + noise(following, rng)
        found = decompose(record(time, volts, drive_frequency=np.full(STEPS, F)))
        away.append((found.values - truth) / found.values_sd)
        sizes.append(found.noise_sd)
    apart = np.concatenate(away, axis=1)[1:]
    rms = np.sqrt((np.mean(apart.real**2) + np.mean(apart.imag**2)) / 2)
    assert rms == pytest.approx(1, abs=0.06)
    assert np.sqrt(np.mean(np.square(sizes))) == pytest.approx(SD, rel=0.05)


@pytest.mark.parametrize("what", ["tone", "slow tone", "drift", "random walk", "nothing"])
def test_what_is_no_noise_of_these_records_has_no_colour(what: str) -> None:
    sample = np.arange(1024)
    walk = np.cumsum(np.random.default_rng(8).standard_normal((STEPS, 1024)), axis=1)
    added = {
        "tone": np.cos(0.3 * sample),
        "slow tone": np.cos(0.003 * sample),
        "drift": np.linspace(-1, 1, 1024),
        "random walk": 0.05 * walk,
        "nothing": np.zeros(1024),
    }[what]
    volts = trace(FRINGE, TIME, F, U, 0.4) + SD * added * np.ones((STEPS, 1))
    found = decompose(record(TIME, volts, drive_frequency=np.full(STEPS, F)))
    assert (found.correlation_length, found.independent) == (1.0, 1.0)


def test_harmonics_beyond_the_last_hide_no_colour() -> None:
    rng = np.random.default_rng(2)
    volts = np.clip(trace(FRINGE, TIME, F, U, 0.4), -0.008, 0.01) + noise(LOW_PASS, rng)
    found = decompose(record(TIME, volts, drive_frequency=np.full(STEPS, F)))
    rho = LOW_PASS[0]
    assert found.correlation_length == pytest.approx((1 + rho) / (1 - rho), rel=0.1)
