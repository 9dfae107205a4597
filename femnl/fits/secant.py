"""Derivatives of residuals at a new place, told by the step that led there."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array

STRAIGHT = 0.02
"""Part of the change of the residuals that derivatives may miss to be carried on."""
ALL = slice(None)
MANY = 200
"""Residuals from which on an evaluation costs more than carrying derivatives on."""


class Place(NamedTuple):
    """Parameters (p,), the residuals (n,) there and their derivatives (n, p)."""

    vector: Array
    residuals: Array
    slopes: Array


def carried_on(
    last: Place, vector: Array, residuals: Array, fitted: slice | NDArray[np.bool_] = ALL
) -> Array | None:
    """Return derivatives (n, p) at a new place, which follow from those at the last one.

    J + (Δr − J s) (Ws)ᵀ/(sᵀWs) changes J least such that the step s makes the change Δr of the
    residuals (C. G. Broyden, Math. Comput. 19, 577 (1965)). W, the squares of the columns of J,
    makes parameters of any units comparable.

    Args: last: the last place. vector, residuals: at the new one. fitted: those that are fitted,
        which alone tell whether the way is straight.
    Returns: None where the residuals changed otherwise than by J s, or are few.
    """
    step = vector - last.vector
    change = residuals - last.residuals
    size = np.linalg.norm(change[fitted])
    if len(change[fitted]) < MANY or size == 0:
        return None
    missed = change - last.slopes @ step
    if not np.linalg.norm(missed[fitted]) <= STRAIGHT * size:
        return None
    columns = last.slopes[fitted]
    weighed = np.einsum("ij,ij->j", columns, columns) * step
    # Of columns that lie side by side, as those by differences
    return np.asarray(last.slopes + np.outer(weighed / (weighed @ step), missed).T)
