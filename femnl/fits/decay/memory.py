"""The memory of the noise in what a fit of a decay leaves, by restricted likelihood."""

from itertools import product

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from femnl.observe.decay.law import Array

MOST_BLOCKS = 80
"""Blocks that residuals are averaged to: their covariance takes the cube of it."""
MEMORIES = np.geomspace(0.5, 0.5 * MOST_BLOCKS, 9)
"""Memories that are tried, in blocks: longer ones are bends."""
SHARES = (0.0, 0.3, 0.6, 0.8, 0.9, 0.97, 1.0)
"""Parts of the variance of a block that neighbours share, as tried."""
AKAIKE = 4.0
"""−2 ln of the likelihood that a memory, of two parameters, must be better by than none."""
SEEN = 1e-8
"""Part of the largest singular value from which on a direction of the fit is seen."""
EXACT = 1e-12
"""Squares of residuals below this are those of data that obey the law to rounding."""
OWN = 1e-6
"""Part of the variance that no neighbour shares at least, which keeps matrices definite."""


def block_means(values: Array, size: int) -> Array:
    """Return means (n_blocks, …) of values (n, …) over blocks; the last may be longer."""
    first = np.arange(len(values) // size) * size
    count = np.diff(np.append(first, len(values)))
    total = np.add.reduceat(values, first, axis=0)
    return np.asarray(total / count.reshape(-1, *[1] * (values.ndim - 1)))


def residual_covariance(residual: Array, design: Array) -> Array:
    """Return the covariance (n, n) of residuals (n,) that a fit has left.

    Of those that are tried, a white part and one that forgets as a process of Ornstein and
    Uhlenbeck, it is the likeliest one. Restricted likelihood counts what the fit has taken up,
    which makes residuals forget sooner than the noise does.
    Args: design (n, k): change of the residuals with each parameter of the fit.
    Source: Patterson and Thompson, Biometrika 58, 545 (1971).
    """
    basis, size, _ = np.linalg.svd(design, full_matrices=False)
    basis = basis[:, size > SEEN * size[0]]
    place = np.arange(len(residual))
    apart = np.abs(np.subtract.outer(place, place))
    lowest = np.inf
    likeliest = np.eye(len(residual))
    for memory, share in product(MEMORIES, SHARES):
        shape = share * np.exp(-apart / memory) + (1 - share + OWN) * np.eye(len(residual))
        cost, variance = _restricted(residual, basis, shape)
        cost += AKAIKE if share > 0 else 0.0
        if cost < lowest:
            lowest = cost
            likeliest = variance * shape
    return np.asarray(likeliest)


def _restricted(residual: Array, basis: Array, shape: Array) -> tuple[float, float]:
    """Return −2 ln of the restricted likelihood of a covariance up to its size, and that size."""
    factor = cho_factor(shape, lower=True)
    solved = cho_solve(factor, np.column_stack([basis, residual]))
    across = basis.T @ solved[:, :-1]
    beside = basis.T @ solved[:, -1]
    square = float(residual @ solved[:, -1] - beside @ np.linalg.solve(across, beside))
    square = max(square, EXACT)
    free = len(residual) - basis.shape[1]
    volume = 2 * float(np.sum(np.log(np.diag(factor[0])))) + float(np.linalg.slogdet(across)[1])
    return free * float(np.log(square)) + volume, square / free
