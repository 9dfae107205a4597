"""A mode that does not settle: its motion from one rest of the drive to the next."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from femnl.core.readout import ComplexArray
from femnl.observe.response.acquisition import TURNS, settle
from femnl.resonator import duffing_roots

EXACT = 3e-6
"""What the motion may miss, in the linear amplitude at resonance; not taken from the code."""


def after(start: complex, steady: complex, delta: float, a: complex, rest: float) -> complex:
    """Return the amplitude at the end of a rest."""
    found = np.zeros(2, complex)
    settle(
        found,
        np.array([start, steady]),
        np.full(2, delta),
        np.full(2, a, complex),
        np.array([0.0, rest]),
        np.array([True, False]),
    )
    return complex(found[1])


def steady_state(delta: float, a: complex, guess: complex) -> complex:
    """Return where db/ds = i((δ + a|b|² + i)b − 1) rests."""
    b = guess
    for _ in range(500):
        b = 0.5 * b + 0.5 / (delta + a * abs(b) ** 2 + 1j)
    return complex(b)


@pytest.mark.parametrize("rest", [0.3, 2.0, 12.0])
def test_the_motion_is_that_of_the_differential_equation(rest: float) -> None:
    delta, a = -1.0, 0.4 + 0j
    start = 0.9 + 0.4j

    def slope(s: float, y: ComplexArray) -> ComplexArray:
        b = y[0]
        return np.array([1j * ((delta + a * abs(b) ** 2 + 1j) * b - 1)])

    whole = solve_ivp(slope, (0, rest), [start], rtol=1e-10, atol=1e-12)
    b = steady_state(delta, a, 0.5 + 0j)
    assert after(start, b, delta, a, rest) == pytest.approx(whole.y[0, -1], abs=EXACT)


@pytest.mark.parametrize("kept", [1e-3, 0.1, 0.5, 0.9])
@pytest.mark.parametrize("stiffening", [0.5, 3.0, -12.0])
def test_a_sweep_over_a_resonance_is_that_of_the_differential_equation(
    stiffening: float, kept: float
) -> None:
    """Along the high branch and past its end, against an integrator of eighth order."""
    n = 60
    delta = np.linspace(20, -20, n) * np.sign(stiffening)
    a = np.full(n, stiffening, complex)
    roots = duffing_roots(delta, a.real)
    high = np.where(np.isfinite(roots[2]), roots[2], roots[0])
    steady = 1 / (delta + stiffening * high + 1j)
    rest = np.full(n, -np.log(kept))
    found = np.zeros(n, complex)
    settle(found, steady, delta, a, rest, np.arange(n) == 0)
    whole = np.array(steady)
    for k in range(1, n):

        def slope(s: float, y: ComplexArray, k: int = k) -> ComplexArray:
            return np.array([1j * ((delta[k] + a[k] * abs(y[0]) ** 2 + 1j) * y[0] - 1)])

        motion = solve_ivp(
            slope, (0, rest[k]), [whole[k - 1]], method="DOP853", rtol=1e-10, atol=1e-12
        )
        whole[k] = motion.y[0, -1]
    assert np.abs(found - whole).max() < EXACT


def test_a_trial_that_turns_a_million_times_ends() -> None:
    fast = after(1.0 + 0j, 0.1 + 0j, 1e9, 1e9 + 0j, 1e6)
    assert fast == pytest.approx(0.1, abs=1e-6)
    assert TURNS < 1e9 * 20


def test_a_trial_without_a_number_ends() -> None:
    assert np.isfinite(after(1.0 + 0j, 0.1 + 0j, np.inf, 1.0 + 0j, 5.0))


def test_beside_a_state_that_does_not_last_the_motion_goes_to_one_that_does() -> None:
    """δ = −3, a = 4: x((δ + ax)² + 1) = 1 has three roots, of which the middle one is unstable."""
    delta, a = -3.0, 4.0 + 0j
    squares = np.sort(np.roots([a.real**2, 2 * a.real * delta, delta**2 + 1, -1]).real)
    low, middle, high = (1 / (delta + a * x + 1j) for x in squares)
    assert abs(squares[1] * ((delta + a.real * squares[1]) ** 2 + 1) - 1) < 1e-9
    for off in (0.01, -0.01):
        end = after(complex(middle * (1 + off)), complex(middle), delta, a, 500.0)
        assert min(abs(end - low), abs(end - high)) < 1e-3
