"""Start values of a response fit from linear least squares: no guess, no tuning, and no branch to choose.

1/y is linear in 1, f and |y|², whatever branch a point lies on:  drive/V = [2(f₀ − f)/w + i + (a + i d) |V/y_max|²] / (y_max e^{iφ}).
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from femnl.fits.response_data import Array, Complex, Index, Sweeps
from femnl.fits.response_implicit import FOLD, whiten
from femnl.fits.response_misfit import Use
from femnl.fits.response_model import STIFFEN, Layout

# Delays tried, in units of 1/span.
DELAYS = np.linspace(-2, 2, 33)
# Backbone slopes tried for magnitudes, as the shift of the strongest point over the span.
SLOPES = np.concatenate([[0.0], *(sign * np.geomspace(1e-3, 1.5, 60) for sign in (1, -1))])
PHASES = np.arange(48) * (np.pi / 48)
# Points used, rounds of weighting and starts handed on, where a start is searched on a grid.
THINNED, ROUNDS, TRIED = 240, 4, 4
MAX_CALLS = 300
# Signal to noise from which a phase is taken at its full weight.
STRONG = 30.0
Mask = NDArray[np.bool_]
# f₀ [Hz], w [Hz], α_y/α_c, d, complex gain [V] and delay [s].
Start = tuple[float, float, float, float, complex, float]


def starts(sweeps: Sweeps, use: Use, layout: Layout) -> Iterator[Array]:
    """Yield start vectors θ, the most promising first: each from one position's own data, completed by the others'.

    The linear form of complex data comes first, because it takes no search; where noise spoils it, backbones are scanned.
    """
    if use == "complex":
        delay = _delay(sweeps)
        searches: list[Callable[[Sweeps, Mask], list[Start]]] = [partial(_from_complex, delay=delay), partial(_from_backbone, delay=delay)]
    else:
        searches = [_from_magnitude if use == "magnitude" else _from_phase]
    strength = [np.sum(np.abs(sweeps.voltage[sweeps.position == p]) ** 2) for p in range(sweeps.n_positions)]
    for search in searches:
        found = [search(sweeps, sweeps.position == p) for p in range(sweeps.n_positions)]
        gains = np.array([entries[0][4] if entries else 1.0 for entries in found])
        for p in np.argsort(strength)[::-1]:
            for f0, w, ratio, damping, gain, tau in found[p]:
                theta = np.zeros(layout.size)
                theta[:3] = (f0 - layout.centre) / layout.width, np.log(w / layout.width), ratio
                if layout.damping:
                    theta[3] = max(damping, 0.0)
                at = np.where(np.arange(sweeps.n_positions) == p, gain, gains)
                if layout.gain:
                    theta[layout.gains] = np.log(np.abs(at))
                if layout.phase:
                    theta[layout.phases] = np.angle(at)
                    theta[-1] = tau * layout.span
                yield theta


def _delay(sweeps: Sweeps) -> float:
    """Return the delay [s] at which the linear form fits best over all positions, by one projection for all delays."""
    tau = DELAYS / sweeps.span
    misfit = np.zeros(len(tau))
    for p in range(sweeps.n_positions):
        at = sweeps.position == p
        basis, weight, inverse, centre = _linear_form(sweeps, at)
        q, _ = np.linalg.qr(basis * weight[:, None])
        turned = (weight * inverse)[:, None] * np.exp(-2j * np.pi * np.outer(sweeps.frequency[at] - centre, tau))
        misfit += np.sum(np.abs(turned) ** 2, axis=0) - np.sum(np.abs(q.T @ turned) ** 2, axis=0)
    return float(tau[np.argmin(misfit)])


def _linear_form(sweeps: Sweeps, at: Mask) -> tuple[Array, Array, Complex, float]:
    """Return the columns 1, f and |V|², scaled, the weights, drive/V and the centre of f."""
    f, v, drive = sweeps.frequency[at], sweeps.voltage[at], sweeps.drive[at]
    size, centre = np.abs(v), float(np.mean(f))
    basis = np.column_stack([np.ones(len(f)), (f - centre) / sweeps.span, size**2 / np.max(size**2)])
    inverse: Complex = drive / np.where(size > 0, v, 1.0)
    weight: Array = size**2 / drive / np.max(size)
    return basis, weight, inverse, centre


def _from_complex(sweeps: Sweeps, at: Mask, delay: float) -> list[Start]:
    """Fit drive/V = p₀ + p₁ f + p₂ |V|² and read f₀, w, α_y/α_c, d, gain and delay from it."""
    basis, weight, inverse, centre = _linear_form(sweeps, at)
    turned = inverse * np.exp(-2j * np.pi * (sweeps.frequency[at] - centre) * delay)
    p = np.linalg.lstsq(basis * weight[:, None], turned * weight, rcond=None)[0]
    p[1] /= sweeps.span
    p[2] /= np.max(np.abs(sweeps.voltage[at])) ** 2
    resonance = -p[0] / p[1]
    w = 2 * abs(resonance.imag)
    gain = -2 / (w * p[1])
    stiff = -2 / w * p[2] / p[1] * abs(gain) ** 2
    f0 = centre + resonance.real
    return [(f0, w, stiff.real / STIFFEN, stiff.imag, gain * np.exp(2j * np.pi * (centre - f0) * delay), delay)]


def _from_backbone(sweeps: Sweeps, at: Mask, delay: float) -> list[Start]:
    """Straighten the backbone by each slope β, g = f − β|V|², and fit the line drive = V (p₀ + p₁ g)."""
    kept = _thin(at)
    f, drive = sweeps.frequency[kept], sweeps.drive[kept]
    centre, peak = float(np.mean(f)), float(np.max(np.abs(sweeps.voltage[kept])))
    v = sweeps.voltage[kept] * np.exp(2j * np.pi * (f - centre) * delay) / peak
    slopes, square = SLOPES[:, None] * sweeps.span, np.abs(v) ** 2
    g = (f - centre) - slopes * square
    unit = np.ones_like(g)
    columns = np.stack([v * unit, 1j * v * unit, v * g, 1j * v * g, drive * unit], axis=-1)
    columns = columns * np.exp(-1j * np.angle(v))[:, None]
    line: Complex = drive / np.where(square > 0, v, 1.0) * unit
    along = line
    for _round in range(ROUNDS):
        rows = whiten(columns, line, along)
        p, misfit = _least_squares(rows[..., :4], rows[..., 4], np.ones(rows.shape[1]))
        first, second = p[0] + 1j * p[1], p[2] + 1j * p[3]
        line = first[:, None] + second[:, None] * g
        along = line - 2 * slopes * square * second[:, None]
    resonance = -first / second
    out = []
    for k in np.argsort(np.where(resonance.imag > 0, misfit, np.inf))[:TRIED]:
        if resonance[k].imag > 0:
            w, f0 = 2 * resonance[k].imag, centre + resonance[k].real
            gain = -2 / (w * second[k])
            ratio = 2 * float(slopes[k, 0]) * abs(gain) ** 2 / (w * STIFFEN)
            out.append((f0, w, ratio, 0.0, peak * gain * np.exp(2j * np.pi * (centre - f0) * delay), delay))
    return out


def _from_magnitude(sweeps: Sweeps, at: Mask) -> list[Start]:
    """Straighten the backbone by each slope β, g = f − β|V|², and fit the Lorentzian |V|² g² = C² drive² + 2 f₀ |V|² g − K |V|²."""
    kept = _thin(at)
    f, v, drive = sweeps.frequency[kept], np.abs(sweeps.voltage[kept]), sweeps.drive[kept]
    centre, peak = float(np.mean(f)), float(np.max(v))
    square = np.maximum(v**2 - 2 * sweeps.noise**2, 0.0) / peak**2
    slopes = SLOPES[:, None] * sweeps.span
    g = (f - centre) - slopes * square
    columns = np.stack([np.broadcast_to(drive**2, g.shape), 2 * square * g, np.broadcast_to(-square, g.shape)], axis=-1)
    slope = np.broadcast_to(drive**2 / np.maximum(square, 1e-12), g.shape)
    for _round in range(ROUNDS):
        # A noise n in |V| enters as 2 n |V| times the slope of the equation by |V|², which vanishes at a fold.
        weight = 1 / (np.sqrt(np.maximum(square, (sweeps.noise / peak) ** 2)) * slope)
        (force, f0, constant), misfit = _least_squares(columns, square * g**2, weight)
        away, half2 = g - f0[:, None], np.maximum(constant - f0**2, 1e-12 * sweeps.span**2)[:, None]
        lorentz = away**2 + half2
        slope = np.hypot(lorentz - 2 * slopes * square * away, FOLD * lorentz)
    score = np.where((force > 0) & (constant > f0**2), misfit, np.inf)
    out = []
    for k in np.argsort(score)[:TRIED]:
        if np.isfinite(score[k]):
            w = 2 * np.sqrt(constant[k] - f0[k] ** 2)
            size = 2 * np.sqrt(force[k]) / w
            ratio = float(slopes[k, 0]) * size**2 * 2 / (w * STIFFEN)
            out.append((centre + f0[k], w, ratio, 0.0, complex(size * peak), 0.0))
    return out


def _from_phase(sweeps: Sweeps, at: Mask) -> list[Start]:
    """Fit f = f₀ − (w/2)(cot ψ − a sin² ψ), ψ = −arg b, which is linear and does not see π, for each phase and delay tried."""
    kept = _thin(at)
    f, v, drive, span = sweeps.frequency[kept], sweeps.voltage[kept], sweeps.drive[kept], sweeps.span
    centre, size = float(np.mean(f)), _certainty(sweeps, kept)
    offset, tau = (grid.ravel() for grid in np.meshgrid(PHASES, DELAYS / 2 / span))
    psi = offset[:, None] - 2 * np.pi * np.outer(tau, f - centre) - np.angle(v)
    sine, cosine = np.sin(psi), np.cos(psi)
    columns = np.stack([sine**2, -sine * cosine, sine**4 * drive**2], axis=-1)
    slope = np.ones_like(psi)
    for _round in range(ROUNDS):
        (f0, half, stiff), misfit = _least_squares(columns, sine**2 * ((f - centre) / span), size / slope)
        # A noise n in the phase enters as n (w/2) (1 + 2 a sin³ψ cos ψ), whose last factor vanishes at a fold.
        half = np.where(half > 0, half, np.inf)
        slope = np.hypot(1 + 2 * (stiff / half)[:, None] * drive**2 * sine**3 * cosine, FOLD)
    score = np.where(np.isfinite(half), misfit / half**2, np.inf).reshape(len(DELAYS), len(PHASES))
    best = np.argmin(score, axis=1) + np.arange(len(DELAYS)) * len(PHASES)
    out = []
    for k in best[np.argsort(score.ravel()[best])][: 2 * TRIED]:
        if not np.isfinite(score.ravel()[k]):
            continue
        coarse = np.array([f0[k], np.log(half[k]), stiff[k] / half[k], offset[k], tau[k] * span])
        fine, turn = _refine_phase(sweeps, kept, centre, coarse)
        resonance, delay = centre + fine[0] * span, fine[4] / span
        gain = np.exp(1j * (fine[3] + turn + 2 * np.pi * (centre - resonance) * delay))
        out.append((resonance, 2 * np.exp(fine[1]) * span, fine[2] / STIFFEN, 0.0, complex(gain), delay))
    return out


def _refine_phase(sweeps: Sweeps, kept: Index, centre: float, start: Array) -> tuple[Array, float]:
    """Refine (f₀, ln w/2, a, φ, τ), frequencies over the span, on the same equation; return also the half turn of φ."""
    f, v, drive = (sweeps.frequency[kept] - centre) / sweeps.span, sweeps.voltage[kept], sweeps.drive[kept]
    weight = _certainty(sweeps, kept)

    def angle(p: Array) -> Array:
        return np.asarray(p[3] - 2 * np.pi * p[4] * f - np.angle(v))

    def residual(p: Array) -> Array:
        sine, cosine, a = np.sin(angle(p)), np.cos(angle(p)), p[2] * drive**2
        slope = np.hypot(1 + 2 * a * sine**3 * cosine, FOLD)
        return np.asarray((sine**2 * (f - p[0]) * np.exp(-p[1]) + sine * cosine - a * sine**4) / slope * weight)

    found = least_squares(residual, start, method="lm", x_scale="jac", max_nfev=MAX_CALLS).x
    # b has arg −ψ with ψ in (0, π); the other half turn belongs to φ.
    return found, np.pi if np.sum(weight * np.sin(angle(found))) < 0 else 0.0


def _certainty(sweeps: Sweeps, kept: Index) -> Array:
    """Return the weight of each phase: 1/σ, less for weak points, whose noise the equation's sin⁴ψ would rectify."""
    ratio = np.abs(sweeps.voltage[kept]) / sweeps.noise
    return np.asarray(ratio * np.minimum(1.0, (ratio / STRONG) ** 2))


def _thin(at: Mask) -> Index:
    """Return at most THINNED of the points marked, evenly."""
    points = np.flatnonzero(at)
    return points[np.unique(np.linspace(0, len(points) - 1, min(len(points), THINNED)).astype(np.intp))]


def _least_squares(columns: Array, target: Array, weight: Array) -> tuple[Array, Array]:
    """Solve many small weighted problems, columns (s, p, k), by their normal equations; return (k, s) and the misfits (s,)."""
    weighted, aim = columns * weight[..., None], target * weight
    scale = np.linalg.norm(weighted, axis=1) + np.finfo(float).tiny
    weighted = weighted / scale[:, None]
    normal = weighted.swapaxes(1, 2) @ weighted + 1e-13 * np.eye(weighted.shape[2])
    solution = np.linalg.solve(normal, weighted.swapaxes(1, 2) @ aim[..., None])
    misfit = np.sum((aim - (weighted @ solution)[..., 0]) ** 2, axis=1)
    return (solution[..., 0] / scale).T, misfit
