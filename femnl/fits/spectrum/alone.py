"""One line alone in a sweep, however many linewidths that spans."""

import numpy as np

from femnl.fits.response.linear import single_starts
from femnl.fits.spectrum.lines import Array, Cluster, Complex, fit_cluster, polynomials

NARROWEST = 1e-3
"""Spacings of points, the narrowest line that a fit may try."""
WHOLE = 0.5
"""Of the span, the widest line that may stand alone in it."""
FALSE = 1e-3
"""Probability that noise alone gives one line in the whole sweep."""


def threshold(n_points: int) -> float:
    """Return the score that noise alone exceeds once in a thousand sweeps.

    −2 ln(10⁻³/n), n counting places and widths.
    """
    return float(-2 * np.log(FALSE / (4 * n_points)))


def one_line(f: Array, volts: Complex, noise: float) -> Cluster | None:
    """Return one line over the whole span on a quadratic background, None where none stands out.

    It is a line, and no bend of the background, if it is narrower than half of the span, lies
    within it, and buys more than noise of the size of what it leaves could.
    """
    span = float(f[-1] - f[0])
    window = (float(f[0]), float(f[-1]))
    tried = [
        fit_cluster(f, volts, noise, np.array([start]), window, (NARROWEST * span / f.size, span))
        for start in single_starts(f, volts)
    ]
    if not tried:
        return None
    best = min(tried, key=lambda one: one.chi2)
    basis = polynomials(f, window).astype(complex)
    left = volts - basis @ np.linalg.lstsq(basis, volts, rcond=None)[0]
    gain = float(np.sum(np.abs(left) ** 2) / noise**2) - best.chi2
    scale = max(best.chi2 / best.n_points, 1.0)
    inside = window[0] < best.frequency[0] < window[1] and best.linewidth[0] < WHOLE * span
    return best if inside and gain / scale > threshold(f.size) else None


def is_met(one: Cluster, limit: float) -> bool:
    """Whether a line and its background leave only noise."""
    return bool(one.chi2 < one.n_points + limit + 4 * np.sqrt(2 * one.n_points))
