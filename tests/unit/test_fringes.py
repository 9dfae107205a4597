"""Harmonics of a fringe at many points: by either way as a sampled signal and its FFT have them."""

import numpy as np
import pytest

from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Fringe, Motion
from femnl.optics.sampled import PIECE, harmonics

WAVELENGTH = 632.8e-9
SAMPLES = 2048
ORDERS = np.array([1, 2, 3, 6, 4, 11])
SINE = np.array([0, 1], complex)
TERMS = np.array([0.4, 0.8 + 0.2j, 0, -0.1j, 0.03])


def motion(displacement: ComplexArray, theta: Array) -> Motion:
    """A motion that is told by what is read of it."""
    n = displacement.shape[1]
    return Motion(
        displacement,
        theta,
        np.zeros(n),
        np.zeros(n),
        np.ones((1, n)),
        np.ones(1),
        0,
        displacement[0],
        WAVELENGTH,
    )


def drawn(n_points: int, n_orders: int, largest: float) -> ComplexArray:
    """Amplitudes up to the largest, of which some are zero, and overtones a tenth as large."""
    rng = np.random.default_rng(n_points + n_orders)
    size = largest * rng.uniform(size=n_points) * (rng.uniform(size=n_points) > 0.1)
    turns = np.exp(2j * np.pi * rng.uniform(size=(n_orders, n_points)))
    return np.asarray(size * turns * 0.1 ** np.arange(n_orders)[:, None])


def sampled(
    displacement: ComplexArray,
    theta: Array,
    coefficients: ComplexArray,
    limit: float,
    n_samples: int = SAMPLES,
    one_sided: bool = False,
) -> ComplexArray:
    """V_n by an FFT of the signal at each point."""
    tau = 2 * np.pi * np.arange(n_samples) / n_samples
    u = sum(
        np.real(row[:, None] * np.exp(1j * (m + 1) * tau)) for m, row in enumerate(displacement)
    )
    phase = 4 * np.pi / WAVELENGTH * u + theta[:, None]

    def fringe(phi: Array) -> Array:
        return np.real(np.polynomial.polynomial.polyval(np.exp(1j * phi), [0, *coefficients[1:]]))

    top = (
        limit * np.abs(fringe(np.linspace(0, 2 * np.pi, 20_000))).max()
        if np.isfinite(limit)
        else np.inf
    )
    low = -np.inf if one_sided else -top
    return np.asarray((np.fft.rfft(np.clip(fringe(phase), low, top)) * 2 / n_samples).T[ORDERS])


@pytest.mark.parametrize("coefficients", [SINE, TERMS], ids=["sine", "terms"])
@pytest.mark.parametrize("even", [True, False], ids=["even", "uneven"])
@pytest.mark.parametrize("n_orders", [1, 3])
def test_harmonics_are_those_of_the_sampled_signal(
    n_orders: int, even: bool, coefficients: ComplexArray
) -> None:
    n = PIECE + 100  # more than one piece
    displacement = drawn(n, n_orders, 6e-7)
    theta = np.full(n, 0.7) if even else np.random.default_rng(5).uniform(-3, 3, n)
    found = harmonics(motion(displacement, theta), Fringe(coefficients, WAVELENGTH, None), ORDERS)
    np.testing.assert_allclose(found, sampled(displacement, theta, coefficients, np.inf), atol=2e-8)


@pytest.mark.parametrize("one_sided", [False, True], ids=["both", "above"])
@pytest.mark.parametrize("largest", [5e-8, 2e-7])
@pytest.mark.parametrize("n_orders", [1, 2])
def test_a_clipped_signal_has_the_harmonics_of_its_samples(
    n_orders: int, largest: float, one_sided: bool
) -> None:
    displacement = drawn(60, n_orders, largest)
    theta = np.random.default_rng(6).uniform(-3, 3, 60)
    floor = -np.inf if one_sided else -0.7
    fringe = Fringe(TERMS, WAVELENGTH, None, limit=0.7, floor=floor)
    found = harmonics(motion(displacement, theta), fringe, ORDERS)
    # Its harmonics fall as 1/n², and those beyond the samples are folded back; without the limit,
    # the same are off by 0.2.
    np.testing.assert_allclose(
        found, sampled(displacement, theta, TERMS, 0.7, 64 * SAMPLES, one_sided), atol=1e-4
    )


def test_results_that_are_kept_belong_to_their_own_fringe() -> None:
    displacement = drawn(50, 1, 3e-7)
    theta = np.full(50, 0.4)
    for coefficients in (SINE, TERMS, SINE):
        found = harmonics(
            motion(displacement, theta), Fringe(coefficients, WAVELENGTH, None), ORDERS
        )
        np.testing.assert_allclose(
            found, sampled(displacement, theta, coefficients, np.inf), atol=2e-8
        )
