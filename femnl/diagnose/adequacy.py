"""Is a model adequate? One p-value for all score tests."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from femnl.core.portions import portions
from femnl.core.readout import Array
from femnl.diagnose.score_test import ScoreTest, chi_square_tail
from femnl.fits.least_squares import FitResult

N_DRAWS = 4000
"""Simulated sets of residuals that calibrate the p-value."""
TAIL = 20
"""Simulated sets in the tail below which the p-value is extrapolated."""
CERTAIN = 1e-6
"""p-value, by Bonferroni's inequality, below which none is simulated."""
EXACT = 5000
"""Residuals up to which whole sets of them are drawn; beyond, only what tests see of them."""
BESIDE = ("chi-square", "outlier", "neighbours")
"""Tests of any residuals, beside those of directions and effects."""


@dataclass(frozen=True)
class Adequacy:
    """How well the tests of its residuals speak for a model.

    The statistic is the smallest p-value of all tests: χ², every direction and effect, the largest
    outlier, and the correlation of neighbours. Its distribution follows from residuals simulated by
    the model itself: what white noise leaves beside the tangents.

    found: tests of directions and effects.
    """

    result: FitResult
    found: list[ScoreTest]

    def p_value(self, factor: float = 1.0) -> tuple[float, str]:
        """Return the calibrated p-value of the model, and the test that speaks most against it.

        Args: factor: noise over the stated one.
        """
        least, worst = self._least(factor)
        bound = least * all_tests(len(self.found))
        if bound < CERTAIN:
            return bound, worst
        below = int(np.searchsorted(self._simulated, least, side="right"))
        if below >= TAIL:
            return below / N_DRAWS, worst
        # In the far tail the tests are as good as exclusive, so that p is proportional to the
        # smallest p-value.
        return float(min(1.0, least * TAIL / N_DRAWS / self._simulated[TAIL - 1])), worst

    def bound(self, count: int, factor: float = 1.0) -> tuple[float, str]:
        """Return Bonferroni's bound of the p-value, and the test that speaks most against a model.

        Args: count: tests of directions and effects that the bound allows for. factor: noise over
            the stated one.
        """
        least, worst = self._least(factor)
        return least * all_tests(count), worst

    def _least(self, factor: float) -> tuple[float, str]:
        """Return the smallest p-value of all tests, and the name of its test."""
        residuals = self.result.residuals[None] / factor
        of_tests = [
            float(chi_square_tail(np.array(test.square / factor**2), test.degrees))
            for test in self.found
        ]
        seen = [*of_tests, *_beside(residuals, self.result.degrees)[0]]
        k = int(np.argmin(seen))
        names = [*(test.name for test in self.found), *BESIDE]
        return float(seen[k]), names[k]

    @cached_property
    def _simulated(self) -> Array:
        """Smallest p-values (N_DRAWS,) of simulated residuals, in rising order.

        Noise of another size gives the same ones, but for values so close that it ranks them.
        """
        rng = np.random.default_rng(20)
        long = len(self.result.residuals) > EXACT
        drawn = self._of_what_tests_see(rng) if long else self._of_residuals(rng)
        return np.sort(drawn)

    def _of_residuals(self, rng: np.random.Generator) -> Array:
        """Draw residuals as white noise beside the model's tangents, and test them.

        They are ranked as the data are.
        """
        result = self.result
        own, _ = np.linalg.qr(result.jacobian[:, result.free])
        noise = rng.standard_normal((N_DRAWS, len(result.residuals)))
        for ranked in result.model.base_model.ranked:
            ranked.rank(result.residuals, noise)
        left = noise - (noise @ own) @ own.T
        of_tests = _smallest(self._squares(left), self._sizes)
        others = _beside(left, result.degrees).min(axis=1)
        return np.asarray(np.minimum(of_tests, others))

    def _of_what_tests_see(self, rng: np.random.Generator) -> Array:
        """Return the same for long data, drawn in the space that the tests span.

        Outlier and neighbours are as good as independent of it.
        """
        degrees = self.result.degrees
        values, vectors = np.linalg.eigh(self._overlaps)
        kept = values > 1e-10
        # Drawn along the directions themselves: rounding may turn or mirror the vectors
        along = rng.standard_normal((N_DRAWS, len(values)))
        drawn = along @ vectors[:, kept]
        squares = (drawn @ (vectors[:, kept] * np.sqrt(values[kept])).T) ** 2
        of_tests = _smallest(_summed(squares, self._sizes), self._sizes)
        total = np.sum(drawn**2, axis=1) + rng.chisquare(degrees - int(kept.sum()), N_DRAWS)
        others = rng.uniform(size=(N_DRAWS, 2)).min(axis=1)
        of_sum = chi_square_tail(total, degrees)
        return np.asarray(np.min([of_tests, of_sum, others], axis=0))

    def _squares(self, residuals: Array) -> Array:
        """Return what tests of directions and effects see of residuals (m, n): χ² (m, n_tests)."""
        nothing = np.empty((0, residuals.shape[1]))
        # One product of all: by itself, each test takes as long as it takes to read the residuals
        directions = np.concatenate([nothing, *(test.basis for test in self.found)])
        return _summed((residuals @ directions.T) ** 2, self._sizes)

    @property
    def _overlaps(self) -> Array:
        """Products (n_directions, n_directions) of the directions of all tests.

        They are added up over portions of the data.
        """
        total = np.zeros((int(self._sizes.sum()),) * 2)
        for portion in portions(len(self.result.residuals)):
            # Products in single precision would make dependent directions look independent
            some = np.concatenate([test.basis[:, portion] for test in self.found], dtype=float)
            total += some @ some.T
        return total

    @cached_property
    def _sizes(self) -> NDArray[np.int64]:
        """Degrees of freedom of each test."""
        return np.array([test.degrees for test in self.found], dtype=np.int64)


