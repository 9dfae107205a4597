"""Harmonics of a nonlinear readout: two methods against each other, closed forms and symmetries."""

from math import factorial

import numpy as np
import pytest
from scipy.special import jv

from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.readout import Array, FourierSeries
from femnl.optics.fringe import SeriesFringe, SineFringe
from femnl.optics.harmonics import (
    harmonic_map,
    harmonics,
    harmonics_by_bessel,
    harmonics_by_fft,
    trace,
)

RED = 632.8e-9
ORDERS = np.arange(61)


def random_series(rng: np.random.Generator) -> FourierSeries:
    """A fringe with five overtones that fall like those of a real stack."""
    coefficients = (rng.normal(size=6) + 1j * rng.normal(size=6)) * 0.3 ** np.arange(6)
    return FourierSeries(RED / 2, np.where(np.arange(6) == 0, coefficients.real, coefficients))


@pytest.mark.parametrize("seed", range(8))
def test_bessel_sums_and_fft_agree(seed: int) -> None:
    rng = np.random.default_rng(seed)
    series = random_series(rng)
    U = rng.uniform(-6e-7, 6e-7, 5)
    phi = rng.uniform(-np.pi, np.pi, 5)
    rest = rng.uniform(-3e-7, 3e-7, 5)
    by_bessel = harmonics_by_bessel(series, ORDERS, U, phi, rest)
    assert np.abs(by_bessel - harmonics_by_fft(series, ORDERS, U, phi, rest)).max() < 1e-12


