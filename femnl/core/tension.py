"""Changes of a film's tension as small matrices on its base modes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze

Array = NDArray[np.float64]

STRENGTHS = ("deviator", "shear", "x", "y", "bowl", "saddle", "product", "sides", "yielding")
"""What changes the tension, each by one number.

Of the film stress: deviator as ±1 in xx and yy; shear as 1 in xy; and as deposited, isotropic, and
relaxed: x, y, bowl x² + y², saddle x² − y², product xy, with x and y in units of the film's reach.
sides: u = ln(1 + e/2) of sides Lx eᵘ and Ly e⁻ᵘ; yielding: t of an edge that yields in the plane,
see `yielding`.
"""

YIELDS_MOST = 0.2
"""The largest compliance λ of an edge, in units of the film's reach."""
YIELDS_HALF = 0.15
"""λ at which t² = λ/(λ + this) is a half.

What an edge does is close to a polynomial in t from t² on; in λ it is not: singular stress at the
corners of the film gives broken powers.
"""


def yielding(compliance: float) -> float:
    """Return t of a compliance λ in units of the film's reach."""
    return float(np.sqrt(compliance / (compliance + YIELDS_HALF)))


def compliance_at(t: float) -> float:
    """Return the compliance λ, in units of the film's reach, of a t below 1."""
    return YIELDS_HALF * t**2 / (1 - t**2)


@dataclass(frozen=True)
class TensionChanges:
    """What changes of the tension add to K on the base modes: a polynomial in their strengths.

    ΔK = σ Σ_k Π_p s_p^powers[k, p] matrices[k], for s of `STRENGTHS`. The eigenvalues of K + ΔK are
    those of the film with the other tension, not only of that film within the span of the modes.

    powers (m, 9), each above 0 in some column; matrices (m, n, n) [m].
    """

    powers: NDArray[np.int64]
    matrices: Array

    def __post_init__(self) -> None:
        freeze(self)

    def __call__(self, strengths: Array) -> Array:
        """Return ΔK/σ (n, n) [m] at strengths (9,)."""
        acting = strengths != 0
        if not acting.any():
            return np.zeros(self.matrices.shape[1:])
        powers, matrices = self._among(acting)
        shape = self.matrices.shape[1:]
        factors = np.prod(strengths[acting] ** powers, axis=1)
        return np.asarray((factors @ matrices).reshape(shape))

    def _among(self, acting: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return the powers (k, n_acting) and matrices (k, n·n) of the acting strengths alone."""
        name = acting.tobytes()
        if name not in self._chosen:
            chosen = np.all(self.powers[:, ~acting] == 0, axis=1)
            size = self.matrices.shape[1] * self.matrices.shape[2]
            matrices = self.matrices[chosen].reshape(-1, size)
            self._chosen[name] = self.powers[chosen][:, acting].astype(float), matrices
        return self._chosen[name]

    @cached_property
    def _chosen(self) -> dict[bytes, tuple[Array, Array]]:
        """The terms of the strengths that have acted together, which a fit asks for again."""
        return {}


def strengths(changes: Mapping[str, float]) -> Array:
    """Return strengths (9,) in the order of `STRENGTHS`, those that are not named 0."""
    unknown = set(changes) - set(STRENGTHS)
    if unknown:
        raise KeyError(f"{', '.join(sorted(unknown))}: no change of the tension; {STRENGTHS}")
    return np.array([changes.get(name, 0.0) for name in STRENGTHS])
