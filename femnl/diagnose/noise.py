"""What residuals say of their noise: glitches, a wrong standard deviation, correlation.

All of it is read where a misfit shows least: in differences from neighbours, and in the quietest
stretches of the data.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc

from femnl.core.readout import Array
from femnl.core.robust import MAD
from femnl.diagnose.noise_level import CLEAR, MEDIAN_VARIANCE, noise_level
from femnl.fits.outliers import MOST_GLITCHES, outlier_limit
from femnl.observe.noisy import FoundNoise
from femnl.observe.residuals import Layout

COINCIDENCE = 0.01
"""Probability of as many pairs of glitches at one condition, below which they are no glitches."""
ALIKE = np.radians(12)
"""Angle between the deviations of a pair, or their opposites, up to which they are of one phase."""
SIZES = 10.0
"""Factor within which their sizes are: a datum beside a large glitch may stand out a little."""


def found_noise(
    residuals: Array,
    layout: Layout,
    known: FoundNoise,
    *,
    bare: bool = False,
    last: bool = False,
) -> FoundNoise:
    """Return the noise that the residuals of a fitted model show.

    Args: residuals (n,): in stated σ, of all data. layout: their neighbours. known: what was found
    before; its glitches stay. bare: whether the model leaves hardly more than noise, so that small
    differences count too. last: whether causes have been sought, so that a datum which stands out
    from the noise of all is left to none of them: a detector that clips a little leaves one, too.
    Valid: noise that is the same all over the data, but for glitches.
    """
    dropped = np.zeros(len(residuals), dtype=bool)
    dropped[list(known.glitches)] = True
    # In the quieter half of the data few glitches count as noise
    factor, _ = noise_level(residuals, layout, dropped, bare=False)
    dropped |= _glitches(residuals, layout, dropped, factor)
    level = noise_level(residuals, layout, dropped, bare)
    if last:
        lone = _lone(residuals, layout, dropped, *level)
        if lone.any():
            dropped |= lone
            level = noise_level(residuals, layout, dropped, bare)
    return FoundNoise(tuple(int(i) for i in np.flatnonzero(dropped)), *level)


def standing_out(residuals: Array, layout: Layout) -> FoundNoise:
    """Return all that stands out from what is around it, as if it were glitches.

    What recurs under the same conditions too: a few large glitches move a fit, and then much of the
    data near a resonance seems to recur.

    Args: residuals (n,): in stated σ. layout: their neighbours.
    """
    dropped = np.zeros(len(residuals), dtype=bool)
    factor, _ = noise_level(residuals, layout, dropped, bare=False)
    datum = _outlying(residuals, layout, dropped, factor)
    return FoundNoise(tuple(int(i) for i in np.flatnonzero(_of(datum, layout))))


def _glitches(
    residuals: Array, layout: Layout, dropped: NDArray[np.bool_], factor: float
) -> NDArray[np.bool_]:
    """Return which residuals (n,) stand out from those around them by more than chance allows.

    The unit is the local scatter, which is at least the noise. What stands out at the same
    conditions in several lines is no glitch. Where more than `MOST_GLITCHES` of the data stand out,
    none is a glitch.
    """
    datum = _outlying(residuals, layout, dropped, factor)
    beside = residuals - _around(residuals, layout, dropped)[0]
    found = _of(np.setdiff1d(datum, _recurring(layout, datum, beside)), layout)
    count = int(np.sum(layout.datum >= 0))
    few = np.sum(found | dropped) <= MOST_GLITCHES * count
    return found if few else np.zeros(len(residuals), dtype=bool)


def _lone(
    residuals: Array,
    layout: Layout,
    dropped: NDArray[np.bool_],
    factor: float,
    correlation: float,
) -> NDArray[np.bool_]:
    """Return the residuals (n,) of one datum that stands out from noise, which is all else.

    The scatter around a datum is known from few others, so that a glitch may be no more than they
    make by chance, and still be too much for the noise of all. There is none where the others are
    more than noise, as then a model misses the data, or where two stand out, or neighbours do.
    """
    if layout.shuffled:  # what a model misses of a datum is nowhere near it either
        return np.zeros(len(residuals), dtype=bool)
    known = ~dropped & (layout.datum >= 0)
    away = np.where(known, np.abs(residuals) / factor, 0.0)
    datum = np.unique(layout.datum[away > outlier_limit(away[known])])
    if len(datum) != 1:
        return np.zeros(len(residuals), dtype=bool)
    found = _of(datum, layout) & known
    beside = layout.near[found]
    if np.any(dropped[beside[beside >= 0]]):
        return np.zeros(len(residuals), dtype=bool)
    others = known & ~found
    count = int(others.sum())
    spread = float(np.sqrt(2 * count * (1 + correlation**2) / (1 - correlation**2)))
    noise = float(np.sum(away[others] ** 2)) <= count + CLEAR * spread
    return found if noise else np.zeros(len(residuals), dtype=bool)


def _outlying(
    residuals: Array, layout: Layout, dropped: NDArray[np.bool_], factor: float
) -> NDArray[np.int64]:
    """Return the data that stand out from those around them by more than chance allows."""
    middle, scatter = _around(residuals, layout, dropped)
    known = np.maximum(np.sum(layout.near >= 0, axis=1), 1)
    away = np.abs(residuals - middle) / np.maximum(scatter, factor)
    away /= np.sqrt(1 + MEDIAN_VARIANCE / known)
    away[dropped | (layout.datum < 0)] = 0.0
    limit = outlier_limit(away[layout.datum >= 0])
    return np.unique(layout.datum[away > limit])


def _of(datum: NDArray[np.int64], layout: Layout) -> NDArray[np.bool_]:
    """Return which residuals (n,) are of some data."""
    return np.isin(layout.datum, datum) & (layout.datum >= 0)


def _around(residuals: Array, layout: Layout, dropped: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return median and scatter (n,) of the residuals around each, 0 and ∞ where there are few."""
    present = (layout.near >= 0) & ~dropped[layout.near]
    values = np.where(present, residuals[layout.near], np.nan)
    middle = _median(values, present)
    scatter = MAD * _median(np.abs(values - middle[:, None]), present)
    few = present.sum(axis=1) < 4
    return np.where(few, 0.0, middle), np.where(few, np.inf, scatter)


