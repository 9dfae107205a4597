"""Bessel functions of many orders as cubics between even nodes."""

from functools import lru_cache

import numpy as np

from femnl.core.compiled import compiled
from femnl.core.readout import Array

NODES = 32
"""Nodes a unit of z at which Bessel functions are tabulated; the interpolation errs by less than
1e-8.
"""
SHORTEST = 32
"""Least z up to which a table goes; longer ones go twice as far each."""
ABOVE = 40
STEEP = 12.0
"""Orders above both z and the highest one, and times ∛z, from which the recurrence comes down:
there J_n is below 1e-20 of its largest value.
"""
LARGE = 1e150
"""Size from which on what the recurrence has found is scaled down."""


def bessel_table(harmonic: tuple[int, ...], reach: float) -> Array:
    """Return the coefficients of J_n between nodes up to z = reach at least.

    Lowest power first, (n_nodes, n_harmonics, 4).
    """
    doublings = int(np.ceil(np.log2(max(reach, SHORTEST) / SHORTEST) + 1e-9))
    return _tabulated(harmonic, SHORTEST * 2**doublings)


@lru_cache(maxsize=4)
def _tabulated(harmonic: tuple[int, ...], longest: int) -> Array:
    found = np.empty((longest * NODES + 1, len(harmonic), 4))
    room = np.empty(max(harmonic) + 2)
    compiled(_fill)(found, room, np.array(harmonic, np.int64), 1 / NODES)
    return found


def _fill(found: Array, room: Array, harmonic: Array, step: float) -> None:
    """Write the cubics (n, n_harmonics, 4) that have the values and slopes of J_n at the nodes.

    J_n′ = (J_{n−1} − J_{n+1})/2 (DLMF 10.6.1), J_{−1} = −J₁.

    Args: room (highest + 2,): for the functions at one node. step: between nodes.
    """
    for i in range(len(found) + 1):
        _bessel(room, i * step)
        for h in range(len(harmonic)):
            n = harmonic[h]
            value = room[n]
            before = room[n - 1] if n > 0 else -room[1]
            slope = (before - room[n + 1]) / 2 * step
            if i < len(found):
                found[i, h, 0] = value
                found[i, h, 1] = slope
            if i > 0:
                left = found[i - 1, h]
                rise = value - left[0]
                left[2] = 3 * rise - 2 * left[1] - slope
                left[3] = left[1] + slope - 2 * rise


def _bessel(found: Array, z: float) -> None:
    """Write J_n(z) (m,), n = 0 … m − 1, by Miller's backward recurrence.

    J_{n−1} = (2n/z) J_n − J_{n+1}, scaled to J₀ + 2 Σ J_{2k} = 1.

    Source: F. W. J. Olver, NIST Handbook (2010), 3.6(vi) and 10.74(iv).
    """
    found[:] = 0.0
    if z == 0:
        found[0] = 1.0
        return
    here = 1e-300
    above = 0.0
    total = 0.0
    for n in range(max(len(found), int(z + STEEP * np.cbrt(z))) + ABOVE, 0, -1):
        if n < len(found):
            found[n] = here
        if n % 2 == 0:
            total += 2 * here
        below = 2 * n / z * here - above
        above = here
        here = below
        if abs(here) > LARGE:
            here /= LARGE
            above /= LARGE
            total /= LARGE
            found /= LARGE
    found[0] = here
    found /= total + here
