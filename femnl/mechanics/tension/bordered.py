"""Forms on base modes and, beside them, on the unknowns of what changes make of them.

The unknowns are those of Lagrange elements on the mesh of the modes, of their degree or of a lower
one. The base modes stay as fine as they were solved, and so do all integrals: that lower elements
hold the responses alone is Ritz's method in a smaller space, in which a frequency errs by the
square of what the responses lack.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix

from femnl.core.modes import Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import Assembly
from femnl.mechanics.fem.reference import nodes, reference_basis

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Bordered:
    """A symmetric form [[corner, borderᵀ], [border, inner]].

    corner (n, n): on the base modes; inner (size, size): on the unknowns of responses; border
    (size, n): between them.
    """

    corner: Array
    border: Array
    inner: csc_matrix

    def __matmul__(self, vectors: Array) -> Array:
        """Return the form times vectors (n + size, m)."""
        modes = vectors[: len(self.corner)]
        rest = vectors[len(self.corner) :]
        upper = self.corner @ modes + self.border.T @ rest
        return np.concatenate([upper, self.border @ modes + self.inner @ rest])

    def __sub__(self, other: "Bordered") -> "Bordered":
        """Return the difference of two forms."""
        inner = csc_matrix(self.inner - other.inner)
        return Bordered(self.corner - other.corner, self.border - other.border, inner)

    def among(self, mine: Index, free: Index) -> "Bordered":
        """Return the form on some modes and some unknowns alone."""
        inner = csc_matrix(self.inner[free][:, free])
        return Bordered(self.corner[np.ix_(mine, mine)], self.border[np.ix_(free, mine)], inner)


class Responding:
    """Base modes with ∫ρhw² = 1 over the mesh, and Lagrange elements beside them.

    Args: modes; degree: of the elements, that of the modes or less.
    Attributes: n: number of modes; space: that of the elements.
    """

    def __init__(self, modes: Modes, degree: int) -> None:
        self._fine = Space(modes.domain.mesh, modes.degree)
        self.space = Space(modes.domain.mesh, degree)
        norm = np.sqrt(modes.effective_mass / modes.domain.copies)
        self._shapes = modes.shapes / norm[:, None]
        self.n = len(norm)
        # Without the rounding, which would fill the matrices
        self._carry = np.round(reference_basis(degree, nodes(modes.degree)), 12)

    @cached_property
    def _prolongation(self) -> csc_matrix:
        """Unknowns of the modes' elements from those of the responses, (fine size, size)."""
        shape = self._fine.size, self.space.size
        rows = np.broadcast_to(
            self._fine.dofs[:, :, None], (len(self._fine.dofs), *self._carry.shape)
        )
        columns = np.broadcast_to(self.space.dofs[:, None, :], rows.shape)
        places = rows.ravel(), columns.ravel()
        total, count = (
            csc_matrix(coo_matrix((np.broadcast_to(part, rows.shape).ravel(), places), shape=shape))
            for part in (self._carry, np.ones_like(self._carry))
        )
        # Triangles that share an unknown say the same of it
        total.data /= count.data
        total.eliminate_zeros()
        return total

    def of(self, matrix: csc_matrix) -> Bordered:
        """Return a form that is given on the elements of the modes."""
        pulled = matrix @ self._shapes.T
        carry = self._prolongation
        return Bordered(
            self._shapes @ pulled, carry.T @ pulled, csc_matrix(carry.T @ (matrix @ carry))
        )

    def gathering(self) -> "Gathering":
        """Return a sum, empty so far, of forms of single triangles."""
        return Gathering(self._fine, self.space, self._shapes, self._carry)


class Gathering:
    """A form gathered from those of triangles, without a matrix on the modes' elements."""

    def __init__(self, fine: Space, space: Space, shapes: Array, carry: Array) -> None:
        self._fine = fine
        self._space = space
        self._shapes = shapes
        self._carry = carry
        self._corner = np.zeros((len(shapes), len(shapes)))
        self._border = np.zeros((space.size, len(shapes)))
        self._inner = Assembly(space.size)

    def add(self, local: Array, triangles: slice) -> None:
        """Add forms (e, j, j) on the modes' elements of some triangles."""
        n = len(self._shapes)
        own = self._shapes[:, self._fine.dofs[triangles]].transpose(1, 2, 0)
        pulled = local @ own
        self._corner += own.reshape(-1, n).T @ pulled.reshape(-1, n)
        dofs = self._space.dofs[triangles]
        np.add.at(self._border, dofs, self._carry.T @ pulled)
        self._inner.add(self._carry.T @ local @ self._carry, dofs)

    def total(self) -> Bordered:
        """Return the sum."""
        return Bordered(self._corner, self._border, self._inner.matrix())
