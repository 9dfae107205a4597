"""Harmonics of a fringe: the exact sum, the FFT, the table and the fits' own form are one thing."""

import numpy as np
import pytest

from femnl.core.readout import Array, ComplexArray, FourierSeries
from femnl.core.stages import Fringe, Motion, Wave
from femnl.optics.harmonics import harmonics_by_bessel, harmonics_by_fft
from femnl.optics.sampled import harmonics as tabulated
from femnl.optics.unit_fringe import real_part

WAVELENGTH = 632.8e-9
ORDERS = np.arange(1, 7)


@pytest.mark.parametrize("overtones", [[1.0], [1.0, 0.1 - 0.05j, 0.02j]], ids=["sine", "stack"])
@pytest.mark.parametrize("largest", [5e-9, 200e-9])
def test_all_evaluations_agree(overtones: list[complex], largest: float) -> None:
    rng = np.random.default_rng(3)
    amplitude = largest * rng.uniform(0.1, 1, 40)
    theta = 0.7
    turns = np.exp(1j * theta * np.arange(1, len(overtones) + 1))
    plain = np.array([0, *overtones], complex)
    turned = np.array([0, *(overtones * turns)], complex)
    exact = harmonics_by_bessel(FourierSeries(WAVELENGTH / 2, turned), ORDERS, amplitude)

    def signal(u: Array) -> Array:
        waves = np.exp(4j * np.pi / WAVELENGTH * np.multiply.outer(np.arange(len(turned)), u))
        return np.asarray(np.tensordot(turned, waves, axes=1).real)

    sampled = harmonics_by_fft(signal, ORDERS, amplitude)
    assert np.abs(sampled - exact).max() < 1e-11

    still = np.zeros(len(amplitude))
    motion = Motion(
        amplitude.astype(complex)[None],
        np.full(len(amplitude), theta),
        still,
        still,
        np.ones((1, len(amplitude))),
        np.array([1e6]),
        0,
        amplitude.astype(complex),
        WAVELENGTH,
    )
    # Cubic interpolation between 64 nodes a radian of z.
    assert np.abs(tabulated(motion, Fringe(plain, WAVELENGTH, None), ORDERS) - exact).max() < 1e-8

    fitted = real_part(
        FourierSeries(WAVELENGTH / 2, plain), ORDERS, amplitude, {"fringe_phase": theta}
    )
    assert np.abs(fitted["motion"] - exact.real).max() < 1e-7


@pytest.mark.parametrize(("limit", "error"), [(np.inf, 1e-7), (0.6, 1e-3)])
@pytest.mark.parametrize("n_orders", [1, 2])
def test_waves_of_a_beam_add_up_before_the_detector_clips(
    n_orders: int, limit: float, error: float
) -> None:
    """Against v(t) at 16 384 instants; a clipped one has harmonics that fall with 1/n²."""
    rng = np.random.default_rng(5)
    size = np.array([[60e-9], [8e-9]])[:n_orders] * rng.uniform(0.1, 1, (n_orders, 30))
    u: ComplexArray = size * np.exp(2j * np.pi * rng.random((n_orders, 30)))
    theta = rng.uniform(-3, 3, 30)
    waves = [
        Wave(np.array([0, share, share * (0.2 - 0.1j)], complex), WAVELENGTH * longer)
        for share, longer in ((0.6, 1.0), (0.3, 1.02), (0.1, 1.07))
    ]
    t = 2 * np.pi * np.arange(2**14) / 2**14
    turns = np.exp(1j * np.multiply.outer(np.arange(1, n_orders + 1), t))
    moved = np.einsum("mp,mt->pt", u, turns).real

    def light(phases: list[Array]) -> Array:
        parts = [
            (c * np.exp(1j * k * phase)).real
            for wave, phase in zip(waves, phases, strict=True)
            for k, c in enumerate(wave.coefficients)
        ]
        return np.asarray(np.sum(parts, axis=0))

    largest = np.abs(light([np.linspace(0, 2 * np.pi, 4096)] * 3)).max()
    v = light([4 * np.pi / wave.wavelength * moved + theta[:, None] for wave in waves])
    v = np.clip(v, -limit * largest, limit * largest)
    exact = 2 * np.fft.rfft(v, axis=1)[:, ORDERS].T / len(t)
    still = np.zeros(30)
    motion = Motion(u, theta, still, still, np.ones((1, 30)), np.array([1e6]), 0, u[0], WAVELENGTH)
    fringe = Fringe(waves[0].coefficients, WAVELENGTH, None, limit, -limit, beside=tuple(waves[1:]))
    found = tabulated(motion, fringe, ORDERS)
    assert np.abs(found - exact).max() < error
