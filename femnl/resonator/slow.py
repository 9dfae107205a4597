"""The driven response of one mode in the rotating-wave approximation.

All branches, their stability, sweeps, critical point.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.resonator import Array, Branches, Complex, Resonator
from femnl.resonator.roots import duffing_roots

CRITICAL = 32 * np.sqrt(3) / 27
# A root of a quintic counts as real below this relative imaginary part: eigenvalues split by √ε at
# a fold.
REAL = 1e-7
# The slow flow has chosen its attractor when this much closer to it than the attractors are to each
# other.
REACHED = 1e-3
MAX_SPANS = 400


def critical_alpha(frequency: ArrayLike, linewidth: ArrayLike, peak: ArrayLike) -> Array:
    """Return the Duffing parameter at which a response first becomes vertical.

    α_c = (32√3/27) w/(f₀ y_max²).

    Args:
        frequency: f₀ [Hz].
        linewidth: w [Hz].
        peak: y_max, the linear response at f₀ in any unit; α_c comes in that unit to the power −2.
    Valid: Lorentzian approximation, w ≪ f₀, no nonlinear damping.
    Source: Cleland, Foundations of Nanomechanics (2003), as used in arXiv:2502.19191, S2.
    """
    return np.asarray(
        CRITICAL * np.asarray(linewidth) / (np.asarray(frequency) * np.asarray(peak) ** 2)
    )


def critical_point(resonator: Resonator) -> tuple[float, float, float]:
    """Return the drive at which the driven response first becomes vertical.

    Force [m/s²], drive frequency [Hz] and amplitude [m].

    With D(X) = δ + a X + i (b + d X) and X = |A|², it is the double root of d(X|D|²)/dX.

    Raises:
        ParameterError: where the response never becomes vertical, |a| ≤ √3 d.
    Valid: Lorentzian approximation; quintic stiffness is not seen at this order.
    Source: Lifshitz and Cross (2008), Nonlinear dynamics of nanomechanical and micromechanical
    resonators, section 1.3.
    """
    omega = resonator.omega
    a = 0.75 * omega**2 * resonator.effective_alpha
    b = omega * resonator.damping
    d = omega * resonator.damping * resonator.nonlinear_damping / 4
    if abs(a) <= np.sqrt(3) * d or a == 0:
        raise ParameterError(
            f"alpha: an effective {resonator.effective_alpha:g} m⁻² never makes the response "
            f"vertical with a nonlinear damping of {resonator.nonlinear_damping:g} m⁻²; raise "
            "alpha or lower nonlinear_damping"
        )
    roots = np.roots([a**2 - 3 * d**2, 8 * a * b * d, b**2 * (d**2 - 3 * a**2)]).real
    delta = roots[np.argmin(roots * a)]
    square = -2 * (delta * a + b * d) / (3 * (a**2 + d**2))
    force = np.sqrt(square) * abs(complex(delta + a * square, b + d * square))
    return (
        float(force),
        float(resonator.frequency - delta / (2 * omega) / (2 * np.pi)),
        float(np.sqrt(square)),
    )


def branches(resonator: Resonator, force: float, frequency: ArrayLike) -> Branches:
    """Return all steady states of the driven mode and whether they are stable.

    A [ω₀²(1 + ¾ α X + ⅝ α₅ X²) − ω² + iωγ(1 + ¼ η X)] = 𝓕 with X = |A|² and α lowered by (10/9)κ₂²;
    a state is stable where d𝓕²/dX > 0 and the slow flow contracts, 1 + ½ η X > 0.

    Args:
        resonator: the mode.
        force: 𝓕 [m/s²], u = Re(A e^{iωt}).
        frequency: of the drive (n,) [Hz].
    Valid: α X, α₅ X² and 1/Q ≪ 1, no resonance of an overtone; `balance` has no such limits.
    Source: first-order averaging, e.g. Nayfeh and Mook, Nonlinear Oscillations (1979), section 4.1.
    """
    drive = np.atleast_1d(np.asarray(frequency, dtype=float))
    omega = 2 * np.pi * drive
    if force <= 0 or resonator.nonlinear_damping < 0:
        raise ParameterError(
            f"force = {force:g} m/s², nonlinear_damping = {resonator.nonlinear_damping:g} m⁻²: "
            "give a positive force and a damping ≥ 0"
        )
    flow = _Flow.of(resonator, force, omega)
    x = (
        duffing_roots(flow.detuning, flow.cubic, flow.loss).T
        if resonator.quintic == 0
        else flow.quintic_roots()
    )
    with np.errstate(invalid="ignore"):
        b = 1 / flow.response(x.T).T
    return Branches(drive, flow.scale[:, None] * b, flow.stable(x.T).T)


def sweep(resonator: Resonator, force: float, frequency: ArrayLike) -> Complex:
    """Return the complex amplitude [m] as the drive steps slowly through the frequencies.

    In the order given, jumps included.

    The drive is switched on at the first frequency with the mode at rest. Where several states are
    stable, the one reached is found by integrating the slow flow 2iω dA/dt = 𝓕 − A D(|A|²) from the
    state before.

    Args:
        resonator: the mode.
        force: 𝓕 [m/s²].
        frequency: of the drive (n,) [Hz]; rising for an up sweep, falling for a down sweep.
    Valid: as `branches`, and a sweep slow enough to settle at each point.
    """
    states = branches(resonator, force, frequency)
    flow = _Flow.of(resonator, force, 2 * np.pi * states.frequency)
    path = np.empty(len(states.frequency), dtype=complex)
    amplitude = 0j
    for point, (candidates, stable) in enumerate(zip(states.amplitude, states.stable, strict=True)):
        attractors = candidates[stable]
        saddles = candidates[~stable & np.isfinite(candidates)]
        nearest = attractors[np.argmin(np.abs(attractors - amplitude))]
        inside = saddles.size and np.abs(nearest - amplitude) < 0.25 * np.min(
            np.abs(saddles - nearest)
        )
        if len(attractors) > 1 and not inside:
            nearest = flow.settle(point, amplitude, attractors)
        path[point] = amplitude = nearest
    return path


@dataclass(frozen=True)
class _Flow:
    """The slow flow for b = A/scale, scale = 𝓕/ωγ.

    Db/d(γt/2) = −i [1 − b (δ + a x + c x² + i (1 + d x))], x = |b|².
    """

    scale: Array
    detuning: Array
    cubic: Array
    quintic: Array
    loss: Array

    @classmethod
    def of(cls, resonator: Resonator, force: float, omega: Array) -> "_Flow":
        """Normalise the resonator at the drive frequencies ω [rad/s]."""
        width = omega * resonator.damping
        scale = force / width
        stiff = resonator.omega**2 / width
        return cls(
            scale,
            (resonator.omega**2 - omega**2) / width,
            0.75 * resonator.effective_alpha * stiff * scale**2,
            0.625 * resonator.quintic * stiff * scale**4,
            resonator.nonlinear_damping * scale**2 / 4,
        )

    def response(self, x: Array) -> Complex:
        """Return 1/b at the squared amplitudes x (…, n)."""
        return self.detuning + self.cubic * x + self.quintic * x**2 + 1j * (1 + self.loss * x)

    def stable(self, x: Array) -> NDArray[np.bool_]:
        """Tell where a state of squared amplitude x (…, n) is stable."""
        response = self.response(x)
        slope = np.abs(response) ** 2 + 2 * x * (
            response.real * (self.cubic + 2 * self.quintic * x) + response.imag * self.loss
        )
        return np.isfinite(x) & (slope > 0) & (1 + 2 * self.loss * x > 0)

    def quintic_roots(self) -> Array:
        """Return the real squared amplitudes (n, m) at each frequency, ascending, then NaN."""
        a = self.cubic
        c = self.quintic
        d = self.loss
        delta = self.detuning
        columns = [
            c**2,
            2 * a * c,
            a**2 + d**2 + 2 * delta * c,
            2 * (delta * a + d),
            delta**2 + 1,
            -np.ones_like(delta),
        ]
        x = np.full((len(delta), 5), np.nan)
        for point, polynomial in enumerate(np.stack(columns, axis=1)):
            roots = np.roots(polynomial)
            real = np.sort(
                roots.real[(np.abs(roots.imag) < REAL * np.abs(roots)) & (roots.real > 0)]
            )
            x[point, : len(real)] = real
        return x

    def settle(self, point: int, amplitude: complex, attractors: Complex) -> complex:
        """Return the attractor [m] that the slow flow reaches from the given amplitude [m]."""
        b = np.array([amplitude / self.scale[point]])
        goal = attractors / self.scale[point]
        near = REACHED * np.min(
            np.abs(np.subtract.outer(goal, goal))[~np.eye(len(goal), dtype=bool)]
        )

        def rate(_time: float, state: Complex) -> Complex:
            x = np.abs(state) ** 2
            stiff = self.detuning[point] + self.cubic[point] * x + self.quintic[point] * x**2
            return np.asarray(-1j * (1 - state * (stiff + 1j * (1 + self.loss[point] * x))))

        for _ in range(MAX_SPANS):
            b = solve_ivp(rate, (0, 5), b, method="DOP853", rtol=1e-8, atol=1e-10).y[:, -1]
            distance = np.abs(goal - b)
            if distance.min() < near:
                return complex(attractors[np.argmin(distance)])
        raise ConvergenceError(
            f"frequency: no steady state within {5 * MAX_SPANS} decay times of the amplitude; "
            "move the point off the jump"
        )
