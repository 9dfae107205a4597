"""The circle of a mode beside a leak: where fits of strong motion start."""

from dataclasses import replace

import numpy as np
import pytest

from femnl.fits.response.circle import circle_starts
from femnl.fits.response.fit import first_layout, fit_response
from femnl.fits.response.variant import Variant
from femnl.observe.response.sweeps import Sweeps, collect
from femnl.observe.response.theta import Layout
from tests.unit.test_fits_response import F0, GAIN, MODE, PEAK, Q, pull, simulate

LEAKS = (0.05 - 0.03j, -0.02 + 0.08j)
"""At two places, in V by V of drive, where the resonance is 0.17 and 0.1 high."""
HEIGHTS = (GAIN * np.exp(0.7j), 0.6 * GAIN * np.exp(-2.5j))
RATIO = 10.0
"""α_y/α_c at 1 V of drive."""


def leaking() -> Sweeps:
    """Sweeps through jumps at two places, each with a leak that grows with the drive."""
    data = simulate(gain=HEIGHTS, noise=2e-5)
    place = (data["x"] > 0).values.astype(int)
    leak = np.array(LEAKS)[place] * data["drive"].values
    return collect(
        data.assign(real=data["real"] + leak.real[:, None], imag=data["imag"] + leak.imag[:, None])
    )


def beside(sweeps: Sweeps) -> Layout:
    return Variant("slope", True, "none", duffing=True).layout(first_layout(sweeps, "complex"))


def test_the_circle_tells_mode_and_leak_at_every_drive() -> None:
    sweeps = leaking()
    layout = beside(sweeps)
    theta, _ = circle_starts(sweeps, layout)
    f0, width, ratio, _, height, phase, _ = layout.split(theta)
    assert f0 == pytest.approx(F0, abs=0.02 * F0 / Q)
    assert width == pytest.approx(F0 / Q, rel=0.02)
    assert ratio == pytest.approx(RATIO, rel=0.02)
    # b of the convention is 1/i at the peak of a linear mode
    np.testing.assert_allclose(height, np.abs(HEIGHTS) * PEAK, rtol=0.01)
    np.testing.assert_allclose(layout.terms(theta)[:, 0], LEAKS, atol=0.001)
    turned = np.exp(1j * (phase - np.angle(HEIGHTS)))
    np.testing.assert_allclose(turned, turned[0], atol=0.05)


def test_sweeps_that_run_over_the_circle_the_other_way_have_no_falling_phase() -> None:
    sweeps = leaking()
    layout = beside(sweeps)
    conjugated = replace(sweeps, voltage=sweeps.voltage.conj())
    for theta in circle_starts(conjugated, layout):
        assert layout.split(theta)[1] > 10 * F0 / Q


def test_what_has_no_imaginary_part_is_no_circle() -> None:
    sweeps = leaking()
    real = np.asarray(sweeps.voltage.real, dtype=np.complex128)
    for theta in circle_starts(replace(sweeps, voltage=real), beside(sweeps)):
        assert np.isfinite(theta).all()


def test_one_point_is_no_circle() -> None:
    sweeps = leaking()
    layout = beside(sweeps)
    for height in (0.0, 1 + 2j):
        volts = np.asarray(height * sweeps.drive, dtype=np.complex128)
        assert circle_starts(replace(sweeps, voltage=volts), layout) == []


@pytest.mark.parametrize(("size", "tilt"), [(3, 0.0), (30, 0.0), (3, 0.3), (30, 0.3)])
@pytest.mark.parametrize("drives", [(0.1, 0.3, 1.0), (1.0,)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_leak_beside_jumps_is_fitted_whatever_the_sign_of_the_phase(
    sign: int, drives: tuple[float, ...], size: int, tilt: float
) -> None:
    """Of so many times the resonance: beside a large one, a jump that is missed is a trifle.

    tilt: by how much it rises over the span, in parts of itself.
    """
    data = simulate(drives=drives)
    away = (data["frequency"].values - F0) / np.ptp(data["frequency"].values)
    leak = size * 0.17 * (0.6 + 0.8j) * data["drive"].values[:, None] * (1 + tilt * away)
    data = data.assign(real=data["real"] + leak.real, imag=sign * (data["imag"] + leak.imag))
    fit = fit_response(data, "complex")
    assert fit.phase_sign == sign
    assert fit.chi2_reduced == pytest.approx(1, abs=0.1)
    assert abs(pull(fit, "frequency", MODE.frequency)) < 4
    assert abs(pull(fit, "linewidth", F0 / Q)) < 4
    assert abs(pull(fit, "alpha_ratio", RATIO * max(drives) ** 2)) < 4
