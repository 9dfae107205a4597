"""A mode that drifts past its drive while a map is taken, against its motion followed in time."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from femnl.core.stages import Motion
from femnl.effects import library

Array = NDArray[np.float64]


def motion(time: Array, size: float) -> Motion:
    shapes = np.ones((12, len(time)))
    swing = np.full(len(time), size * np.exp(0.4j))
    zero = np.zeros(len(time))
    return Motion(
        np.stack([swing, 0.1 * swing**2 / size]),
        zero,
        zero,
        zero,
        shapes,
        np.arange(1.0, 13.0),
        0,
        swing,
        633e-9,
        time,
    )


@pytest.mark.parametrize(
    ("detuning", "drift"), [(0.3, 1.0), pytest.param(-1.0, 3.0, marks=pytest.mark.slow)]
)
def test_the_motion_follows_the_equation_of_the_driven_mode(detuning: float, drift: float) -> None:
    # ü + 2πw u̇ + ω₀(t)² u = F cos ωt, with ω₀ that moves: not the slow equation, nor its steady
    # state. Q = 100, T = 200 ring-down times.
    omega = 2 * np.pi
    width = 1 / 100
    whole = 200 / (np.pi * width)

    def rate(t: float, s: Array) -> Array:
        part = t / whole - 0.5
        own = omega - 2 * np.pi * width * (detuning + drift * part)
        force = 2 * np.pi * width * omega * np.cos(omega * t)
        return np.asarray([s[1], force - 2 * np.pi * width * s[1] - own**2 * s[0]])

    at = np.round(np.array([0.3, 0.5, 0.8]) * whole)
    run = solve_ivp(rate, (0, at[-1] + 1.1), [0.0, 0.0], "DOP853", rtol=1e-8, dense_output=True)
    assert run.sol is not None
    tau = np.arange(32) / 32
    amplitude = np.array([2 * np.mean(run.sol(t + tau)[0] * np.exp(-1j * omega * tau)) for t in at])
    time = np.concatenate([[0.0], at + 0.5, [whole]])
    plain = motion(time, 1e-7)
    values = {"detuning": detuning, "drift": drift}
    found = library()["resonance_drift"].changes["motion"](plain, values)
    ratio = (found.displacement[0] / plain.displacement[0])[1:-1]
    # The lag r/(πwT), 1.5 % at r = 3, and 1/Q from the fast terms that a Lorentzian leaves out
    np.testing.assert_allclose(ratio / ratio[1], amplitude / amplitude[1], rtol=0.04)
    np.testing.assert_allclose(
        found.displacement[1] / plain.displacement[1],
        (found.displacement[0] / plain.displacement[0]) ** 2,
        rtol=1e-12,
    )


def test_in_the_middle_of_the_map_and_without_drift_nothing_changes() -> None:
    time = np.linspace(5.0, 95.0, 7)
    plain = motion(time, 2e-7)
    change = library()["resonance_drift"].changes["motion"]
    moved = change(plain, {"detuning": 0.7, "drift": 2.0})
    assert moved.swing[3] == pytest.approx(plain.swing[3], rel=1e-14)
    still = change(plain, {"detuning": 0.7, "drift": 0.0})
    np.testing.assert_allclose(still.displacement, plain.displacement, rtol=1e-14)