def _median(values: Array, present: NDArray[np.bool_]) -> Array:
    """Return the median of each row (n, k), of what is present; 0 where nothing is."""
    count = present.sum(axis=1)
    ordered = np.sort(values, axis=1)  # what is missing comes last
    row = np.arange(len(values))
    low = ordered[row, np.maximum((count - 1) // 2, 0)]
    high = ordered[row, np.minimum(count // 2, values.shape[1] - 1)]
    return np.where(count > 0, (low + high) / 2, 0.0)


def _recurring(layout: Layout, datum: NDArray[np.int64], beside: Array) -> NDArray[np.int64]:
    """Return those data that others, of the same or the next conditions, deviate along with.

    What a model lacks at a condition has one phase in all lines, or the opposite one, and sizes of
    one order; those of glitches are random. There are none where chance brings as many together.

    Args: beside (n,): residuals less the median of those around each.
    """
    conditions = int(layout.repeated.max(initial=-1)) + 1
    if not conditions or not len(datum):
        return np.empty(0, np.int64)
    condition = np.full(int(layout.datum.max()) + 1, -1)
    condition[layout.datum[layout.datum >= 0]] = layout.repeated[layout.datum >= 0]
    mine = condition[datum]
    away = np.array([beside[layout.datum == d] for d in datum])
    size = np.linalg.norm(away, axis=1, keepdims=True)
    away /= size
    alike = (np.abs(away @ away.T) >= np.cos(ALIKE)) & (size <= SIZES * size.T)
    alike &= alike.T
    by_phase = 2 * ALIKE / np.pi if away.shape[1] == 2 else 1.0
    apart = np.abs(mine[:, None] - mine[None, :])
    placed = mine >= 0
    together = (apart <= 1) & placed[:, None] & placed[None, :] & alike
    np.fill_diagonal(together, False)
    pairs = int(together.sum()) // 2
    by_chance = placed.sum() * (placed.sum() - 1) / 2 * 3 / conditions * by_phase
    # Of a Poisson distribution with that mean, the probability of at least so many
    if pairs == 0 or gammainc(pairs, by_chance) > COINCIDENCE:
        return np.empty(0, np.int64)
    recurring: NDArray[np.int64] = datum[together.any(axis=1)]
    return recurring
