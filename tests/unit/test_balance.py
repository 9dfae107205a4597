"""Steady states of a driven mode solve the whole balance of its first harmonic."""

from dataclasses import replace

import numpy as np
import pytest

from femnl.core.stages import Oscillator
from femnl.observe.response.states import balance, branch_amplitudes

F0 = 1000.0
WIDTH = 200.0
PEAK = 1e-6
FREQUENCY = np.linspace(300.0, 2500.0, 45)
DRIVE = np.full(len(FREQUENCY), 0.5)
BEND = (0.5 * PEAK) ** -2
"""α at which the mode bends by about a linewidth [m⁻²]."""
LINEAR = Oscillator(
    np.full(len(FREQUENCY), F0),
    WIDTH,
    0.0,
    0.0,
    0.0,
    DRIVE,
    PEAK,
    np.empty(0),
    FREQUENCY,
    F0,
    np.zeros(len(FREQUENCY), complex),
)


@pytest.mark.parametrize(
    "mode",
    [
        LINEAR,
        replace(LINEAR, alpha=0.1 * BEND, damping=0.5 * BEND),
        replace(LINEAR, alpha=-0.01 * BEND),
        replace(LINEAR, alpha=0.1 * BEND, quintic=0.05 * BEND**2),
        replace(LINEAR, alpha=0.1 * BEND, pull=np.full(len(FREQUENCY), 20 + 5j)),
        replace(LINEAR, alpha=0.1 * BEND, pull=np.full(len(FREQUENCY), 20 + 5j), order=3.0),
    ],
    ids=["linear", "cubic and damped", "softening", "quintic", "pulled", "pulled by order 3"],
)
def test_states_at_a_quality_of_five_solve_the_whole_balance(mode: Oscillator) -> None:
    linear = PEAK * DRIVE
    found = branch_amplitudes(*balance(mode, FREQUENCY, linear))
    for b in found:
        a = b * linear * F0 / FREQUENCY
        x = np.abs(a) ** 2
        stiff = 1 + 0.75 * mode.alpha * x + 0.625 * mode.quintic * x**2
        force = F0**2 * stiff - FREQUENCY**2 + 1j * FREQUENCY * WIDTH * (1 + mode.damping * x / 4)
        if np.any(mode.pull):
            # A_s stiffens the mode by one linewidth
            by = x * 3 * F0 * abs(mode.alpha) / (8 * WIDTH)
            force = force + 2 * F0 * mode.pull * by ** (mode.order - 1)
        left = force * a - F0 * WIDTH * linear
        np.testing.assert_allclose(left / (F0 * WIDTH * linear), 0, atol=1e-9)
