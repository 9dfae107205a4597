"""Where lines are: matched filters of all widths over a sweep, blind to a smooth background."""

import numpy as np
from numpy.typing import NDArray

from femnl.fits.spectrum.lines import Array, Complex

_HALF = 6.0  # half width of a filter's window in linewidths
_FIRST = 1.5  # spacings of points, the width of the narrowest filter
_RATIO = 1.6  # between neighbouring filter widths
_CHUNK = 2_000_000
WIDEST = 0.025  # of the sweep; a wider line is indistinguishable from background


def scan(f: Array, volts: Complex, noise: float, widest: float) -> tuple[Array, Array, Array]:
    """Score a Lorentzian of every width at every place by the fall of χ² that it buys.

    A quadratic background is free.

    score = |⟨t, v⟩|²/(σ²⟨t, t⟩), t the line with the polynomials of second degree projected out of
    its window; χ² with two degrees of freedom on noise alone.
    Args: f [Hz], rising, (n,); volts [V] (n,); noise σ [V] per quadrature; widest: linewidth [Hz]
    to stop at.
    Returns: score, centre [Hz] and linewidth [Hz] of all filters, flat.
    """
    spacing = np.gradient(f)
    scores: list[Array] = []
    centres: list[Array] = []
    widths: list[Array] = []
    width = _FIRST
    typical = float(np.median(spacing))
    while width == _FIRST or (width * typical < widest and width * _HALF < f.size):
        half = max(5, round(_HALF * width))
        places = np.arange(0, f.size, max(1, round(width / 3)))
        for part in np.array_split(places, max(1, places.size * (2 * half + 1) // _CHUNK)):
            scores.append(_score(f, volts, noise, part, half, width * spacing[part]))
            centres.append(f[part])
            widths.append(width * spacing[part])
        width *= _RATIO
    return np.concatenate(scores), np.concatenate(centres), np.concatenate(widths)


def _score(
    f: Array, volts: Complex, noise: float, places: NDArray[np.intp], half: int, width: Array
) -> Array:
    """Return the score of a line at each of the places (c,), as `scan` defines it.

    Args: places: points at which the lines are centred. half: points on each side of a window.
        width (c,): linewidths [Hz].
    """
    index = places[:, None] + np.arange(-half, half + 1)
    inside = (index >= 0) & (index < f.size)
    index = np.clip(index, 0, f.size - 1)
    offset = f[index] - f[places, None]
    x = offset / (half * width / _HALF)[:, None]
    template = np.where(inside, 1 / (1 + 2j * offset / width[:, None]), 0)
    values = np.where(inside, volts[index], 0)
    basis = np.stack([inside.astype(float), inside * x, inside * x**2], axis=1)
    gram = np.einsum("cik,cjk->cij", basis, basis)
    along = np.einsum("cik,ck->ci", basis, template)
    background = np.linalg.solve(gram, along[..., None])[..., 0]
    pure = template - np.einsum("cik,ci->ck", basis, background)
    power = np.sum(np.abs(pure) ** 2, axis=1)
    overlap = np.abs(np.sum(pure.conj() * values, axis=1)) ** 2
    return np.asarray(np.where(power > 1e-3, overlap / (noise**2 * np.maximum(power, 1e-300)), 0.0))
