"""Maximum likelihood of a decay under the noise of an analyser, which may be correlated."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import polygamma

from femnl.fits.decay.memory import MOST_BLOCKS, block_means, residual_covariance
from femnl.observe.decay.law import PARAMETERS, Array, Term, log_signal
from femnl.observe.decay.noise import log_density, normal_score

COMPLEX_STEP = 1e-30
FAINTEST_FLOOR = -60.0
"""ln of the weakest floor that is told from none, relative to the signal."""
FAINTEST_WANDER = -20.0
"""ln κ of the weakest wander that is told from none."""
BASE = ("level", "decay_rate", "floor", "wander")
OF_NOISE = ("floor", "wander")
"""Parameters that say how large the noise is."""
HESSIAN_STEP = 1e-4
HIGHEST_LEVEL = 10.0
"""ln of the signal at the begin over the strongest datum, at most."""
FASTEST_RATE = 200.0
"""Rate of a decay times the duration: faster ones leave the floor from the first datum on."""
STRONGEST_DAMPING = 10.0
"""Nonlinear over linear damping at the begin, at most: a drive that dies in the filter looks so."""
START_WANDERS = (-6.0, -2.5)
"""ln κ that fits start from: a wander of 0.3 dB and of 1.8 dB."""
CLIPPED_SCORE = 3.0
"""Normal scores beyond this say nothing about how slow the noise is."""
FLAT_EIGENVALUE = 1e-9
"""Eigenvalues of the scaled information below this are directions that the data do not show."""
FEWEST_INDEPENDENT = 100.0
"""Independent values of a floor that show how it scatters."""
MOST_AVERAGES = 200.0
"""More are told from a constant floor by nobody."""


@dataclass(frozen=True, eq=False)
class Likelihood:
    """ln of the probability of a record's power under one law.

    time (n,) [s] from the begin of the decay; log_power (n,): ln of the power in units near the
    signal at its begin; averages: independent values that each power is the mean of; terms: of the
    law; least_wander: ln κ at least. Parameters, each of order one: level, decay_rate times the
    duration, ln N₀, ln κ, and those of the terms, rates times the duration.
    """

    time: Array
    log_power: Array
    averages: float
    terms: tuple[Term, ...] = ()
    least_wander: float = FAINTEST_WANDER

    @property
    def names(self) -> list[str]:
        """Names of the parameters."""
        return [*BASE, *(name for term in self.terms for name in PARAMETERS[term])]

    @property
    def units(self) -> Array:
        """SI value of one unit of each parameter; floor and wander are logarithms."""
        duration = float(self.time.max())
        size = {
            "decay_rate": 1 / duration,
            "partner_rate": 1 / duration,
            "splitting": 1 / duration,
            "exit_rate": 1 / duration**2,
        }
        return np.array([size.get(name, 1.0) for name in self.names])

    def signal(self, values: Array) -> tuple[Array, Array]:
        """Return S (n,) and d ln S/d values (n, k) by complex steps."""
        columns = []
        scaled = values * self.units
        for k, unit in enumerate(self.units):
            moved = scaled.astype(complex)
            moved[k] += 1j * COMPLEX_STEP * unit
            shifted = log_signal(dict(zip(self.names, moved, strict=True)), self.time)
            columns.append(shifted.imag / COMPLEX_STEP)
        return np.asarray(np.exp(shifted.real)), np.stack(columns, axis=1)

    def noise(self, values: Array, signal: Array) -> Array:
        """Return N = N₀ + κS (n,)."""
        return np.asarray(np.exp(values[2]) + np.exp(values[3]) * signal)

    def scores(self, values: Array) -> tuple[float, Array]:
        """Return ln of the probability, and its derivatives datum by datum (n, k)."""
        signal, slopes = self.signal(values)
        noise = self.noise(values, signal)
        value, by_signal, by_noise = log_density(self.log_power, signal, noise, self.averages)
        growing = np.exp(values[3])
        scores = ((by_signal + growing * by_noise) * signal)[:, None] * slopes
        scores[:, 2] = by_noise * np.exp(values[2])
        scores[:, 3] = by_noise * growing * signal
        return float(value.sum()), scores

    def residual(self, values: Array) -> Array:
        """Return normal scores (n,) of the data."""
        signal, _ = self.signal(values)
        return normal_score(self.log_power, signal, self.noise(values, signal), self.averages)

    def fit(self, start: Array, held: Array | None = None) -> tuple[Array, float]:
        """Return the values of the highest probability near a start, and its ln.

        Args: held (k,): values that are held, NaN where free; all are free unless given.
        """

        def objective(values: Array) -> tuple[float, Array]:
            value, scores = self.scores(values)
            return -value, -scores.sum(axis=0)

        bounds = [self._bound(name) for name in self.names]
        # A start with little wander may be thrown out of its valley, one with much stays in it.
        starts = [np.concatenate([start[:3], [size], start[4:]]) for size in START_WANDERS]
        if held is not None:
            own = zip(bounds, held.tolist(), strict=True)
            bounds = [bound if np.isnan(value) else (value, value) for bound, value in own]
            starts = [np.where(np.isnan(held), one, held) for one in starts]
        runs = [
            minimize(objective, begin, jac=True, method="L-BFGS-B", bounds=bounds)
            for begin in starts
        ]
        best = min(runs, key=lambda run: float(run.fun))
        return np.asarray(best.x), -float(best.fun)

    def _bound(self, name: str) -> tuple[float, float]:
        """Return the range of a parameter: what no record can show lies outside."""
        top = float(self.log_power.max())
        ranges = {
            "level": (float(self.log_power.min()), top + HIGHEST_LEVEL),
            "decay_rate": (0.0, FASTEST_RATE),
            # All data of a stretch may lie farther below what its line says of its begin
            "floor": (FAINTEST_FLOOR, max(top, FAINTEST_FLOOR)),
            "wander": (self.least_wander, max(self.least_wander, 0.0)),
            "damping_ratio": (0.0, STRONGEST_DAMPING),
            "exit_rate": (0.0, FASTEST_RATE),
            "partner": (0.0, 1.0),
            "partner_rate": (0.0, FASTEST_RATE),
        }
        return ranges.get(name, (-np.inf, np.inf))

    def covariance(self, values: Array, held: Array | None = None) -> tuple[Array, float]:
        """Return the covariance (k, k), and the correlation time [points] of residuals.

        Parameters that are `held` (k,), all but the NaN, have none.

        The observed information gives it for independent data. Noise that an analyser's filter or
        a working point makes slow carries less. For parameters of the signal, the covariance of
        the residuals widens it; for those of the noise, the sums of each datum's influence over
        its successors (Newey and West, Econometrica 55, 703 (1987)).
        """
        k = len(values)
        information = np.empty((k, k))
        for n, step in enumerate(np.eye(k) * HESSIAN_STEP):
            up = self.scores(values + step)[1].sum(axis=0)
            down = self.scores(values - step)[1].sum(axis=0)
            information[n] = (down - up) / (2 * HESSIAN_STEP)
        free = np.ones(k, bool) if held is None else np.isnan(held)
        seen = free & np.array([self._seen(n, values, information) for n in range(k)])
        inverse = np.zeros((k, k))
        part = np.ix_(seen, seen)
        inverse[part] = _inverse(0.5 * (information + information.T)[part])
        influence = self.scores(values)[1] @ inverse
        widened = np.ones(k)
        remembered = self._remembered(values, inverse)
        for n in np.flatnonzero(seen).tolist():
            if self.names[n] in OF_NOISE:
                widened[n] = correlation_time(influence[:, n])
            else:
                widened[n] = max(remembered[n], 1.0)
        factor = np.sqrt(widened)
        covariance = inverse * np.outer(factor, factor)
        lost = np.flatnonzero(free & ~seen)
        covariance[lost, lost] = np.inf
        strong, slow = self._slowness(values)
        own = correlation_time(influence[:, 1])
        return covariance, max(own, slow) if strong else own

    def _slowness(self, values: Array) -> tuple[bool, float]:
        """Return whether there are data above the floor, and how long residuals there last."""
        signal, _ = self.signal(values)
        strong = np.log(signal) > values[2]
        scores = np.clip(self.residual(values)[strong], -CLIPPED_SCORE, CLIPPED_SCORE)
        return bool(strong.any()), correlation_time(scores) if strong.sum() > 2 else 1.0

    def _remembered(self, values: Array, inverse: Array) -> Array:
        """Return by how much noise with a memory widens the variance of each parameter (k,)."""
        moves = HESSIAN_STEP * np.eye(len(values))
        slopes = [self.residual(values + move) - self.residual(values - move) for move in moves]
        design = np.stack(slopes, axis=1) / (2 * HESSIAN_STEP)
        residual = np.clip(self.residual(values), -CLIPPED_SCORE, CLIPPED_SCORE)
        size = -(-len(residual) // MOST_BLOCKS)
        # A size of noise moves residuals in proportion to themselves, which no memory explains
        of_signal = [name not in OF_NOISE for name in self.names]
        blocks = block_means(design[:, of_signal], size)
        covariance = size * residual_covariance(block_means(residual, size), blocks)
        levers = blocks @ inverse[of_signal]
        wide = np.einsum("ik,ij,jk->k", levers, covariance, levers)
        narrow = np.maximum(np.sum(levers**2, axis=0), np.finfo(float).tiny)
        return np.asarray(wide / narrow)

    def _seen(self, n: int, values: Array, information: Array) -> bool:
        """Whether the data show a parameter at all."""
        if self.names[n] in OF_NOISE:
            limit = FAINTEST_FLOOR if self.names[n] == "floor" else self.least_wander
            return bool(values[n] > limit + 1e-6 and information[n, n] > 1e-3)
        return bool(information[n, n] > 0)


def _inverse(information: Array) -> Array:
    """Return the inverse over the directions that the data show."""
    scale = np.sqrt(np.diag(information))
    size, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    shown = size > FLAT_EIGENVALUE
    kept = vectors[:, shown] / np.sqrt(size[shown])
    return np.asarray(kept @ kept.T / np.outer(scale, scale))


def correlation_time(values: Array) -> float:
    """Return the correlation time [points] of a series of mean 0, at least 1.

    1 + 2 Σ ρ_k, ended where the sum of two neighbours turns negative; a series of n points
    that a fit has made to sum to 0 shows too little of it by about its square over n. Of a series
    only ten times as long, it still shows 12 % too little on average.
    Source: Geyer, Statistical Science 7, 473 (1992).
    """
    n = len(values)
    size = 2 ** int(np.ceil(np.log2(2 * n)))
    spectrum = np.abs(np.fft.rfft(values - values.mean(), size)) ** 2
    products = np.fft.irfft(spectrum, size)[: n // 2]
    if products[0] <= 0:
        return 1.0
    pairs = products[: len(products) // 2 * 2].reshape(-1, 2).sum(axis=1) / products[0]
    negative = np.flatnonzero(pairs <= 0)
    stop = int(negative[0]) if negative.size else len(pairs)
    time = 2 * float(pairs[:stop].sum()) - 1
    return max(time / max(1 - time / n, 0.25), 1.0)


def averages_of(floor: Array) -> float:
    """Return M ≥ 1 of a floor from its powers (n,) [ln units]: ψ'(M) = var ln p.

    A floor too short for its correlation shows too little scatter, and is taken for M = 1.
    """
    if len(floor) < 2:
        return 1.0
    away = floor - floor.mean()
    independent = len(floor) / correlation_time(away)
    variance = float(np.mean(away**2))
    if independent < FEWEST_INDEPENDENT or variance >= polygamma(1, 1.0):
        return 1.0
    if variance <= polygamma(1, MOST_AVERAGES):
        return MOST_AVERAGES
    return float(brentq(lambda m: polygamma(1, m) - variance, 1.0, MOST_AVERAGES))


def start_values(
    likelihood: Likelihood, level: float, rate: float, floor: float, extra: Sequence[float] = ()
) -> Array:
    """Return the start (k,) from a line: level and floor [ln units], rate [1/s]."""
    duration = float(likelihood.time.max())
    return np.array([level, rate * duration, floor, START_WANDERS[0], *extra])
