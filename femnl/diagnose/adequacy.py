"""Is a model adequate? One p-value for all score tests."""

import numpy as np
from scipy.stats import norm

from femnl.core.readout import Array
from femnl.diagnose.score_tests import ScoreTest, chi_square_tail
from femnl.fits.least_squares import FitResult

N_DRAWS = 4000
"""Simulated sets of residuals that calibrate the p-value."""
TAIL = 20
"""Simulated sets in the tail below which the p-value is extrapolated."""
CERTAIN = 1e-6
"""p-value, by Bonferroni's inequality, below which none is simulated."""
EXACT = 5000
"""Residuals up to which whole sets of them are drawn; beyond, only what tests see of them."""


def adequacy(result: FitResult, found: list[ScoreTest]) -> tuple[float, str]:
    """Return the calibrated p-value of a model, and the test that speaks most against it.

    The statistic is the smallest p-value of all tests: χ², every direction and effect, the largest
    outlier, and the correlation of neighbours. Its distribution follows from residuals simulated by
    the model itself: what white noise leaves beside the tangents.
    """
    seen = _p_values(result.residuals[None], result.degrees, found)[0]
    names = [*(test.name for test in found), "chi-square", "outlier", "neighbours"]
    k = int(np.argmin(seen))
    bound = float(seen[k]) * len(names)
    if bound < CERTAIN:
        return bound, names[k]
    rng = np.random.default_rng(20)
    drawn = (
        _simulated(result, found, rng)
        if len(result.residuals) <= EXACT
        else _simulated_large(result, found, rng)
    )
    smallest = np.sort(drawn.min(axis=1))
    below = int(np.searchsorted(smallest, seen[k], side="right"))
    if below >= TAIL:
        return below / N_DRAWS, names[k]
    # In the far tail the tests are as good as exclusive, so that p is proportional to the smallest
    # p-value.
    return float(min(1.0, seen[k] * TAIL / N_DRAWS / smallest[TAIL - 1])), names[k]


def _p_values(residuals: Array, degrees: int, found: list[ScoreTest]) -> Array:
    """Return the p-values of every test, (m, n_tests + 3).

    The last three are those of χ², of the largest outlier and of the neighbours' correlation.
    """
    n = residuals.shape[1]
    columns = [*_tested(residuals, found).T]
    columns.append(chi_square_tail(np.sum(residuals**2, axis=1), degrees))
    largest = np.abs(residuals).max(axis=1) * np.sqrt(n / degrees)
    # Data without noise: the logarithm of 0 is what it should be
    with np.errstate(divide="ignore"):
        columns.append(-np.expm1(n * np.log1p(-2 * norm.sf(largest))))
    neighbours = np.abs(np.sum(residuals[:, 1:] * residuals[:, :-1], axis=1)) / np.sqrt(n)
    columns.append(2 * norm.sf(neighbours))
    return np.stack(columns, axis=1)


def _tested(residuals: Array, found: list[ScoreTest]) -> Array:
    """Return the p-values (m, n_tests) of score tests alone."""
    if not found:
        return np.empty((len(residuals), 0))
    # In one product: a long row is read once for all tests
    squares = (residuals @ np.concatenate([test.basis for test in found]).T) ** 2
    sizes = np.array([len(test.basis) for test in found])
    return chi_square_tail(np.add.reduceat(squares, np.cumsum(sizes) - sizes, axis=1), sizes)


def _simulated(result: FitResult, found: list[ScoreTest], rng: np.random.Generator) -> Array:
    """Draw residuals as white noise beside the model's tangents, and test them.

    They are ranked as the data are.
    """
    own, _ = np.linalg.qr(result.jacobian[:, result.free])
    noise = rng.standard_normal((N_DRAWS, len(result.residuals)))
    for ranked in result.model.base_model.ranked:
        ranked.rank(result.residuals, noise)
    return _p_values(noise - (noise @ own) @ own.T, result.degrees, found)


def _simulated_large(result: FitResult, found: list[ScoreTest], rng: np.random.Generator) -> Array:
    """Return the same for long data, drawn in the space that the tests span.

    Outlier and neighbours are as good as independent of it.
    """
    basis = np.concatenate([test.basis for test in found])
    values, vectors = np.linalg.eigh(basis @ basis.T)
    kept = values > 1e-10
    drawn = rng.standard_normal((N_DRAWS, int(kept.sum())))
    squares = (drawn @ (vectors[:, kept] * np.sqrt(values[kept])).T) ** 2
    ends = np.cumsum([len(test.basis) for test in found])
    sizes = np.diff(ends, prepend=0)
    tested = chi_square_tail(np.add.reduceat(squares, ends - sizes, axis=1), sizes)
    total = np.sum(drawn**2, axis=1) + rng.chisquare(result.degrees - int(kept.sum()), N_DRAWS)
    return np.column_stack(
        [tested, chi_square_tail(total, result.degrees), rng.uniform(size=(N_DRAWS, 2))]
    )