def test_harmonics_of_the_sine_are_the_bessel_functions_of_the_paper() -> None:
    z = 8.85
    contrast = 0.2
    theta = 0.7
    phi = 0.4
    v = harmonics(SineFringe(RED, 0.1, contrast, theta), ORDERS, z * RED / 4 / np.pi, phi)
    assert v[0] == pytest.approx(0.1 + contrast * np.cos(theta) * jv(0, z), abs=1e-15)
    for n in ORDERS[1:]:
        balance, sign = (
            (np.sin(theta), (-1) ** ((n + 1) // 2)) if n % 2 else (np.cos(theta), (-1) ** (n // 2))
        )
        assert v[n] == pytest.approx(
            2 * contrast * balance * jv(n, z) * sign * np.exp(1j * n * phi), abs=1e-15
        )


def test_harmonics_of_a_power_series_are_the_binomial_sums_of_the_paper() -> None:
    coefficients = (0.2, 1.0, -0.5, 0.3, 0.7, -0.2)
    U = 0.8
    phi = 0.3
    v = harmonics(SeriesFringe(coefficients), np.arange(8), U, phi)
    for n in range(8):
        terms = [
            a * factorial(m) * (U / 2) ** m / factorial((m - n) // 2) / factorial((m + n) // 2)
            for m, a in enumerate(coefficients)
            if m >= n and (m - n) % 2 == 0
        ]
        assert v[n] == pytest.approx((2 if n else 1) * sum(terms) * np.exp(1j * n * phi), abs=1e-14)


@pytest.mark.parametrize("seed", range(4))
def test_energy_of_the_harmonics_is_the_mean_square_of_the_trace(seed: int) -> None:
    rng = np.random.default_rng(seed)
    series = random_series(rng)
    U = rng.uniform(1e-7, 5e-7)
    v = harmonics(series, np.arange(200), U)
    samples = trace(series, np.arange(4096) / 4096, 1.0, U)
    assert np.mean(samples**2) == pytest.approx(
        v[0].real ** 2 + 0.5 * np.sum(np.abs(v[1:]) ** 2), rel=1e-13
    )


@pytest.mark.parametrize(("theta", "silent"), [(0.0, 1), (np.pi / 2, 0)])
def test_symmetric_working_point_has_no_odd_harmonics_and_antisymmetric_no_even_ones(
    theta: float, silent: int
) -> None:
    v = harmonics(SineFringe(RED, 0.0, 1.0, theta), np.arange(1, 20), 4e-7)
    assert np.abs(v[np.arange(1, 20) % 2 == silent]).max() < 1e-15
    assert np.abs(v[np.arange(1, 20) % 2 != silent]).min() > 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_phase_of_a_harmonic_is_n_times_that_of_the_motion_modulo_pi(seed: int) -> None:
    rng = np.random.default_rng(seed)
    phi = rng.uniform(-np.pi, np.pi)
    v = harmonics(random_series(rng), ORDERS, rng.uniform(1e-7, 5e-7), phi) * np.exp(
        -1j * ORDERS * phi
    )
    assert np.abs(v.imag).max() < 1e-14


def test_motion_in_antiphase_turns_the_odd_harmonics_only() -> None:
    series = random_series(np.random.default_rng(1))
    assert harmonics(series, ORDERS, -3e-7) == pytest.approx(
        harmonics(series, ORDERS, 3e-7) * (-1.0) ** ORDERS, abs=1e-15
    )


def test_static_displacement_is_a_shift_of_the_working_point() -> None:
    shift = 0.4e-7
    moved = SineFringe(RED, 0.1, 0.2, 0.7 + 4 * np.pi * shift / RED)
    assert harmonics(SineFringe(RED, 0.1, 0.2, 0.7), ORDERS, 3e-7, rest=shift) == pytest.approx(
        harmonics(moved, ORDERS, 3e-7), abs=1e-15
    )


def test_trace_is_the_sum_of_its_harmonics() -> None:
    series = random_series(np.random.default_rng(3))
    U = 3.3e-7
    phi = 0.6
    f = 1.466e6
    t = np.linspace(0, 3e-6, 50)
    summed = np.real(
        np.exp(2j * np.pi * f * np.outer(t, np.arange(100)))
        @ harmonics(series, np.arange(100), U, phi)
    )
    assert trace(series, t, f, U, phi) == pytest.approx(summed, abs=1e-13)


def test_a_kink_in_f_is_named_and_yields_to_a_larger_tolerance() -> None:
    def clipped(u: Array) -> Array:
        return np.minimum(u, 0.5)

    with pytest.raises(ConvergenceError, match="raise the tolerance"):
        harmonics(clipped, [1], 1.0)
    angle = np.arccos(0.5)
    expected = (np.sin(angle) + np.pi - angle - np.sin(2 * angle) / 2) / np.pi
    assert harmonics_by_fft(clipped, [1], 1.0, tolerance=1e-6)[0].real == pytest.approx(
        expected, abs=1e-6
    )


def test_harmonic_map_holds_the_harmonics_of_each_point() -> None:
    x = np.linspace(-1, 1, 4)
    y = np.linspace(-1, 1, 3)
    shape = np.cos(y)[:, None] * np.cos(x)
    fringe = SineFringe(RED, 0.1, 0.2, 0.7)
    found = harmonic_map(fringe, [1, 3], shape, 4e-7, x=x, y=y, wavelength=RED, phase=0.2)
    assert found.values.shape == (2, 3, 4)
    assert found.values[1, 2, 3] == pytest.approx(
        harmonics(fringe, [3], 4e-7 * shape[2, 3], 0.2)[0]
    )
    assert not found.values.flags.writeable


def test_harmonic_map_refuses_a_shape_on_another_grid() -> None:
    with pytest.raises(ParameterError, match="evaluate it on the same grid"):
        harmonic_map(
            SineFringe(RED, 0, 1, 0),
            [1],
            np.ones((2, 2)),
            1e-7,
            x=np.arange(3),
            y=np.arange(2),
            wavelength=RED,
        )


@pytest.mark.parametrize("harmonic", [[-1], [1.5], []])
def test_orders_must_be_whole_numbers(harmonic: list[float]) -> None:
    with pytest.raises(ParameterError, match="not a list of whole numbers"):
        harmonics(SineFringe(RED, 0, 1, 0), harmonic, 1e-7)
