"""Points that fill a cube evenly."""

import numpy as np

from femnl.core.readout import Array

ROUNDS = 40
"""Of the iteration for the ratio, which gains a digit in two of them."""


def spread(count: int, dimensions: int) -> Array:
    """Return points (count, dimensions) of the unit cube, one in each slice along each direction.

    Their order along a direction is that of multiples of g⁻ᵏ modulo 1, k = 1 … d, with
    g^(d + 1) = g + 1, the golden ratio of one dimension, so that neighbours in one are far apart in
    others.
    Source: M. Roberts, The unreasonable effectiveness of quasirandom sequences (2018).
    """
    ratio = 2.0
    for _ in range(ROUNDS):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    rank = np.argsort(np.argsort(np.outer(np.arange(count), steps) % 1, axis=0), axis=0)
    return np.asarray((rank + 0.5) / count)
