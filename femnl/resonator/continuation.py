"""Curves of periodic motions against drive frequency.

All branches by arc length, and sweeps with their jumps.
"""

import numpy as np
from numpy.typing import ArrayLike

from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.resonator import Array, Complex, CoupledModes, PeriodicMotion, Resonator
from femnl.resonator.balance import Balance
from femnl.resonator.motion import integrate
from femnl.resonator.slow import branches
from femnl.resonator.system import couple

MAX_POINTS = 20_000
# Largest turn of the tangent, in radians, and change of the unknowns between neighbouring points of
# a curve.
MAX_TURN = 0.2
# A sweep stays on its branch while the motion changes less than this from point to point.
CLOSE = 0.3
# A transient has settled when its last period is this close, relatively, to a periodic motion.
SETTLED = 1e-3
MAX_BLOCKS = 60
# A transient only has to lead to the right motion; the balance then makes it exact.
SETTLING = 1e-6


def balance(
    resonator: Resonator, force: float, frequency: float, n_harmonics: int
) -> PeriodicMotion:
    """Return every periodic motion of one mode near its rotating-wave states.

    By harmonic balance of the full equation.

    Args:
        resonator: the mode.
        force: 𝓕 [m/s²].
        frequency: of the drive [Hz].
        n_harmonics: harmonics kept beside the constant.
    Valid: away from folds, where two rotating-wave states may lead to one motion: then it is listed
    once.
    Source: Krack and Gross, Harmonic Balance for Nonlinear Vibration Problems (2019).
    """
    states = branches(resonator, force, [frequency])
    equations = Balance.of(couple([resonator]), np.array([force]), n_harmonics)
    omega = 2 * np.pi * frequency / equations.rate
    found = list[Array]()
    for amplitude in states.amplitude[0][np.isfinite(states.amplitude[0])]:
        square = resonator.quadratic * abs(amplitude) ** 2
        start = np.array([[-square / 2, amplitude, square / 6 * np.exp(2j * np.angle(amplitude))]])
        x = equations.solve(equations.pack(start), omega)
        if not any(np.linalg.norm(x - other) < 1e-6 * np.linalg.norm(x) for other in found):
            found.append(x)
    return _collect(equations, [(x, omega) for x in found])


def curve(
    modes: CoupledModes, force: ArrayLike, start: float, stop: float, n_harmonics: int
) -> PeriodicMotion:
    """Follow the response from drive frequency `start` round all its folds.

    Until it leaves through `stop` [Hz].

    Pseudo-arclength continuation: Newton's method on the balance and on the distance along the
    tangent.

    Args:
        modes: the equations.
        force: 𝓕ᵢ (n,) [m/s²].
        start: frequency [Hz] far enough off resonance for the linear response to be a good start.
        stop: frequency [Hz] on the other side.
        n_harmonics: harmonics kept beside the constant.

    Raises:
        ConvergenceError: where the curve cannot be followed, or returns to `start`.
    Valid: the branch connected to the start; isolated branches are found from their own starts
    only.
    Source: Keller (1977); Krack and Gross (2019), chapter 4.
    """
    equations, x = _linear_start(modes, force, start, n_harmonics)
    first, last = (2 * np.pi * f / equations.rate for f in (start, stop))
    width = float(np.min(equations.modes.damping))
    # In the arc length the frequency counts in line widths, so that frequency and displacement
    # weigh alike.
    point = np.append(equations.solve(x, first), first / width)
    points = [point]
    tangent = np.zeros_like(point)
    step = 0.05
    tangent[-1] = np.sign(last - first)
    while len(points) < MAX_POINTS:
        new, direction = _advance(equations, point, tangent, step, width)
        if new is None or direction is None or direction @ tangent < np.cos(MAX_TURN):
            step /= 2
            if step < 1e-9:
                reached = point[-1] * width * equations.rate / (2 * np.pi)
                raise ConvergenceError(
                    f"n_harmonics = {n_harmonics}: the curve is lost at {reached:.9g} Hz; keep "
                    "more harmonics"
                )
            continue
        step *= 1.3 if direction @ tangent > np.cos(MAX_TURN / 2) else 1.0
        point = new
        tangent = direction
        points.append(point)
        travelled = (point[-1] * width - first) / (last - first)
        if travelled >= 1:
            points[-1] = np.append(equations.solve(point[:-1], last), last / width)
            return _collect(equations, [(p[:-1], p[-1] * width) for p in points])
        if travelled < -1e-9:
            break
    raise ConvergenceError(
        f"start = {start:.9g} Hz: the curve does not reach stop = {stop:.9g} Hz; widen the range"
    )


def _advance(
    equations: Balance, point: Array, tangent: Array, step: float, width: float
) -> tuple[Array | None, Array | None]:
    """Take one predictor and its Newton corrections.

    Return the new point and its tangent, or None where Newton fails.
    """
    new = point + step * tangent
    for _ in range(8):
        value, jacobian, by_omega = equations.residual(new[:-1], new[-1] * width)
        matrix = np.vstack([np.column_stack([jacobian, by_omega * width]), tangent])
        change = np.linalg.solve(matrix, np.append(value, tangent @ (new - point) - step))
        new = new - change
        if np.linalg.norm(change) < 1e-11 * np.linalg.norm(new[:-1]) + 1e-13:
            _, jacobian, by_omega = equations.residual(new[:-1], new[-1] * width)
            matrix = np.vstack([np.column_stack([jacobian, by_omega * width]), tangent])
            direction = np.linalg.solve(matrix, np.append(np.zeros(len(value)), 1.0))
            return new, direction / np.linalg.norm(direction)
    return None, None


