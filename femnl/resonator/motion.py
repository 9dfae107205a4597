"""Direct time integration of driven coupled modes."""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from femnl.core.errors import ConvergenceError
from femnl.core.resonator import Array, CoupledModes
from femnl.resonator.system import scaled


def integrate(
    modes: CoupledModes,
    force: ArrayLike,
    frequency: float,
    displacement: ArrayLike,
    velocity: ArrayLike,
    time: ArrayLike,
    *,
    tolerance: float = 1e-10,
) -> tuple[Array, Array]:
    """Return displacement [m] and velocity [m/s], both (modes, times), under 𝓕 cos ωt.

    From a given state at time[0].

    Args:
        modes: the equations.
        force: 𝓕ᵢ (n,) [m/s²]; zero for a free decay.
        frequency: of the drive [Hz].
        displacement: qᵢ (n,) [m] at time[0].
        velocity: dqᵢ/dt (n,) [m/s] at time[0].
        time: (t,) [s], rising.
        tolerance: relative, of each step.
    Source: eighth-order Dormand–Prince as in scipy's DOP853 (Hairer, Nørsett and Wanner, 1993).
    """
    t = np.asarray(time, dtype=float)
    start = np.concatenate([np.atleast_1d(displacement), np.atleast_1d(velocity)]).astype(float)
    n = modes.count
    rate = float(modes.omega[0])
    start[n:] /= rate
    length = float(np.max(np.abs(start))) or float(
        np.max(np.abs(np.asarray(force)) / modes.omega**2)
    )
    unit = scaled(modes, length, rate)
    push = np.atleast_1d(np.asarray(force, dtype=float)) / (length * rate**2)
    omega = 2 * np.pi * frequency / rate

    stiffness = unit.omega**2
    second = unit.quadratic.reshape(n, -1)
    third = unit.cubic.reshape(n, -1)

    def slope(tau: float, state: Array) -> Array:
        q = state[:n]
        v = state[n:]
        square = q * q
        pairs = square if n == 1 else np.outer(q, q).ravel()
        triples = square * q if n == 1 else np.outer(pairs, q).ravel()
        pull = (stiffness + unit.quintic * square * square) * q + unit.damping * (
            1 + unit.nonlinear_damping * square
        ) * v
        return np.concatenate(
            [v, push * math.cos(omega * tau) - pull - second @ pairs - third @ triples]
        )

    span = (t[0] * rate, t[-1] * rate)
    solution = solve_ivp(
        slope,
        span,
        start / length,
        method="DOP853",
        t_eval=t * rate,
        rtol=tolerance,
        atol=tolerance * 1e-2,
    )
    if not solution.success:
        raise ConvergenceError(
            f"tolerance = {tolerance:g}: the time integration stopped, {solution.message}; check "
            "force and modes"
        )
    return solution.y[:n] * length, solution.y[n:] * (length * rate)
