"""Start values of a response fit from linear least squares.

No guess, no tuning, and no branch to choose.

1/y is linear in 1, f and |y|², whatever branch a point lies on:  drive/V = [2(f₀ − f)/w + i + (a +
i d) |V/y_max|²] / (y_max e^{iφ}).
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from femnl.core.choices import Use
from femnl.fits.response.search import (
    DELAYS,
    Mask,
    Start,
    search_backbone,
    search_grid,
    search_magnitude,
    search_phase,
)
from femnl.observe.response.branches import STIFFEN
from femnl.observe.response.sweeps import Array, Complex, Sweeps
from femnl.observe.response.theta import Layout

# Peak over noise below which linear forms, which take the data for exact, come last.
CLEAR = 15.0


def starts(sweeps: Sweeps, use: Use, layout: Layout) -> Iterator[Array]:
    """Yield start vectors θ, the most promising first.

    Each start is found from one position's own data and completed by those of the others.

    The linear form of complex data comes first, because it takes no search; where noise spoils it,
    backbones are scanned.
    """
    if use == "complex":
        delay = _delay(sweeps)
        searches: list[Callable[[Sweeps, Mask], list[Start]]] = [
            partial(_from_complex, delay=delay),
            partial(search_backbone, delay=delay),
            partial(search_grid, delay=delay),
            partial(search_grid, delay=0.0),
        ]
        if np.max(np.abs(sweeps.voltage)) < CLEAR * sweeps.noise:
            searches.reverse()
    else:
        searches = [search_magnitude if use == "magnitude" else search_phase]
    strength = [
        np.sum(np.abs(sweeps.voltage[sweeps.position == p]) ** 2) for p in range(sweeps.n_positions)
    ]
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
                    theta[layout.delay] = tau * layout.span
                yield theta


def _delay(sweeps: Sweeps) -> float:
    """Return the delay [s] at which the linear form fits best over all positions.

    One projection serves all delays.
    """
    tau = DELAYS / sweeps.span
    misfit = np.zeros(len(tau))
    for p in range(sweeps.n_positions):
        at = sweeps.position == p
        basis, weight, inverse, centre = _linear_form(sweeps, at)
        q, _ = np.linalg.qr(basis * weight[:, None])
        turned = (weight * inverse)[:, None] * np.exp(
            -2j * np.pi * np.outer(sweeps.frequency[at] - centre, tau)
        )
        misfit += np.sum(np.abs(turned) ** 2, axis=0) - np.sum(np.abs(q.T @ turned) ** 2, axis=0)
    return float(tau[np.argmin(misfit)])


def likely_sign(sweeps: Sweeps) -> int:
    """Return the sign of the phase that the linear form of complex data finds in most sweeps.

    The pole f₀ + i w/2 = −p₀/p₁ lies in the upper half plane for exp(+iωt), in the lower one for
    exp(−iωt), whatever the stiffening; a background may turn it. Sweeps are asked one by one, as
    the mode may drift from one to the next.
    """
    total = 0.0
    for k in np.unique(sweeps.sweep):
        basis, weight, inverse, _ = _linear_form(sweeps, sweeps.sweep == k)
        found = np.linalg.lstsq(basis * weight[:, None], inverse * weight, rcond=None)[0]
        total += float(np.sign((-found[0] / found[1]).imag))
    return -1 if total < 0 else 1


def _linear_form(sweeps: Sweeps, at: Mask) -> tuple[Array, Array, Complex, float]:
    """Return what the linear form drive/V = p₀ + p₁ f + p₂ |V|² of a response is fitted by.

    Returns: the columns 1, f and |V|², the last two from the centre of f and scaled to about 1; the
    weight of each point; drive/V; and the centre of f [Hz].
    """
    f = sweeps.frequency[at]
    v = sweeps.voltage[at]
    drive = sweeps.drive[at]
    size = np.abs(v)
    centre = float(np.mean(f))
    basis = np.column_stack(
        [np.ones(len(f)), (f - centre) / sweeps.span, size**2 / np.max(size**2)]
    )
    inverse = (drive / np.where(size > 0, v, 1.0)).astype(complex)
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
    return [
        (
            f0,
            w,
            stiff.real / STIFFEN,
            stiff.imag,
            gain * np.exp(2j * np.pi * (centre - f0) * delay),
            delay,
        )
    ]
