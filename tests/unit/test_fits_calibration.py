"""Metres from harmonics: where the published method holds and fails, and motion without a shape."""

import numpy as np
import pytest

from femnl.core.device import Layer, Stack
from femnl.core.errors import ParameterError
from femnl.core.readout import Array
from femnl.fits.map.calibration import displacement, taylor_amplitude
from femnl.fits.map.fit import fit_map
from femnl.io.measurement import harmonic_map
from femnl.optics.fringe import MultilayerFringe, SeriesFringe, SineFringe
from femnl.optics.harmonics import harmonics

RED = 632.8e-9
Q = 4 * np.pi / RED
FIRST_FOUR = (1, 2, 3, 4)


def sine_to_fourth_order(theta: float) -> SeriesFringe:
    """The fringe cos(qu + θ) up to u⁴."""
    derivatives = (np.cos(theta), -np.sin(theta), -np.cos(theta), np.sin(theta), np.cos(theta))
    return SeriesFringe(
        tuple(
            d * Q**m / f for m, (d, f) in enumerate(zip(derivatives, (1, 1, 2, 6, 24), strict=True))
        )
    )


@pytest.mark.parametrize("z", [0.1, 0.5, 1.5])
def test_taylor_method_is_exact_for_a_fringe_of_fourth_order(z: float) -> None:
    V = harmonics(sine_to_fourth_order(0.7), FIRST_FOUR, z / Q, phase=1.2)
    assert np.array(taylor_amplitude(V, RED)) * Q == pytest.approx([z, z], rel=1e-9)


def test_error_of_the_taylor_method_grows_as_z_squared() -> None:
    z = np.array([0.2, 0.4])
    odd, even = (
        U * Q / z - 1
        for U in taylor_amplitude(harmonics(SineFringe(RED, 0, 1, 0.7), FIRST_FOUR, z / Q), RED)
    )
    assert odd[1] / odd[0] == pytest.approx(4, rel=0.05)
    assert even[1] / even[0] == pytest.approx(4, rel=0.05)


def test_taylor_method_is_three_percent_low_at_z_of_one() -> None:
    V = harmonics(SineFringe(RED, 0, 1, 0.7), FIRST_FOUR, 1 / Q)
    # J₁(1) = 0.440051, J₃(1) = 0.0195634
    assert taylor_amplitude(V, RED)[0] * Q == pytest.approx(0.970, abs=5e-4)


def test_taylor_method_is_mostly_off_by_a_quarter_or_more_beyond_z_of_four() -> None:
    z = np.linspace(4, 12, 81)
    odd = taylor_amplitude(harmonics(SineFringe(RED, 0, 1, 0.7), FIRST_FOUR, z / Q), RED)[0] * Q
    assert np.mean(np.isnan(odd) | (np.abs(odd / z - 1) > 0.25)) > 0.9


def test_taylor_method_wants_four_harmonics() -> None:
    with pytest.raises(ParameterError, match="first four"):
        taylor_amplitude(np.ones(3), RED)


@pytest.mark.parametrize("layered", [False, True])
def test_displacement_of_every_point_is_found_without_the_mode_shape(layered: bool) -> None:
    stack = Stack(
        tuple(
            Layer(name, d, ((RED, n),))
            for name, d, n in (
                ("vacuum", np.inf, 1),
                ("SiN", 183.75e-9, 2.0395),
                ("vacuum", 3226.25e-9, 1),
                ("Si", np.inf, 3.864 - 0.0158j),
            )
        ),
        gap=2,
    )
    fringe = MultilayerFringe(stack, RED, gain=0.05) if layered else SineFringe(RED, 0.1, 0.02, 0.6)

    def even(x: Array, y: Array) -> Array:
        return np.where(
            (abs(x) < 1) & (abs(y) < 1), np.cos(np.pi * x / 2) * np.cos(np.pi * y / 2), 0
        )

    def odd_part(x: Array, y: Array) -> Array:
        return np.where((abs(x) < 1) & (abs(y) < 1), np.sin(np.pi * x) * np.cos(np.pi * y / 2), 0)

    axis = np.linspace(-1.1, 1.1, 41)
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(axis, axis)
    truth = 4e-7 * (even(x, y) + 0.1 * odd_part(x, y))
    V = harmonics(fringe, range(1, 7), truth, 0.3)
    V = V + 1e-4 * (rng.normal(size=V.shape) + 1j * rng.normal(size=V.shape))
    V[:, 4, 7] = np.nan
    data = harmonic_map(axis, axis, range(1, 7), V, noise_sd=1e-4, wavelength=RED)
    given = fringe if layered else None
    fit = fit_map(data, lambda x, y: (even(x, y) + 0.1 * odd_part(x, y)) / 1.0, given)
    found, sd = displacement(data, fit, given)
    inside = (np.abs(truth) > 2e-8) & np.isfinite(found)
    sign = np.sign(np.sum(found[inside] * truth[inside]))
    z = ((sign * found - truth) / sd)[inside]
    assert np.isnan(found[4, 7])
    assert np.mean(np.abs(z) < 4) > 0.995
    assert np.median(np.abs(z)) == pytest.approx(0.674, abs=0.1)
    assert np.median(sd[inside]) < 2e-9
