"""How large noise is, and how neighbours correlate in it.

Both are read where a misfit shows least: in the quietest stretches of the data.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, gammaln

from femnl.core.readout import Array
from femnl.core.robust import MAD
from femnl.observe.residuals import Layout

STRETCH = 24
"""Residuals in a row that are looked at together."""
CUBIC = 4
"""Terms of the polynomial that is taken off each stretch."""
FEWEST = 24
"""Stretches below which nothing is said of the noise."""
QUIET = 0.5
"""Part of the stretches that is the quietest: a misfit is weaker there than elsewhere."""
NEARLY_ALL = 0.9
"""The same where a model takes up nearly all of the deviation."""
CLEAR = 4.0
"""Standard errors by which a factor must differ from 1, and a correlation from 0."""
ALIKE = 2.5
"""Standard errors by which the correlation of few neighbours must differ from 0: chance alone makes
as much in one file of 160."""
LEAST_FACTOR = 0.06
"""The least difference of a factor from 1, and of a correlation from 0, that are told beside a
misfit.
"""
LEAST_CORRELATION = 0.12
FAR_OUT = 5.0
"""σ by which a residual stands out that says nothing of the noise of all."""
DRAWN = 20000
"""Stretches of noise that tell what the quietest ones show."""
MEDIAN_VARIANCE = 1.57
"""Variance of a median of many, in those of their mean: π/2."""
RHO = np.linspace(0.0, 0.98, 50)
"""Correlations that are tried."""


def noise_level(
    residuals: Array, layout: Layout, dropped: NDArray[np.bool_], bare: bool
) -> tuple[float, float]:
    """Return the factor on the stated standard deviation, and the correlation of neighbours.

    Both come from stretches of `STRETCH` residuals, each less a cubic. The quieter half of the
    stretches counts. Where the residuals are bare noise, nearly all of them count, and all
    residuals together where they agree with the stretches. They are none where nearly all are
    clearly louder than the quieter half says: noise is the same all over the data, and what a model
    misses is not. Data in a random order tell the correlation alone. The result is 1 and 0 where
    the noise does not differ clearly from what is stated.
    """
    if layout.shuffled:
        return 1.0, _of_neighbours(residuals, layout, dropped)
    if layout.oscillating:
        return _first_order(residuals, layout, dropped)
    rows = _stretches(layout, dropped)
    if len(rows) < FEWEST:
        return 1.0, 0.0
    found = _of_stretches(residuals, layout, dropped, rows, bare=bare)
    if bare and _louder_than_its_quieter_half(residuals[rows], *found):
        return _of_stretches(residuals, layout, dropped, rows, bare=False)
    return found


def _of_neighbours(residuals: Array, layout: Layout, dropped: NDArray[np.bool_]) -> float:
    """Return the correlation of neighbours taken under unlike conditions, 0 where it is not clear.

    What a model misses differs from one to the next, and lowers the correlation. Its size looks
    like that of noise, so that the size of the noise is not told.
    """
    whole = _whole(residuals, layout, dropped)
    if whole is None:
        return 0.0
    followed = float(np.sum(layout.previous >= 0))
    return whole[1] if whole[1] > ALIKE / np.sqrt(followed) else 0.0


def _louder_than_its_quieter_half(rows: Array, factor: float, correlation: float) -> bool:
    """Whether the quieter half of stretches (m, STRETCH) shows clearly less than that noise."""
    lowest = np.quantile(np.sum((rows @ _beside_cubic()) ** 2, axis=1), QUIET)
    half = np.sqrt(lowest / np.interp(correlation, RHO, _expected(QUIET)[:, 0]))
    spread = np.sqrt((1 + correlation**2) / (1 - correlation**2))
    unsure = LEAST_FACTOR + CLEAR * _error(QUIET, len(rows)) * spread
    return bool(factor > half * np.exp(unsure))


def _of_stretches(
    residuals: Array,
    layout: Layout,
    dropped: NDArray[np.bool_],
    rows: NDArray[np.int64],
    *,
    bare: bool,
) -> tuple[float, float]:
    """Return factor and correlation of the quieter half of the stretches, or of nearly all.

    rows (m, STRETCH): the residuals of each.
    """
    quiet = NEARLY_ALL if bare else QUIET
    left = residuals[rows] @ _beside_cubic()
    power = np.sum(left**2, axis=1)
    lowest = float(np.quantile(power, quiet))
    if lowest == 0:  # data that repeat what is predicted, as computed ones do, tell no noise
        return 1.0, 0.0
    expected = _expected(quiet)
    ratio = _neighbours(left[power <= lowest])
    correlation = float(np.interp(ratio, expected[:, 1], RHO))
    independent = quiet * left.size
    whole = _whole(residuals, layout, dropped) if bare else None
    if whole is not None and abs(whole[1] - correlation) < _unsure(ratio, expected, independent):
        correlation = whole[1]
    least = CLEAR / np.sqrt(independent)
    if correlation < (least if bare else max(LEAST_CORRELATION, least)):
        correlation = 0.0
    factor = float(np.sqrt(lowest / np.interp(correlation, RHO, expected[:, 0])))
    error = _error(quiet, len(rows))
    if whole is not None and abs(np.log(whole[0] / factor)) < CLEAR * error:
        factor = whole[0]
        spread = (1 + correlation**2) / (1 - correlation**2)
        error = np.sqrt(spread / (2 * np.sum(~dropped & (layout.datum >= 0))))
    clear = abs(np.log(max(factor, 1e-300))) > max(0.0 if bare else LEAST_FACTOR, CLEAR * error)
    return factor if clear else 1.0, correlation


def _error(quiet: float, number: int) -> float:
    """Return the relative error of the factor of that part of a number of stretches.

    Of a quantile, from the density of ln χ² there.
    """
    freedom = STRETCH - CUBIC
    quantile = chdtri(freedom, 1 - quiet)
    log_density = freedom / 2 * np.log(quantile / 2) - quantile / 2 - gammaln(freedom / 2)
    return float(np.sqrt(quiet * (1 - quiet) / number) / np.exp(log_density) / 2)


def _first_order(
    residuals: Array, layout: Layout, dropped: NDArray[np.bool_]
) -> tuple[float, float]:
    """Return factor and correlation of residuals that are noise of first order, else 1 and 0.

    They are, where no correlation at any lag is left once each is freed from that with the one
    before: what a model misses has the periods of the motion.
    """
    # Glitches that are not known yet would count as more noise
    known = ~dropped & (layout.datum >= 0)
    scatter = MAD * float(np.median(np.abs(residuals[known]))) if known.any() else 0.0
    dropped = dropped | (np.abs(residuals) > FAR_OUT * scatter)
    whole = _whole(residuals, layout, dropped)
    if whole is None:
        return 1.0, 0.0
    count = float(np.sum(~dropped & (layout.datum >= 0)))
    least = CLEAR / np.sqrt(count)
    factor, correlation = whole
    if correlation < least:
        correlation = 0.0
    before = layout.previous
    later = np.flatnonzero((before >= 0) & ~dropped & ~dropped[before])
    fresh = residuals[later] - correlation * residuals[before[later]]
    power = float(np.sum(fresh**2))
    lags = [float(np.sum(fresh[k:] * fresh[:-k])) / power for k in range(1, STRETCH)]
    if np.abs(lags).max() > least:
        return 1.0, 0.0
    error = np.sqrt((1 + correlation**2) / (1 - correlation**2) / (2 * count))
    return factor if abs(np.log(factor)) > CLEAR * error else 1.0, correlation


def _unsure(ratio: float, expected: Array, independent: float) -> float:
    """Return by how much the correlation of stretches may miss that of all residuals."""
    steepness = np.interp(ratio, expected[:, 1], np.gradient(expected[:, 1], RHO))
    return float(max(LEAST_CORRELATION, CLEAR / (np.sqrt(independent) * steepness)))


def _whole(
    residuals: Array, layout: Layout, dropped: NDArray[np.bool_]
) -> tuple[float, float] | None:
    """Return the root mean square of all residuals, and the correlation of all neighbours.

    The result is None where there are no residuals, or all are 0.
    """
    before = layout.previous
    later = np.flatnonzero((before >= 0) & ~dropped & ~dropped[before])
    one = residuals[later]
    other = residuals[before[later]]
    scale = float(np.sqrt(np.sum(one**2) * np.sum(other**2)))
    if scale == 0:
        return None
    rms = float(np.sqrt(np.mean(residuals[~dropped & (layout.datum >= 0)] ** 2)))
    return rms, float(np.sum(one * other)) / scale


def _neighbours(left: Array) -> float:
    """Return Σeᵢeᵢ₊₁/Σe² of stretches (m, STRETCH)."""
    return float(np.sum(left[:, 1:] * left[:, :-1]) / np.sum(left**2))


@cache
def _expected(quiet: float) -> Array:
    """Return, for each of `RHO`, what stretches of noise of variance 1 and that correlation show.

    The power below which the quietest of them lie, and Σeᵢeᵢ₊₁/Σe² of those, (len(RHO), 2); of
    `DRAWN` stretches, since the quietest are not like the others.
    """
    rng = np.random.default_rng(0)
    drawn = rng.standard_normal((DRAWN, STRETCH))
    found = []
    for rho in RHO:
        noise = drawn.copy()
        for k in range(1, STRETCH):
            noise[:, k] = rho * noise[:, k - 1] + np.sqrt(1 - rho**2) * drawn[:, k]
        left = noise @ _beside_cubic()
        power = np.sum(left**2, axis=1)
        lowest = float(np.quantile(power, quiet))
        found.append((lowest, _neighbours(left[power <= lowest])))
    return np.array(found)


@cache
def _beside_cubic() -> Array:
    """Return the projection (STRETCH, STRETCH) that takes a cubic off."""
    powers = np.linspace(-1, 1, STRETCH)[:, None] ** np.arange(CUBIC)
    own, _ = np.linalg.qr(powers)
    return np.asarray(np.eye(STRETCH) - own @ own.T)


def _stretches(layout: Layout, dropped: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return rows (m, STRETCH) of residuals that follow each other and are no glitches."""
    before = np.where(dropped, -1, layout.previous)
    before = np.where((before >= 0) & dropped[before], -1, before)
    following = np.full(len(before), -1)
    linked = np.flatnonzero(before >= 0)
    following[before[linked]] = linked
    begins = np.flatnonzero((before < 0) & ~dropped & (layout.datum >= 0))
    rows = []
    while len(begins):
        row = [begins]
        for _ in range(STRETCH - 1):
            row.append(np.where(row[-1] >= 0, following[row[-1]], -1))
        whole = np.stack(row, axis=1)
        rows.append(whole[whole[:, -1] >= 0])
        ends = rows[-1][:, -1]
        begins = following[ends]
        begins = begins[begins >= 0]
    return np.concatenate(rows) if rows else np.empty((0, STRETCH), np.int64)
