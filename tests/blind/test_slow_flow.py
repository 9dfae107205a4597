"""Sweeps of the laboratory far from resonance, and drifts that lead there."""

import numpy as np
import pytest

from tests.blind.lab.slow_flow import Flow, compiled
from tests.blind.realistic.files import Draw, prepared


@pytest.mark.parametrize("detuning", [3.0, -75.0, 400.0])
@pytest.mark.parametrize("cubic", [0.0, 40.0])
def test_a_mode_far_from_resonance_settles_where_its_forces_balance(
    detuning: float, cubic: float
) -> None:
    # Steps of a twentieth of a decay time grow without end beyond a detuning of 56 half linewidths
    one = np.ones(1)
    none = 0.0 * one
    flow = Flow(
        detuning * one,
        cubic * one,
        none,
        none,
        np.ones(1, np.complex128),
        np.full(1, 1j, np.complex128),
        none,
        np.array([2]),
        np.inf * one,
        none,
        none,
    )
    state = np.zeros(1, complex)
    compiled()(state, np.zeros(1, complex), False, flow)
    force = state * (detuning + cubic * np.abs(state) ** 2 + 1j)
    np.testing.assert_allclose(force, 1.0, atol=2e-3)


def test_a_drift_leaves_the_mode_within_the_sweeps() -> None:
    # Eight times as fast it shows an eighth of that, and faster still nothing
    film = prepared(
        Draw("response", ("frequency_drift",), "correlated noise", "square-270um", 3810347706)
    )
    assert film.sigma["frequency_drift"] > 100
