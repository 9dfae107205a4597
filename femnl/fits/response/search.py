"""Start values of a response fit by searching one or two parameters.

Each trial is linear in the others.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from femnl.fits.response.implicit import FOLD, whiten
from femnl.observe.response.branches import STIFFEN
from femnl.observe.response.sweeps import Array, Complex, Index, Sweeps
from femnl.resonator import duffing_roots

# Delays tried, in units of 1/span.
DELAYS = np.linspace(-2, 2, 33)
# Backbone slopes tried for magnitudes, as the shift of the strongest point over the span.
SLOPES = np.concatenate([[0.0], *(sign * np.geomspace(1e-3, 1.5, 60) for sign in (1, -1))])
# Widths over the span and α_y/α_c tried where whole responses are compared on COARSE points.
WIDTHS = np.geomspace(0.003, 0.5, 10)
COARSE = 100
RATIOS = np.array([0.0, *(sign * r for r in (0.5, 1.5, 4.0, 12.0, 40.0) for sign in (1, -1))])
PHASES = np.arange(48) * (np.pi / 48)
# Points used, rounds of weighting and starts handed on, where a start is searched on a grid.
THINNED = 240
ROUNDS = 4
TRIED = 4
MAX_CALLS = 300
# Signal to noise from which a phase is taken at its full weight.
STRONG = 30.0
Mask = NDArray[np.bool_]
# f₀ [Hz], w [Hz], α_y/α_c, d, complex gain [V] and delay [s].
Start = tuple[float, float, float, float, complex, float]


def search_backbone(sweeps: Sweeps, at: Mask, delay: float) -> list[Start]:
    """Straighten the backbone by each of a grid of slopes β, and fit a line to the result.

    With g = f − β|V|², the response obeys drive = V (p₀ + p₁ g).
    """
    kept = _thin(at)
    f = sweeps.frequency[kept]
    drive = sweeps.drive[kept]
    centre = float(np.mean(f))
    peak = float(np.max(np.abs(sweeps.voltage[kept])))
    v = sweeps.voltage[kept] * np.exp(2j * np.pi * (f - centre) * delay) / peak
    slopes = SLOPES[:, None] * sweeps.span
    square = np.abs(v) ** 2
    g = (f - centre) - slopes * square
    unit = np.ones_like(g)
    # V p₀ and V p₁ g for the real and the imaginary parts of p₀ and p₁, then the drive; turned so
    # that V is real.
    columns = np.stack([v * unit, 1j * v * unit, v * g, 1j * v * g, drive * unit], axis=-1)
    columns = columns * np.exp(-1j * np.angle(v))[:, None]
    line: Complex = drive / np.maximum(np.abs(v), 3 * sweeps.noise / peak) * unit
    along = line
    for _round in range(ROUNDS):
        rows = whiten(columns, line, along)
        p, misfit = _least_squares(rows[..., :4], rows[..., 4], np.ones(rows.shape[1]))
        p0 = p[0] + 1j * p[1]
        p1 = p[2] + 1j * p[3]
        line = p0[:, None] + p1[:, None] * g
        along = line - 2 * slopes * square * p1[:, None]
    # The line is zero at f₀ − centre + i w/2
    resonance = -p0 / p1
    out = []
    for k in np.argsort(np.where(resonance.imag > 0, misfit, np.inf))[:TRIED]:
        if resonance[k].imag > 0:
            w = 2 * resonance[k].imag
            f0 = centre + resonance[k].real
            gain = -2 / (w * p1[k])
            ratio = 2 * float(slopes[k, 0]) * abs(gain) ** 2 / (w * STIFFEN)
            undelayed = peak * gain * np.exp(2j * np.pi * (centre - f0) * delay)
            out.append((f0, w, ratio, 0.0, undelayed, delay))
    return out


def search_grid(sweeps: Sweeps, at: Mask, delay: float) -> list[Start]:
    """Try whole responses over a grid of f₀, w and α_y/α_c; the gain follows by projection.

    It is slow, but noise hardly disturbs it.
    """
    kept = _thin(at, COARSE)
    f = sweeps.frequency[kept]
    drive = sweeps.drive[kept]
    v = sweeps.voltage[kept]
    centre = float(np.mean(f))
    direction = np.array(sweeps.direction)[sweeps.sweep[kept]]
    v = v * np.exp(2j * np.pi * (f - centre) * delay)
    f0, w, ratio = (
        grid.ravel()[:, None]
        for grid in np.meshgrid(np.linspace(f.min(), f.max(), 40), sweeps.span * WIDTHS, RATIOS)
    )
    delta = 2 * (f0 - f) / w
    a = STIFFEN * ratio * drive**2
    roots = duffing_roots(delta, a)
    x = np.where(np.isfinite(roots[2]) & (direction * a >= 0), roots[2], roots[0])
    model = drive / (delta + a * x + 1j)
    overlap = np.sum(model.conj() * v, axis=1)
    power = np.sum(np.abs(model) ** 2, axis=1)
    best = np.argsort(-(np.abs(overlap) ** 2) / power)[:TRIED]
    gain = overlap[best] / power[best] * np.exp(2j * np.pi * (centre - f0[best, 0]) * delay)
    return [
        (f0[k, 0], w[k, 0], ratio[k, 0], 0.0, complex(g), delay)
        for k, g in zip(best, gain, strict=True)
    ]


def search_magnitude(sweeps: Sweeps, at: Mask) -> list[Start]:
    """Straighten the backbone by each of a grid of slopes β, and fit a Lorentzian.

    With g = f − β|V|², the magnitude obeys |V|² g² = C² drive² + 2 f₀ |V|² g − K |V|².
    """
    kept = _thin(at)
    f = sweeps.frequency[kept]
    v = np.abs(sweeps.voltage[kept])
    drive = sweeps.drive[kept]
    centre = float(np.mean(f))
    peak = float(np.max(v))
    square = np.maximum(v**2 - 2 * sweeps.noise**2, 0.0) / peak**2
    slopes = SLOPES[:, None] * sweeps.span
    g = (f - centre) - slopes * square
    columns = np.stack(
        [np.broadcast_to(drive**2, g.shape), 2 * square * g, np.broadcast_to(-square, g.shape)],
        axis=-1,
    )
    slope = np.broadcast_to(drive**2 / np.maximum(square, 1e-12), g.shape)
    for _round in range(ROUNDS):
        # A noise n in |V| enters as 2 n |V| times the slope of the equation by |V|², which vanishes
        # at a fold.
        weight = 1 / (np.sqrt(np.maximum(square, (sweeps.noise / peak) ** 2)) * slope)
        (force, f0, constant), misfit = _least_squares(columns, square * g**2, weight)
        away = g - f0[:, None]
        half2 = np.maximum(constant - f0**2, 1e-12 * sweeps.span**2)[:, None]
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


def search_phase(sweeps: Sweeps, at: Mask) -> list[Start]:
    """Fit f = f₀ − (w/2)(cot ψ − a sin² ψ), ψ = −arg b, for each phase and delay tried.

    It is linear and blind to π.
    """
    kept = _thin(at)
    f = sweeps.frequency[kept]
    v = sweeps.voltage[kept]
    drive = sweeps.drive[kept]
    span = sweeps.span
    centre = float(np.mean(f))
    size = _certainty(sweeps, kept)
    offset, tau = (grid.ravel() for grid in np.meshgrid(PHASES, DELAYS / 2 / span))
    psi = offset[:, None] - 2 * np.pi * np.outer(tau, f - centre) - np.angle(v)
    sine = np.sin(psi)
    cosine = np.cos(psi)
    columns = np.stack([sine**2, -sine * cosine, sine**4 * drive**2], axis=-1)
    slope = np.ones_like(psi)
    for _round in range(ROUNDS):
        (f0, half, stiff), misfit = _least_squares(
            columns, sine**2 * ((f - centre) / span), size / slope
        )
        # A noise n in the phase enters as n (w/2) (1 + 2 a sin³ψ cos ψ), whose last factor vanishes
        # at a fold.
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
        resonance = centre + fine[0] * span
        delay = fine[4] / span
        gain = np.exp(1j * (fine[3] + turn + 2 * np.pi * (centre - resonance) * delay))
        out.append(
            (resonance, 2 * np.exp(fine[1]) * span, fine[2] / STIFFEN, 0.0, complex(gain), delay)
        )
    return out


def _refine_phase(sweeps: Sweeps, kept: Index, centre: float, start: Array) -> tuple[Array, float]:
    """Refine (f₀, ln w/2, a, φ, τ), frequencies over the span, on the same equation.

    Return also the half turn of φ.
    """
    f = (sweeps.frequency[kept] - centre) / sweeps.span
    v = sweeps.voltage[kept]
    drive = sweeps.drive[kept]
    weight = _certainty(sweeps, kept)

    def angle(p: Array) -> Array:
        return np.asarray(p[3] - 2 * np.pi * p[4] * f - np.angle(v))

    def residual(p: Array) -> Array:
        sine = np.sin(angle(p))
        cosine = np.cos(angle(p))
        a = p[2] * drive**2
        slope = np.hypot(1 + 2 * a * sine**3 * cosine, FOLD)
        return np.asarray(
            (sine**2 * (f - p[0]) * np.exp(-p[1]) + sine * cosine - a * sine**4) / slope * weight
        )

    found = least_squares(residual, start, method="lm", x_scale="jac", max_nfev=MAX_CALLS).x
    # b has arg −ψ with ψ in (0, π); the other half turn belongs to φ.
    return found, np.pi if np.sum(weight * np.sin(angle(found))) < 0 else 0.0


def _certainty(sweeps: Sweeps, kept: Index) -> Array:
    """Return the weight of each phase.

    1/σ, less for weak points, whose noise the equation's sin⁴ψ would rectify.
    """
    ratio = np.abs(sweeps.voltage[kept]) / sweeps.noise
    return np.asarray(ratio * np.minimum(1.0, (ratio / STRONG) ** 2))


def _thin(at: Mask, count: int = THINNED) -> Index:
    """Return at most `count` of the points marked, evenly."""
    points = np.flatnonzero(at)
    return points[
        np.unique(np.linspace(0, len(points) - 1, min(len(points), count)).astype(np.intp))
    ]


def _least_squares(columns: Array, target: Array, weight: Array) -> tuple[Array, Array]:
    """Solve many small weighted problems, columns (s, p, k), by their normal equations.

    return (k, s) and the misfits (s,).
    """
    weighted = columns * weight[..., None]
    aim = target * weight
    scale = np.linalg.norm(weighted, axis=1) + np.finfo(float).tiny
    weighted = weighted / scale[:, None]
    normal = weighted.swapaxes(1, 2) @ weighted + 1e-13 * np.eye(weighted.shape[2])
    solution = np.linalg.solve(normal, weighted.swapaxes(1, 2) @ aim[..., None])
    misfit = np.sum((aim - (weighted @ solution)[..., 0]) ** 2, axis=1)
    return (solution[..., 0] / scale).T, misfit
