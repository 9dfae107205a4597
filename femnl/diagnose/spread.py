"""Points that fill a cube evenly."""

import numpy as np

from femnl.core.readout import Array

ROUNDS = 40
"""Of the iteration for the ratio, which gains a digit in two of them."""


def spread(count: int, dimensions: int) -> Array:
    """Return points (count, dimensions) of the unit cube, one in each slice along each direction.

    A Latin hypercube: along direction k, point i is in the slice that i g⁻ᵏ modulo 1 has among all,
    where g^(d + 1) = g + 1, the golden ratio of one dimension. Neighbours along one direction are
    far apart along others.
    Source: M. Roberts, The unreasonable effectiveness of quasirandom sequences (2018).
    """
    ratio = 2.0
    for _ in range(ROUNDS):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    rank = np.argsort(np.argsort(np.outer(np.arange(count), steps) % 1, axis=0), axis=0)
    return np.asarray((rank + 0.5) / count)
