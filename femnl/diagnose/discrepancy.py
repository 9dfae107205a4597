"""Evidence of causes whose equations are not exact, beside a discrepancy of unknown size.

M. C. Kennedy and A. O'Hagan, J. R. Stat. Soc. B 63, 425 (2001): every candidate, the base model
among them, may miss the data by more than noise. What it misses is a part along the directions in
which this kind of data deviates smoothly, and scatter beside them. The sizes of both are unknown
and integrated over, so that a cause is worth what it takes from the discrepancy.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from femnl.core.portions import portions
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.distortions import Distortions
from femnl.diagnose.done_by import done_by_each, effects_of
from femnl.fits.least_squares import FitResult, log_prior
from femnl.observe.model import MeasurementModel
from femnl.observe.residuals import Layout

MOST_DIRECTIONS = 40
"""Directions of smooth deviations, those that most of the named ones share."""
SHARED = 1e-3
"""Part of the largest singular value below which a direction adds nothing to the others."""
SIZES = np.concatenate([[0.0], np.geomspace(0.1, 1e5, 25)])
"""Sizes τ [σ] of a discrepancy that are summed over: uniform in the logarithm, or none."""
ACCURACIES = ((1.0, 0.5), (2.0, 0.25), (4.0, 0.15), (8.0, 0.1))
"""Factors on the stated accuracy of equations, and their prior probabilities.

