"""The Duffing response y(f) with its analytic derivatives, on both of its branches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.observe.response.sweeps import Array, Complex, Index, Sweeps
from femnl.observe.response.theta import Layout
from femnl.resonator import duffing_roots
from femnl.resonator.roots import VERTICAL
from femnl.resonator.roots import continued as beyond_folds

# a = STIFFEN α_y/α_c in b = 1/(δ + a |b|² + i).
STIFFEN = VERTICAL
# Derivatives are limited to 1/FOLD times those of a linear resonator.
FOLD = 0.01
NOISY = 2.0


@dataclass(frozen=True)
class ResponseBranches:
    """The squared amplitudes x of the low and the high state at every point, (2, n).

    Past a fold, where a branch has ended, x is continued by the real part of the complex pair of
    roots, so that the misfit of points still on the branch tells a fit which way to move the fold.
    pair (2, n): where x is only such a continuation. single: the real root there.
    """

    x: Array
    pair: NDArray[np.bool_]
    single: Array


def duffing_branches(delta: Array, a: Array, d: Array, *, continued: bool) -> ResponseBranches:
    """Return both branches of the response, (2, n).

    Args: delta, a, d (n,): detuning δ, stiffening and nonlinear damping.

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

    There is no nonlinear damping here, so that dδ/da = −x there.

    With R = δ + a x, x = 1/(R² + 1) and (R² + 1)² + 2aR = 0; below the critical a, where no state
    ends, its double root.
    """
    size = max(abs(a), STIFFEN)
    roots = np.roots([1.0, 0.0, 2.0, 2 * size, 1.0])
    real = np.sort(roots[np.argsort(np.abs(roots.imag))[:2]].real)
    r = float(real[1] if top else real[0])
    x = 1 / (r**2 + 1)
    return float(np.copysign(r - size * x, -a)), x


@dataclass(frozen=True)
class Reduced:
    """The exact harmonic balance in the form 1/(δ + a x + i(1 + d x)) that its cubic has.

    With g = f/f₀ the balance of the first harmonic of ẍ + 2πw ẋ (1 + …) + (2πf₀)² x (1 + α x²)
    reads b = 1/(Δ + a|b|² + i g (1 + d|b|²)), Δ = (f₀² − f²)/(f₀ w). Here δ = Δ/g, the stiffening
    is a/g³, the nonlinear damping d/g², and x = g²|b|², so that b = 1/(g (δ + …)). All (n,).
    """

    g: Array
    delta: Array
    stiffening: Array
    damping: Array


def reduced(sweeps: Sweeps, f0: float, w: float, ratio: float, damping: float) -> Reduced:
    """Return the reduced detuning, stiffening and nonlinear damping at every point.

    Args: f0, w [Hz]; ratio: α_y/α_c and damping: d, both at the strongest drive.
    """
    f = sweeps.frequency
    g = f / max(f0, np.finfo(float).tiny)
    power = sweeps.drive**2
    # (f₀ − f)(f₀ + f), since f₀² − f² loses the digits that a high Q needs
    delta = (f0 - f) * (f0 + f) / (f * w)
    return Reduced(g, delta, STIFFEN * ratio * power / g**3, damping * power / g**2)


def background_columns(sweeps: Sweeps, layout: Layout, f0: float) -> Array:
    """Return 1 and (f − f₀)/span as far as the layout has them, (n, terms), times the drive.

    The drive is that of the strongest sweep as 1, and counts where the background is driven.
    """
    away = (sweeps.frequency - f0) / layout.span
    columns = np.stack([np.ones_like(away), away], axis=1)[:, : layout.background]
    return np.asarray(columns * (sweeps.drive[:, None] if layout.driven else 1.0))


def response(
    sweeps: Sweeps, layout: Layout, theta: Array, *, continued: bool
) -> tuple[Complex, ResponseBranches]:
    """Return the voltage [V] on both branches, (2, n).

    It is drive · y_max b e^{iφ − 2πi(f − f₀)τ}, with the exact linear part of b, plus the
    background C₀ + C₁(f − f₀).
    """
    f0, w, ratio, damping, gain, phase, tau = layout.split(theta)
    exact = reduced(sweeps, f0, w, ratio, damping)
    both = duffing_branches(exact.delta, exact.stiffening, exact.damping, continued=continued)
    inverse = exact.delta + exact.stiffening * both.x + 1j * (1 + exact.damping * both.x)
    turn = np.exp(-2j * np.pi * (sweeps.frequency - f0) * tau)
    scale = gain[sweeps.position] * sweeps.drive * np.exp(1j * phase[sweeps.position])
    moving = scale * turn / (exact.g * inverse)
    if not layout.background:
        return moving, both
    columns = background_columns(sweeps, layout, f0)
    behind = np.sum(columns * layout.terms(theta)[sweeps.position], axis=1)
    return moving + behind * (turn if layout.delayed else 1.0), both


def jacobian(
    sweeps: Sweeps,
    layout: Layout,
    theta: Array,
    both: ResponseBranches,
    high: Index,
    *,
    cautious: bool,
) -> Complex:
    """Return dV/dθ (n, size) on the branch chosen at each point (0 low, 1 high).

    The derivatives are implicit.

    `cautious` limits each derivative to what stays true while the fit moves x by NOISY standard
    deviations, as a covariance needs.

    x |D|² = 1 with D = δ + a x + i(1 + d x) gives x_p = −x ∂|D|²/∂p / (|D|² + x ∂|D|²/∂x), and V_p
    = −V b D_p.
    """
    f0, w, ratio, damping, gain, phase, tau = layout.split(theta)
    exact = reduced(sweeps, f0, w, ratio, damping)
    n = len(sweeps.frequency)
    delta = exact.delta
    a = exact.stiffening
    d = exact.damping
    points = np.arange(n)
    x = both.x[high, points]
    pair = both.pair[high, points]
    away = sweeps.frequency - f0
    turn = np.exp(-2j * np.pi * away * tau)
    scale = gain[sweeps.position] * sweeps.drive * np.exp(1j * phase[sweeps.position])
    inverse = delta + a * x + 1j * (1 + d * x)
    voltage = scale * turn / (exact.g * inverse)
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
    # By δ, the stiffening and the nonlinear damping, all three as reduced
    change = -voltage / inverse * (direct + (a + 1j * d) * by)
    power = sweeps.drive**2
    out = np.zeros((n, layout.size), dtype=complex)
    out[:, 0] = layout.width * (
        change[0] * 2 * f0 / (sweeps.frequency * w)
        + change[1] * 3 * a / f0
        + change[2] * 2 * d / f0
        + voltage * (1 / f0 + 2j * np.pi * tau)
    )
    out[:, 1] = -change[0] * delta
    out[:, 2] = change[1] * STIFFEN * power / exact.g**3
    if layout.damping:
        out[:, 3] = change[2] * power / exact.g**2
    if layout.gain:
        out[points, layout.gains.start + sweeps.position] = voltage
    if layout.phase:
        out[points, layout.phases.start + sweeps.position] = 1j * voltage
        out[:, layout.delay] = -2j * np.pi * away / layout.span * voltage
    if layout.background:
        _background_slopes(out, sweeps, layout, theta, turn)
    return out


def _background_slopes(
    out: Complex, sweeps: Sweeps, layout: Layout, theta: Array, turn: Complex
) -> None:
    """Add to dV/dθ `out` (n, size) what the background does; turn (n,): of the delay."""
    f0, *_, tau = layout.split(theta)
    columns = background_columns(sweeps, layout, f0)
    factor = turn if layout.delayed else np.ones_like(turn)
    terms = layout.terms(theta)[sweeps.position]
    start = layout.backgrounds.start + 2 * layout.background * sweeps.position
    points = np.arange(len(start))
    for k in range(layout.background):
        out[points, start + 2 * k] = columns[:, k] * factor
        out[points, start + 2 * k + 1] = 1j * columns[:, k] * factor
    if layout.background > 1:
        # C₁ counts from f₀
        out[:, 0] -= terms[:, 1] * columns[:, 0] * factor * layout.width / layout.span
    if layout.delayed and layout.phase:
        behind = np.sum(columns * terms, axis=1) * factor
        out[:, 0] += 2j * np.pi * tau * layout.width * behind
        out[:, layout.delay] -= 2j * np.pi * (sweeps.frequency - f0) / layout.span * behind
