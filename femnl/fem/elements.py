"""Lagrange elements of degree 1 to 4 on curved triangles, evaluated with first and second derivatives.

Numbering of unknowns, reference triangle and quadrature are scikit-fem's; the tables here add the second derivatives that
its H1 elements lack, with the curvature of the mapping included, for whole meshes at once.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from skfem import ElementTriP1, ElementTriP2, ElementTriP3, ElementTriP4, MeshTri2
from skfem.assembly import Dofs
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine, RefTri

from femnl.errors import ParameterError

Array = NDArray[np.float64]

ELEMENTS = {1: ElementTriP1, 2: ElementTriP2, 3: ElementTriP3, 4: ElementTriP4}
DEGREES = tuple(ELEMENTS)

# Ends of the reference triangle's edges in scikit-fem's order. Vertices of every triangle are sorted, so that
# both neighbours walk a shared edge from its lower to its higher vertex.
EDGES = ((0, 1), (1, 2), (0, 2))
VERTICES = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


@cache
def _exponents(degree: int) -> NDArray[np.int64]:
    return np.array([(a, n - a) for n in range(degree + 1) for a in range(n, -1, -1)])


def _monomials(points: Array, degree: int, order: tuple[int, int]) -> Array:
    """∂ₓᵃ∂ᵧᵇ of every monomial at points (n, 2), for order (a, b); shape (n, n_monomials)."""
    columns = []
    for axis in (0, 1):
        power = _exponents(degree)[:, axis]
        factor = np.ones(len(power))
        for step in range(order[axis]):
            factor = factor * (power - step)
        columns.append(factor * points[:, axis, None] ** np.maximum(power - order[axis], 0))
    return np.asarray(columns[0] * columns[1])


def nodes(degree: int) -> Array:
    """Return the points (n_basis, 2) of the reference triangle to which the unknowns of the Lagrange element belong."""
    return np.asarray(ELEMENTS[degree].doflocs, dtype=float)


@cache
def _coefficients(degree: int) -> Array:
    return np.asarray(np.linalg.inv(_monomials(nodes(degree), degree, (0, 0))))


def reference_basis(degree: int, points: Array, order: tuple[int, int] = (0, 0)) -> Array:
    """Return ∂ₓᵃ∂ᵧᵇ φ_j of the Lagrange basis on the reference triangle at points (n, 2), shape (n, n_basis)."""
    return np.asarray(_monomials(points, degree, order) @ _coefficients(degree))


@dataclass(frozen=True)
class Jet:
    """Basis functions of some triangles at some points, up to second derivatives in x and y.

    value (e, q, j); gradient (e, q, 2, j); hessian (e, q, 3, j) as (∂xx, ∂yy, ∂xy), no rows unless asked for;
    point (e, q, 2) [m]; jacobian (e, q, 2, 2) = ∂x_a/∂X_b.
    """

    value: Array
    gradient: Array
    hessian: Array
    point: Array
    jacobian: Array


def _by_triangle(numbering: Dofs) -> NDArray[np.int64]:
    return np.asarray(numbering.element_dofs, dtype=np.int64).T


class Space:
    """Scalar Lagrange functions of one degree on a mesh: numbering of unknowns and evaluation.

    Args: mesh: quadratic triangles with sorted vertices. degree: 1 to 4.
    Attributes: dofs (e, n_basis) unknowns of each triangle; size their number; location (size, 2) [m].
    """

    def __init__(self, mesh: MeshTri2, degree: int) -> None:
        if degree not in ELEMENTS:
            raise ParameterError(f"degree = {degree}: expected {DEGREES[0]} to {DEGREES[-1]}")
        self.mesh = mesh
        self.degree = degree
        self._numbering = Dofs(mesh, ELEMENTS[degree]())
        self.dofs = _by_triangle(self._numbering)
        self.size = int(self._numbering.N)
        self._nodes = np.asarray(mesh.doflocs).T[_by_triangle(Dofs(mesh, ElementTriP2()))]
        self.location = np.empty((self.size, 2))
        self.location[self.dofs] = np.einsum("qj,ejx->eqx", reference_basis(2, nodes(degree)), self._nodes)

    def boundary_facets(self, name: str) -> NDArray[np.int64]:
        """Facets on the named boundary; empty where the mesh has no such boundary."""
        return np.asarray((self.mesh.boundaries or {}).get(name, ()), dtype=np.int64)

    def boundary_dofs(self, name: str) -> NDArray[np.int64]:
        """Unknowns on the named boundary; empty where the mesh has no such boundary."""
        facets = self.boundary_facets(name)
        return np.asarray(self._numbering.get_facet_dofs(facets).flatten(), dtype=np.int64)

    def facet_unknowns(self, facet: int) -> NDArray[np.int64]:
        """Unknowns on one facet: its two ends, lower vertex first, then those between them in the same direction."""
        numbering = self._numbering
        ends = np.asarray(numbering.nodal_dofs)[0, self.mesh.facets[:, facet]]
        return np.concatenate([ends, np.asarray(numbering.facet_dofs)[:, facet]]).astype(np.int64)

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Points (q, 2) and weights (q,) on the reference triangle, exact to the given polynomial order."""
        points, weights = get_quadrature(RefTri, order)
        return np.asarray(points).T, np.asarray(weights)

    def jet(self, triangles: NDArray[np.int64] | slice, points: Array, second: bool = False) -> Jet:
        """Evaluate on the given triangles at reference points (q, 2); see `Jet`."""
        nodes = self._nodes[triangles]
        gradient_ref = np.stack([reference_basis(self.degree, points, d) for d in ((1, 0), (0, 1))])
        map_ref = np.stack([reference_basis(2, points, d) for d in ((1, 0), (0, 1))])
        jacobian = np.einsum("bqj,ejx->eqxb", map_ref, nodes)
        inverse = np.linalg.inv(jacobian)  # inverse[b, x] = ∂X_b/∂x
        gradient = np.einsum("eqbx,bqj->eqxj", inverse, gradient_ref, optimize=True)
        hessian = self._hessian(points, nodes, inverse, gradient) if second else gradient[:, :, :0]
        value = np.broadcast_to(reference_basis(self.degree, points), (len(nodes), len(points), self.dofs.shape[1]))
        point = np.einsum("qj,ejx->eqx", reference_basis(2, points), nodes)
        return Jet(value, gradient, hessian, point, jacobian)

    def _hessian(self, points: Array, nodes: Array, inverse: Array, gradient: Array) -> Array:
        """∂²φ/∂x² = J⁻ᵀ (∂²φ/∂X² − Σ_x ∂φ/∂x ∂²x/∂X²) J⁻¹, as (∂xx, ∂yy, ∂xy)."""
        orders = ((2, 0), (0, 2), (1, 1))
        basis = np.stack([reference_basis(self.degree, points, d) for d in orders])
        bend = np.einsum("cqj,ejx->eqcx", np.stack([reference_basis(2, points, d) for d in orders]), nodes)
        raw = basis.transpose(1, 0, 2)[None] - np.einsum("eqcx,eqxj->eqcj", bend, gradient, optimize=True)
        a, b = inverse[:, :, 0, :], inverse[:, :, 1, :]  # ∂X/∂(x, y), ∂Y/∂(x, y)
        pairs = ((0, 0), (1, 1), (0, 1))
        turn = np.stack(
            [np.stack([a[..., i] * a[..., j], b[..., i] * b[..., j], a[..., i] * b[..., j] + a[..., j] * b[..., i]], -1) for i, j in pairs],
            axis=2,
        )
        return np.asarray(turn @ raw)

    def prolong(self, values: Array, finer: "Space") -> Array:
        """Carry functions (n, size) to a higher degree on the same mesh; exact, since the spaces are nested."""
        carried = np.zeros((len(values), finer.size))
        carried[:, finer.dofs] = values[:, self.dofs] @ reference_basis(self.degree, nodes(finer.degree)).T
        return carried

    def edge_points(self, edge: int, order: int) -> tuple[Array, Array]:
        """Points (q, 2) on one edge of the reference triangle and their weights (q,) on [0, 1]."""
        parameter, weights = get_quadrature(RefLine, order)
        start, end = VERTICES[EDGES[edge][0]], VERTICES[EDGES[edge][1]]
        return start + np.asarray(parameter).T * (end - start), np.asarray(weights)