A device may be farther from what an equation assumes than the devices that its accuracy is known
from.
"""
LEAST_ACCURATE = 0.25
"""The largest standard deviation of what an equation may miss, in parts of what its cause does."""
LAGS = 64
"""Residuals along a line over which a remainder may be correlated."""
UNCORRELATED = 0.05
"""Correlation below which neighbours count as independent."""


@dataclass(frozen=True)
class Discrepancy:
    """What every candidate may miss the data by.

    directions (k, n): orthonormal, of smooth deviations. pieces: independent data of what is beside
    them, fewer than residuals where the remainder of the best candidate is smooth. sizes (k,): τ
    that are summed over, in σ.
    """

    directions: Array
    pieces: float
    sizes: Array = field(default_factory=lambda: SIZES)

    @property
    def none(self) -> "Discrepancy":
        """The same data with no discrepancy, where only equations may be inexact."""
        return replace(self, directions=self.directions[:0], sizes=np.zeros(1))


def discrepancy(base: FitResult, best: FitResult) -> Discrepancy:
    """Return the discrepancy that suits the data of a base model.

    Args: best: the fit that leaves least, whose remainder tells how smooth a remainder is.
    """
    model = base.model
    named = model.base_model.smooth_deviations(model.effects, *model.split(base.vector))
    n = len(base.residuals)
    directions = _orthonormal([row for row in named.values() if np.any(row)], n)
    left = best.residuals - directions.T @ (directions @ best.residuals)
    beside = max(n - len(directions), 1)
    blocks = np.unique(model.base_model.blocks).size
    pieces = beside / _smoothness(left, model.base_model)
    return Discrepancy(directions, float(min(max(pieces, blocks), beside)))


def _orthonormal(rows: list[Array], n: int) -> Array:
    """Return the orthonormal directions (k, n) that rows (n,) of any size have in common most."""
    sizes = np.array([np.linalg.norm(row) for row in rows])[:, None]

    def units(at: slice) -> Array:
        return np.asarray(np.array([row[at] for row in rows]) / sizes)

    if not rows:
        return np.empty((0, n))
    # The Gram matrix is small, and rows may be long
    gram = np.sum([units(at) @ units(at).T for at in portions(n)], axis=0)
    values, vectors = np.linalg.eigh(gram)
    largest = np.argsort(-values)[: min(MOST_DIRECTIONS, n - 1)]
    kept = largest[values[largest] > SHARED**2 * values.max()]
    directions = np.empty((len(kept), n))
    for at in portions(n):
        directions[:, at] = (vectors[:, kept] / np.sqrt(values[kept])).T @ units(at)
    return directions


def _smoothness(residuals: Array, base_model: MeasurementModel) -> float:
    """Return how many neighbours each residual stands for, 1 where they are independent."""
    layout = base_model.layout
    if layout is None:
        return 1.0
    along = _integrated(residuals, layout)
    return along**2 if layout.planar else along


def _integrated(residuals: Array, layout: Layout) -> float:
    """Return 1 + 2 Σ ρ_k of the residuals along the lines of acquisition."""
    total = 1.0
    at = np.flatnonzero(layout.datum >= 0)
    there = at
    power = float(np.mean(residuals[at] ** 2))
    for _ in range(LAGS):
        there = layout.previous[there]
        at = at[there >= 0]
        there = there[there >= 0]
        if not len(at) or power == 0:
            break
        correlation = float(np.mean(residuals[at] * residuals[there])) / power
        if correlation < UNCORRELATED:
            break
        total += 2 * correlation
    return total


def log_evidence(candidate: Candidate, base: Candidate, allowed: Discrepancy) -> float:
    """Return the logarithm of ∫ likelihood × prior over parameters and sizes of the discrepancy.

    Residuals r have the covariance v₀ (1 − QᵀQ)/w + v₁ QᵀQ, with v = 1 + τ² and the weight
    w = pieces per residual, and beside it the distortions that the accuracy of each cause's
    equation allows, with normal coefficients. How accurate an equation is for this device is known
    to a factor only (`ACCURACIES`), the same for all causes of a set. Around the fit the model is
    linear, so that parameters and distortions integrate in closed form. Up to a constant that all
    candidates of the measurement share.
    """
    result = candidate.result
    effects = effects_of(candidate)
    ways = [Distortions(done, result.model.base_model) for done in done_by_each(candidate, base)]
    n_ways = [part.count for part in ways]
    seen = _Seen(result, ways, allowed)

    def sizes(factor: float) -> Array:
        """Return the standard deviation of each distortion (n_distortions,)."""
        each = [
            min(factor * effect.accuracy, max(effect.accuracy, LEAST_ACCURATE))
            for effect in effects
        ]
        return np.repeat(each, n_ways)

    return float(
        logsumexp(
            [
                np.log(probability) + seen.log_evidence(sizes(factor))
                for factor, probability in ACCURACIES
            ]
        )
    )


class _Seen:
    """A fit and what its causes' equations may miss, as the discrepancy of the data sees them.

    The products of long columns, which are the same whatever the accuracy of the equations.
    """

    def __init__(self, result: FitResult, ways: list[Distortions], allowed: Discrepancy) -> None:
        """Take the ways in which the equation of each cause may miss."""
        self._result = result
        self._allowed = allowed
        low, high = result.model.bounds
        self._width = high - low
        directions = allowed.directions
        columns = result.vector.size + sum(part.count for part in ways)
        self._inside = np.zeros((len(directions), columns))
        self._across = np.zeros((columns, columns))
        self._pull = np.zeros(columns)
        for at in portions(len(result.residuals)):
            slopes = np.concatenate(
                [result.slopes[at] * self._width, *(part.of(at) for part in ways)], axis=1
            )
            self._inside += directions[:, at] @ slopes
            self._across += slopes.T @ slopes
            self._pull += slopes.T @ result.residuals[at]
        self._seen = directions @ result.residuals
        self._across -= self._inside.T @ self._inside
        self._pull -= self._inside.T @ self._seen

    def log_evidence(self, missed: Array) -> float:
        """Return the logarithm of evidence where equations are as accurate as stated.

        Args: missed (n_distortions,): the standard deviation of each.
        """
        result = self._result
        allowed = self._allowed
        width = self._width
        unit = np.concatenate([np.ones(width.size), missed])
        known = np.concatenate([np.full(width.size, 12.0), np.ones(missed.size)])
        inside = self._inside * unit
        across = self._across * np.outer(unit, unit)
        pull = self._pull * unit
        seen = self._seen
        k = len(allowed.directions)
        weight = allowed.pieces / max(len(result.residuals) - k, 1)
        rest = max(result.chi2 - float(seen @ seen), 0.0)
        smooth = 1 + allowed.sizes**2
        scatter = 1 + allowed.sizes**2
        per_scatter = weight / scatter
        own = across * per_scatter[:, None, None] + np.diag(known)
        known_to_all = Information(own, inside)
        # What ended at a bound cannot move beyond it
        moving = np.concatenate([result.free, np.ones(missed.size, bool)])
        known_to_free = (
            known_to_all
            if moving.all()
            else Information(own[:, moving][:, :, moving], inside[:, moving])
        )
        taken = known_to_free.taken(pull[moving] * per_scatter[:, None], seen, smooth)
        square = rest * per_scatter + float(seen @ seen) / smooth[:, None] - taken
        level = -0.5 * (
            square
            + k * np.log(smooth)[:, None]
            + allowed.pieces * np.log(scatter)
            + known_to_all.log_determinant(smooth)
        )
        best = np.unravel_index(int(np.argmax(level)), level.shape)
        variance = known_to_all.variance(smooth[best[0]], int(best[1]))
        spread = np.sqrt(variance[: width.size]) * width
        prior = log_prior(result.model, result.vector, spread) + float(np.sum(np.log(width)))
        constant = 0.5 * width.size * np.log(2 * np.pi) - np.log(level.size)
        return float(logsumexp(level) + prior + constant)


class Information:
    """Fisher matrices F = M + BᵀB/v₁ for each size of the scatter, and any v₁ of the smooth part.

    One decomposition of M and of B for each scatter does for all v₁.
    """

    def __init__(self, own: Array, inside: Array) -> None:
        """Take M (n_scatter, m, m) and B (k, m).

        Priors of unit width or deviation tell 1 at least, which rounding may take from the matrix
        of causes that do the same.
        """
        values, vectors = np.linalg.eigh(own)
        self._values = np.maximum(values, 1.0)
        self._unit = vectors / np.sqrt(self._values)[:, None, :]  # in which M is 1
        self._left, self._size, self._right = np.linalg.svd(
            inside @ self._unit, full_matrices=False
        )

    def log_determinant(self, smooth: Array) -> Array:
        """Return ln|F| (n_smooth, n_scatter)."""
        added = np.log1p(self._size**2 / smooth[:, None, None])
        return np.asarray(np.sum(np.log(self._values), axis=1) + np.sum(added, axis=2))

    def taken(self, pull: Array, seen: Array, smooth: Array) -> Array:
        """Return gᵀF⁻¹g (n_smooth, n_scatter), g = pull + Bᵀ seen/v₁.

        Args: pull (n_scatter, m); seen (k,).
        """
        pulled = np.einsum("smi,sm->si", self._unit, pull)
        along = np.einsum("sri,si->sr", self._right, pulled)
        beside = pulled - np.einsum("sri,sr->si", self._right, along)
        own = self._size * np.einsum("skr,k->sr", self._left, seen)
        both = along + own / smooth[:, None, None]
        inside = np.sum(both**2 / (1 + self._size**2 / smooth[:, None, None]), axis=2)
        return np.asarray(np.sum(beside**2, axis=1) + inside)

    def variance(self, smooth: float, scatter: int) -> Array:
        """Return the diagonal (m,) of F⁻¹ for v₁ and the index of a scatter."""
        unit = self._unit[scatter]
        right = self._right[scatter]
        along = unit @ right.T
        beside = unit - along @ right
        left = along**2 / (1 + self._size[scatter] ** 2 / smooth)
        return np.asarray(np.sum(beside**2, axis=1) + np.sum(left, axis=1))
