"""The Lagrange basis on the reference triangle, with all its derivatives.

The triangle and the order of its unknowns are those of scikit-fem.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Ends of the reference triangle's edges in scikit-fem's order. Vertices of every triangle are
# sorted, so that both neighbours walk a shared edge from its lower to its higher vertex.
EDGES = ((0, 1), (1, 2), (0, 2))
VERTICES = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


@cache
def _exponents(degree: int) -> NDArray[np.int64]:
    return np.array([(a, n - a) for n in range(degree + 1) for a in range(n, -1, -1)])


def _monomials(points: Array, degree: int, order: tuple[int, int]) -> Array:
    """Return ∂ₓᵃ∂ᵧᵇ of every monomial about the centroid at points (n, 2), for order (a, b).

    The shape is (n, n_monomials).
    """
    columns = []
    points = points - 1 / 3
    for axis in (0, 1):
        power = _exponents(degree)[:, axis]
        factor = np.ones(len(power))
        for step in range(order[axis]):
            factor = factor * (power - step)
        # Products one after the other: powers of arrays take ten times as long
        powers = np.vander(points[:, axis], degree + 1, increasing=True)
        columns.append(factor * powers[:, np.maximum(power - order[axis], 0)])
    return np.asarray(columns[0] * columns[1])


@cache
def nodes(degree: int) -> Array:
    """Return the points (n_basis, 2) of the reference triangle that carry the unknowns.

    Vertices first, then along each edge from its lower to its higher vertex, then inside.
    """
    along = np.arange(1, degree)[:, None] / degree
    edges = [VERTICES[a] + along * (VERTICES[b] - VERTICES[a]) for a, b in EDGES]
    inside = [(i / degree, j / degree) for j in range(1, degree) for i in range(1, degree - j)]
    return np.concatenate([VERTICES, *edges, np.array(inside).reshape(-1, 2)])


@cache
def _coefficients(degree: int) -> Array:
    return np.asarray(np.linalg.inv(_monomials(nodes(degree), degree, (0, 0))))


def reference_basis(degree: int, points: Array, order: tuple[int, int] = (0, 0)) -> Array:
    """Return ∂ₓᵃ∂ᵧᵇ φ_j of the Lagrange basis at reference points (n, 2), (n, n_basis)."""
    return np.asarray(_monomials(points, degree, order) @ _coefficients(degree))
