"""Lowest eigenvalues of a pencil, with every copy of those that are shared.

As waves at the corners of the irreducible part share theirs.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import csc_matrix

from femnl.core.errors import ConvergenceError
from femnl.mechanics.fem.solvers import factorize

Array = NDArray[np.float64]

ROUNDS = 100
SETTLED = 1e-11  # of the highest eigenvalue asked for, by which they may change from round to round


def lowest_eigenvalues(stiffness: csc_matrix, mass: csc_matrix, count: int) -> Array:
    """Return λ (count,) of K x = λ M x, rising, K and M positive definite, by subspace iteration.

    A Lanczos iteration from one vector, as `lowest_eigenpairs` has, finds one eigenvector of each
    eigenvalue, and others by rounding alone; a block finds as many as it has columns. K is never
    multiplied by: its large entries would drown the longest waves.

    Raises: ConvergenceError naming the setting.
    Source: Bathe, Finite Element Procedures (1996), section 11.6.
    """
    n = stiffness.shape[0]
    columns = 2 * count + 8
    if columns >= n:
        raise ConvergenceError(
            f"{count} bands were asked of a cell with {n} unknowns: ask for fewer bands or raise "
            "the resolution"
        )
    solve = factorize(stiffness)
    last = np.zeros(count)
    # A fixed start makes reruns identical
    load = mass @ np.random.default_rng(0).standard_normal((n, columns))
    for _ in range(ROUNDS):
        moved = solve(load)
        inertia = mass @ moved
        values, turn = eigh(moved.T @ load, moved.T @ inertia)
        if np.all(np.abs(values[:count] - last) <= SETTLED * values[count - 1]):
            return np.asarray(values[:count])
        last = values[:count]
        load = inertia @ turn
    raise ConvergenceError(
        f"the lowest {count} frequencies of the cell did not converge: ask for fewer bands or "
        "raise the resolution"
    )
