"""Sweeps, transients and ring-downs against time integration.

The published formulas are corrected by it.
"""

from dataclasses import replace

import numpy as np
import pytest

from femnl.core.resonator import Resonator
from femnl.resonator import (
    balance,
    branches,
    couple,
    critical_point,
    integrate,
    ring_down,
    sweep,
    sweep_modes,
)

# Time counts in 1/ω₀ where F0 is used.
F0 = 1 / (2 * np.pi)


@pytest.mark.parametrize("quintic", [pytest.param(0.0, marks=pytest.mark.slow), -1e20])
def test_rotating_wave_sweeps_agree_with_slow_sweeps_in_time(quintic: float) -> None:
    mode = Resonator(1e6, 400, alpha=1e10, quintic=quintic, nonlinear_damping=6e10)
    force = 3 * critical_point(mode)[0]
    grid = np.linspace(0.995e6, 1.01e6, 31)
    for frequency in (grid, grid[::-1]):
        slow = sweep(mode, force, frequency)
        full = sweep_modes(couple([mode]), [force], frequency, 3).coefficients[:, 0, 1]
        same = np.abs(slow - full) < 0.02 * np.abs(slow).max()
        assert np.count_nonzero(~same) <= 1
    assert (
        np.ptp(np.abs(sweep(mode, force, grid) - sweep(mode, force, grid[::-1])[::-1]))
        > 0.2 * np.abs(slow).max()
    )


@pytest.mark.slow
def test_a_drive_switched_on_at_rest_leads_to_the_state_that_time_integration_finds() -> None:
    mode = Resonator(F0, 400, alpha=1.0)
    force = 6 * critical_point(mode)[0]
    reached = []
    # Just above its lower fold the high state is reached by overshoot, further up the low one.
    for shift in (3.65, 4.6, 7.0):
        frequency = (1 + shift / 400) * F0
        states = branches(mode, force, [frequency])
        assert states.stable.sum() == 2
        time = np.concatenate([[0.0], (1200 + np.arange(64) / 64) / frequency])
        q, _ = integrate(couple([mode]), [force], frequency, [0.0], [0.0], time, tolerance=1e-8)
        size = abs(2 * np.mean(q[0, 1:] * np.exp(-2j * np.pi * np.arange(64) / 64)))
        np.testing.assert_allclose(np.abs(sweep(mode, force, [frequency])[0]), size, rtol=0.03)
        reached.append(size > np.abs(states.amplitude[0, 1]))
    assert len(set(reached)) == 2


def test_rotating_wave_error_falls_with_the_square_of_the_amplitude() -> None:
    # At fixed detuning in linewidths and fixed α A² Q, both α A² and 1/Q fall together.
    errors = []
    for q in (200.0, 400.0, 800.0):
        mode = Resonator(F0, q, alpha=1.0)
        force = 2 * critical_point(mode)[0]
        omega = 1 + 2 / q
        slow = np.sort(np.abs(branches(mode, force, [omega * F0]).amplitude[0]))
        full = np.sort(np.abs(balance(mode, force, omega * F0, 7).coefficients[:, 0, 1]))
        errors.append(np.max(np.abs(slow / full - 1)))
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 1, atol=0.1)


def test_amplitude_carries_the_whole_force_and_alpha_four_pi_squared() -> None:
    # Errata of arXiv:2502.19191, S2: the linear peak is 𝓕/(4π² f₀ w), not half of it, and α = α_y
    # (4π² y_max w f₀/𝓕)².
    mode = Resonator(1.5e6, 100, alpha=2e10)
    force = 7e5
    gain = 3e5
    frequency = mode.frequency

    def steady(amplitude_force: float, drive: float) -> complex:
        periods = round(20 / mode.damping * drive)
        time = np.concatenate([[0.0], (periods + np.arange(64) / 64) / drive])
        q, _ = integrate(
            couple([mode]), [amplitude_force], drive, [0.0], [0.0], time, tolerance=1e-9
        )
        return complex(2 * np.mean(q[0, 1:] * np.exp(-2j * np.pi * np.arange(64) / 64)))

    small = force * 1e-3
    linear = abs(steady(small, frequency))
    np.testing.assert_allclose(
        linear, small / (4 * np.pi**2 * mode.frequency * mode.linewidth), rtol=1e-4
    )
    # y = gain·A; at the driven state the Lorentzian form gives α_y, and with it α.
    drive = frequency + 0.5 * mode.linewidth
    y = gain * steady(force, drive)
    peak = gain * force / small * linear
    inverse = peak * mode.linewidth / 2 / y
    detuning = inverse / (inverse.imag / (mode.linewidth / 2))
    alpha_y = (detuning.real + drive - frequency) / (0.375 * frequency * abs(y) ** 2)
    printed = alpha_y * (peak * mode.linewidth * frequency / force) ** 2
    np.testing.assert_allclose(printed * (4 * np.pi**2) ** 2, mode.alpha, rtol=0.03)


RINGING = {
    "cubic": Resonator(F0, 30, alpha=1.0),
    "everything": Resonator(F0, 30, alpha=1.0, quadratic=0.8, quintic=4.0, nonlinear_damping=180.0),
    "weak nonlinear damping": Resonator(F0, 30, quintic=30.0, nonlinear_damping=0.03),
}


@pytest.mark.parametrize(
    "name",
    [
        "everything",
        *(pytest.param(n, marks=pytest.mark.slow) for n in RINGING if n != "everything"),
    ],
)
def test_ring_down_error_falls_with_the_square_of_the_amplitude(name: str) -> None:
    mode = RINGING[name]
    errors = []
    for shrink in (1, 2, 4):
        # 1/Q falls with A², so that the decay keeps its shape while all small parameters vanish
        # together.
        start = 0.1 / shrink
        scale = shrink**2
        growth = {
            "quintic": mode.quintic * scale,
            "nonlinear_damping": mode.nonlinear_damping * scale,
        }
        slow = replace(mode, quality_factor=mode.quality_factor * scale, **growth)
        time = np.linspace(0, 3 / slow.damping, 4000 * scale)
        phase = np.unwrap(np.angle(ring_down(slow, start, time)))
        periods = int(phase[-1] / (2 * np.pi))
        at = np.interp(np.arange(periods * 32) * (2 * np.pi / 32), phase, time)
        state = [start - mode.quadratic * start**2 / 3], [-start * slow.damping / 2]
        q, _ = integrate(couple([slow]), [0.0], F0, *state, at, tolerance=1e-11)
        ratio = np.mean((2 * q[0] / ring_down(slow, start, at)).reshape(periods, 32), axis=1)
        errors.append(np.max(np.abs(ratio - 1)))
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    assert errors[0] < 0.1
    np.testing.assert_allclose(rates[-1], 2, atol=0.1)
