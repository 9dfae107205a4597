"""The Duffing response y(f) with its analytic derivatives, on both of its branches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.observe.response.sweeps import Array, Complex, Index, Sweeps
from femnl.resonator import duffing_roots
from femnl.resonator.roots import VERTICAL
from femnl.resonator.roots import continued as beyond_folds

# a = STIFFEN α_y/α_c in b = 1/(δ + a |b|² + i).
STIFFEN = VERTICAL
# Derivatives are limited to 1/FOLD times those of a linear resonator.
FOLD = 0.01
NOISY = 2.0


@dataclass(frozen=True)
class Layout:
    """Where each parameter stands in the vector θ of a fit.

    θ = ((f₀ − centre)/width, ln(w/width), α_y/α_c at the strongest drive, [d], ln y_max per
    position, φ per position, τ·span); f₀ and w count from `centre` in units of `width` [Hz], y_max
    in V per `reference` [V] of drive, τ in 1/span [Hz]. y_max is missing in a fit to phases, φ and
    τ in a fit to magnitudes, and d, the nonlinear damping at x = 1, unless asked for.
    """

    centre: float
    width: float
    span: float
    reference: float
    n_positions: int
    damping: bool
    gain: bool
    phase: bool

    @property
    def gains(self) -> slice:
        """Where ln y_max stands."""
        start = 4 if self.damping else 3
        return slice(start, start + (self.n_positions if self.gain else 0))

    @property
    def phases(self) -> slice:
        """Where φ stands."""
        return slice(self.gains.stop, self.gains.stop + (self.n_positions if self.phase else 0))

    @property
    def size(self) -> int:
        """How many parameters there are."""
        return int(self.phases.stop) + int(self.phase)

    def theta_of(self, k: int, value: float) -> float:
        """Return the entry k of θ for a parameter's value in SI."""
        if k == 0:
            return (value - self.centre) / self.width
        if k == 1:
            return float(np.log(max(value, np.finfo(float).tiny) / self.width))
        if self.gains.start <= k < self.gains.stop:
            return float(np.log(max(value * self.reference, np.finfo(float).tiny)))
        return value * self.span if self.phase and k == self.size - 1 else value

    def split(self, theta: Array) -> tuple[float, float, float, float, Array, Array, float]:
        """Return f₀ [Hz], w [Hz], α_y/α_c, d, y_max and φ by position, and τ [s]."""
        gain = (
            np.exp(np.clip(theta[self.gains], -100, 100))
            if self.gain
            else np.ones(self.n_positions)
        )
        phase = theta[self.phases] if self.phase else np.zeros(self.n_positions)
        tau = float(theta[-1]) / self.span if self.phase else 0.0
        damping = float(theta[3]) if self.damping else 0.0
        # A step of a fit may go anywhere; beyond these the arithmetic overflows.
        w = self.width * float(np.exp(np.clip(theta[1], -25, 25)))
        ratio = float(np.clip(theta[2], -1e6, 1e6))
        return (
            self.centre + self.width * float(np.clip(theta[0], -1e6, 1e6)),
            w,
            ratio,
            damping,
            gain,
            phase,
            tau,
        )


@dataclass(frozen=True)
class ResponseBranches:
    """The squared amplitudes x of the low and the high state at every point, (2, n).

    And where they are only a continuation.

    Past a fold, where a branch has ended, x is continued by the real part of the complex pair of
    roots, so that the misfit of points still on the branch tells a fit which way to move the fold.
    pair (2, n): where that is so. single: the real root there.
    """

    x: Array
    pair: NDArray[np.bool_]
    single: Array


def duffing_branches(delta: Array, a: Array, d: Array, *, continued: bool) -> ResponseBranches:
    """Return both branches of the response, (2, n).

    At detunings δ (n,), stiffening a (n,) and nonlinear damping d (n,).

    Past its fold a branch is `continued`, or else it joins the only state that is left.
    """
    roots = duffing_roots(delta, a, d)
    single = roots[0]
    real = np.stack([single, np.where(np.isfinite(roots[2]), roots[2], single)])
    pair = np.zeros(real.shape, dtype=bool)
    if continued:
        pair = beyond_folds(real, delta, a, d)
    return ResponseBranches(real, pair, single)


