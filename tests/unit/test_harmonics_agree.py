"""Harmonics of a fringe: the exact sum, the FFT, the table and the fits' own form are one thing."""

import numpy as np
import pytest

from femnl.core.readout import Array, FourierSeries
from femnl.core.stages import Fringe, Motion
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
