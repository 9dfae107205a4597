"""A score test: one direction in which residuals may deviate, and what going there gains."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, erfc

from femnl.core.effect import Effect
from femnl.core.readout import Array
from femnl.fits.least_squares import LONG

VISIBLE = 1e-6
"""Part of an effect's tangent that must be left beside the model's own for the data to see it."""


@dataclass(frozen=True)
class ScoreTest:
    """One direction (or a few) in which residuals may deviate.

    Gain in χ² from going there, its p-value, and where a fit would start.

    effect: None for a pattern. basis (q, n): orthonormal, free of the model's tangents, in single
    precision where it is long (`stored`); without rows once nobody asks for it. square: χ² of the
    residuals along it, of so many degrees of freedom. values: linear estimate of the effect.
    """

    name: str
    effect: Effect | None
    basis: NDArray[np.floating]
    square: float
    degrees: int
    gain: float
    values: dict[str, float]

    @cached_property
    def p_value(self) -> float:
        """Probability of a larger χ² along the directions by chance."""
        return float(chi_square_tail(np.array(self.square), self.degrees))

    @property
    def whole(self) -> list[float]:
        """Values of those parameters that are whole numbers."""
        return [
            self.values[spec.name]
            for spec in (self.effect.parameters if self.effect else ())
            if spec.whole
        ]

    def without_basis(self, count: int) -> "ScoreTest":
        """Return the same test without its directions, which take all of its memory.

        Args: count: residuals of which it is one test, of all data or of a part of them.
        """
        return replace(self, basis=np.empty((0, count), self.basis.dtype))


def stored(basis: Array) -> NDArray[np.floating]:
    """Return a basis as a test keeps it.

    Hundreds of tests of a large map would take half a gigabyte. In single precision squares along
    directions are right to 1e-7 of χ².
    """
    return basis.astype(np.float32) if basis.shape[1] > LONG else basis


def left_beside(own: Array, tangents: Array) -> Array:
    """Return what of tangents (k, n) a model's own, orthonormal (n, p), do not reach."""
    return np.asarray(tangents - (tangents @ own) @ own.T)


def basis_of(free: Array, tangents: Array) -> Array:
    """Return an orthonormal basis (q, n) of what is left of tangents (k, n), where it is visible.

    Args: free (k, n): what is left of each.
    """
    size = np.linalg.norm(tangents, axis=1, keepdims=True)
    unit = free / np.where(size > 0, size, 1)
    # By their products: a decomposition of so long rows takes longer than the predictions
    square, turned = np.linalg.eigh(unit @ unit.T)
    visible = square > VISIBLE
    return np.asarray((turned[:, visible] / np.sqrt(square[visible])).T @ unit)


def chi_square_tail(square: Array, degrees: int) -> Array:
    """Return the probability of a larger χ², by closed forms where there are any."""
    if degrees == 1:
        return np.asarray(erfc(np.sqrt(square / 2)))
    return np.asarray(np.exp(-square / 2) if degrees == 2 else chdtrc(degrees, square))