def fold(a: float, *, top: bool) -> tuple[float, float]:
    """Return detuning δ and x where the high (`top`) or the low state ends.

    Without nonlinear damping; dδ/da = −x there.

    With R = δ + a x, x = 1/(R² + 1) and (R² + 1)² + 2aR = 0; below the critical a, where no state
    ends, its double root.
    """
    size = max(abs(a), STIFFEN)
    roots = np.roots([1.0, 0.0, 2.0, 2 * size, 1.0])
    real = np.sort(roots[np.argsort(np.abs(roots.imag))[:2]].real)
    r = float(real[1] if top else real[0])
    x = 1 / (r**2 + 1)
    return float(np.copysign(r - size * x, -a)), x


def response(
    sweeps: Sweeps, layout: Layout, theta: Array, *, continued: bool
) -> tuple[Complex, ResponseBranches]:
    """Return the voltage [V] on both branches: y_max b e^{iφ − 2πi(f − f₀)τ} times drive."""
    f0, w, ratio, damping, gain, phase, tau = layout.split(theta)
    power = sweeps.drive**2
    delta = 2 * (f0 - sweeps.frequency) / w
    a = STIFFEN * ratio * power
    d = damping * power
    both = duffing_branches(delta, a, d, continued=continued)
    b = 1 / (delta + a * both.x + 1j * (1 + d * both.x))
    turn = np.exp(1j * (phase[sweeps.position] - 2 * np.pi * (sweeps.frequency - f0) * tau))
    return gain[sweeps.position] * sweeps.drive * turn * b, both


def jacobian(
    sweeps: Sweeps,
    layout: Layout,
    theta: Array,
    both: ResponseBranches,
    high: Index,
    voltage: Complex,
    *,
    cautious: bool,
) -> Complex:
    """Return dV/dθ (n, size) on the branch chosen at each point (0 low, 1 high).

    By implicit differentiation.

    `cautious` limits each derivative to what stays true while the fit moves x by NOISY standard
    deviations, as a covariance needs.

    x |D|² = 1 with D = δ + a x + i(1 + d x) gives x_p = −x ∂|D|²/∂p / (|D|² + x ∂|D|²/∂x), and V_p
    = −V b D_p.
    """
    f0, w, ratio, damping, _gain, _phase, tau = layout.split(theta)
    power = sweeps.drive**2
    n = len(sweeps.frequency)
    delta = 2 * (f0 - sweeps.frequency) / w
    a = STIFFEN * ratio * power
    d = damping * power
    points = np.arange(n)
    x = both.x[high, points]
    pair = both.pair[high, points]
    root = np.where(pair, both.single, x)
    real = delta + a * root
    imag = 1 + d * root
    square = real**2 + imag**2
    slope = square + 2 * root * (real * a + imag * d)
    # At a fold the slope is 0 and the derivative infinite over a vanishing range: a floor keeps one
    # point from ruling a fit.
    floor = FOLD * square
    if cautious:
        bend = 4 * (real * a + imag * d) + 2 * root * (a**2 + d**2)
        shift = 2 * root * sweeps.noise / np.abs(voltage) * np.sqrt(layout.size / n)
        floor = np.maximum(floor, NOISY * np.abs(bend) * shift)
    slope = np.copysign(np.maximum(np.abs(slope), floor), slope)
    by = np.stack([-2 * root * real, -2 * root**2 * real, -2 * root**2 * imag]) / slope
    if pair.any():
        # x = −q/p − root/2 with p = a² + d², q = δa + d.
        p = a**2 + d**2
        q = delta * a + d
        p = np.where(pair, p, 1.0)
        outer = np.stack([-a / p, -(delta * p - 2 * a * q) / p**2, -(p - 2 * d * q) / p**2])
        by = np.where(pair, outer - by / 2, by)
    direct = np.stack([np.ones(n), x, 1j * x])
    change = -voltage / (delta + a * x + 1j * (1 + d * x)) * (direct + (a + 1j * d) * by)
    out = np.zeros((n, layout.size), dtype=complex)
    out[:, 0] = change[0] * (2 * layout.width / w) + 2j * np.pi * tau * layout.width * voltage
    out[:, 1] = -change[0] * delta
    out[:, 2] = change[1] * STIFFEN * power
    if layout.damping:
        out[:, 3] = change[2] * power
    if layout.gain:
        out[points, layout.gains.start + sweeps.position] = voltage
    if layout.phase:
        out[points, layout.phases.start + sweeps.position] = 1j * voltage
        out[:, -1] = -2j * np.pi * (sweeps.frequency - f0) / layout.span * voltage
    return out
