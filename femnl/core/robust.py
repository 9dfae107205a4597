"""Scatter that a few outliers do not change."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from femnl.core.errors import ConvergenceError

Array = NDArray[np.float64]

MAD = 1.482602218505602
"""Standard deviation of a normal distribution over its median absolute deviation."""


def least_absolute(columns: Array, data: Array) -> Array:
    """Return the absolute deviations (n,) of data (n,) from what fits most of them.

    That is columns (n, k) times the coefficients of the least sum of absolute deviations.

    Raises: ConvergenceError for numbers that are not finite or far out of proportion.
    """
    n, k = columns.shape
    each = np.eye(n)
    found = linprog(
        np.concatenate([np.zeros(k), np.ones(n)]),
        A_ub=np.block([[columns, -each], [-columns, -each]]),
        b_ub=np.concatenate([data, -data]),
        bounds=[(None, None)] * k + [(0, None)] * n,
    )
    if found.x is None:
        raise ConvergenceError(f"least absolute deviations of {n} numbers: {found.message}")
    return np.asarray(np.abs(data - columns @ found.x[:k]))