def sweep_modes(
    modes: CoupledModes, force: ArrayLike, frequency: ArrayLike, n_harmonics: int
) -> PeriodicMotion:
    """Return the stable motions as the drive steps slowly through the frequencies.

    In the order given, jumps included.

    From point to point the last motion starts the balance; where that fails or the motion found is
    unstable or far away, the equations are integrated in time from the last motion until a stable
    one is reached.

    Args:
        modes: the equations.
        force: 𝓕ᵢ (n,) [m/s²].
        frequency: (p,) [Hz], the first off resonance.
        n_harmonics: harmonics kept beside the constant.

    Raises:
        ConvergenceError: where the motion reached is not periodic with the drive (quasi-periodic,
            subharmonic, chaotic).
    """
    drive = np.atleast_1d(np.asarray(frequency, dtype=float))
    equations, x = _linear_start(modes, force, float(drive[0]), n_harmonics)
    path: list[tuple[Array, float]] = []
    for omega in 2 * np.pi * drive / equations.rate:
        x = _reach(equations, modes, x, omega) if path else equations.solve(x, omega)
        path.append((x, omega))
    return _collect(equations, path)


def _linear_start(
    modes: CoupledModes, force: ArrayLike, frequency: float, n_harmonics: int
) -> tuple[Balance, Array]:
    """Set up the balance and the linear response as its start."""
    push = np.atleast_1d(np.asarray(force, dtype=float))
    omega = 2 * np.pi * frequency
    if push.shape != (modes.count,) or not np.any(push) or n_harmonics < 1:
        raise ParameterError(
            f"force = {push}, n_harmonics = {n_harmonics}: give {modes.count} forces, not all "
            "zero, and at least one harmonic"
        )
    amplitude = push / (modes.omega**2 - omega**2 + 1j * omega * modes.damping)
    equations = Balance.of(modes, push, n_harmonics)
    return equations, equations.pack(np.column_stack([np.zeros(modes.count), amplitude]))


def _reach(equations: Balance, modes: CoupledModes, last: Array, omega: float) -> Array:
    """Return the stable motion that the last one leads to at the drive frequency ω."""
    try:
        x = equations.solve(last, omega)
    except ConvergenceError:
        return _settle(equations, modes, last, omega)
    close = np.linalg.norm(x - last) < CLOSE * np.linalg.norm(last)
    return (
        x if close and _is_stable(equations, x, omega) else _settle(equations, modes, last, omega)
    )


def _settle(equations: Balance, modes: CoupledModes, last: Array, omega: float) -> Array:
    """Integrate in time from the last motion until a stable periodic one is reached."""
    frequency = omega * equations.rate / (2 * np.pi)
    push = equations.force * equations.length * equations.rate**2
    start = equations.unpack(last)
    order = np.arange(start.shape[1])
    q = start.real.sum(axis=1)
    v = (start * 1j * order * 2 * np.pi * frequency).real.sum(axis=1)
    periods = int(np.ceil(2 * frequency / np.min(modes.damping)))
    samples = np.arange(len(equations.basis)) / len(equations.basis)
    for _ in range(MAX_BLOCKS):
        # One more period than the block is sampled; its first sample starts the next block at drive
        # phase zero.
        time = np.concatenate([[0.0], (periods + samples) / frequency])
        displacement, velocity = integrate(modes, push, frequency, q, v, time, tolerance=SETTLING)
        q = displacement[:, 1]
        v = velocity[:, 1]
        sampled = (displacement[:, 1:] @ equations.project.T / equations.length).ravel()
        try:
            x = equations.solve(sampled, omega)
        except ConvergenceError:
            continue
        if np.linalg.norm(x - sampled) < SETTLED * np.linalg.norm(x) and _is_stable(
            equations, x, omega
        ):
            return x
    raise ConvergenceError(
        f"frequency = {frequency:.9g} Hz: no periodic motion reached within {MAX_BLOCKS} blocks "
        f"of {periods} periods; the motion may be quasi-periodic or chaotic: use integrate"
    )


def _is_stable(equations: Balance, x: Array, omega: float) -> bool:
    return bool(np.max(np.abs(equations.multipliers(x, omega))) < 1)


def _collect(equations: Balance, path: list[tuple[Array, float]]) -> PeriodicMotion:
    """Put points (x, ω/ω₁) into SI, with their multipliers."""
    multipliers = np.array([equations.multipliers(x, omega) for x, omega in path])
    coefficients: Complex = np.array([equations.unpack(x) for x, _ in path])
    frequency = np.array([omega for _, omega in path]) * equations.rate / (2 * np.pi)
    return PeriodicMotion(
        frequency, coefficients, np.max(np.abs(multipliers), axis=1) < 1, multipliers
    )