def is_refuted(result: FitResult, count: int) -> bool:
    """Whether χ² alone refutes a model, so that no p-value of so many tests would be simulated."""
    of_sum = float(chi_square_tail(np.array(result.chi2), result.degrees))
    return of_sum * all_tests(count) < CERTAIN


def all_tests(found: int) -> int:
    """Return the number of all tests, so many of directions and effects among them."""
    return found + len(BESIDE)


def _summed(squares: Array, sizes: NDArray[np.int64]) -> Array:
    """Return the sums (m, n_tests) of squares along the directions of each test."""
    if len(sizes) == 0:
        return squares
    return np.asarray(np.add.reduceat(squares, np.cumsum(sizes) - sizes, axis=1))


def _smallest(squares: Array, sizes: NDArray[np.int64]) -> Array:
    """Return the smallest p-value (m,) of tests whose χ² are squares (m, n_tests).

    Of tests with the same degrees of freedom it is that of the largest χ².
    """
    smallest = np.ones(len(squares))
    for degrees in np.unique(sizes):
        largest = squares[:, sizes == degrees].max(axis=1)
        smallest = np.minimum(smallest, chi_square_tail(largest, int(degrees)))
    return smallest


def _beside(residuals: Array, degrees: int) -> Array:
    """Return the p-values (m, 3) of χ², of the largest outlier and of neighbours' correlation."""
    n = residuals.shape[1]
    largest = np.abs(residuals).max(axis=1) * np.sqrt(n / degrees)
    # Data without noise: the logarithm of 0 is what it should be
    with np.errstate(divide="ignore"):
        outlier = -np.expm1(n * np.log1p(-2 * ndtr(-largest)))
    neighbours = np.abs(np.sum(residuals[:, 1:] * residuals[:, :-1], axis=1)) / np.sqrt(n)
    return np.column_stack(
        [chi_square_tail(np.sum(residuals**2, axis=1), degrees), outlier, 2 * ndtr(-neighbours)]
    )
