"""Lagrange elements of degree 1 to 6 on curved triangles, with first and second derivatives.

Numbering of unknowns and reference triangle are scikit-fem's; the tables here add the degrees and
the second derivatives that its H1 elements lack, with the curvature of the mapping included, for
whole meshes at once. An edge between films or at their end whose middle lies beside its chord is an
arc of a circle and is followed by a map of degree 4, so that geometry costs no accuracy.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_jacobi
from skfem import ElementH1, MeshTri2
from skfem.assembly import Dofs
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine, RefTri

from femnl.core.errors import ParameterError
from femnl.mechanics.fem.reference import EDGES, VERTICES, nodes, reference_basis

Array = NDArray[np.float64]

DEGREES = (1, 2, 3, 4, 5, 6)
ARC_DEGREE = 4  # of the map of triangles beside an arc
TABULATED = 19  # highest order of scikit-fem's quadrature on triangles

FIRST = ((1, 0), (0, 1))
STRAIGHT = 1e-7  # sagitta over chord up to which an edge is straight


def _numbering(mesh: MeshTri2, degree: int) -> Dofs:
    """Return scikit-fem's numbering of the unknowns: of vertices, then of edges, then inside."""
    element = ElementH1()
    element.refdom = RefTri
    element.nodal_dofs = 1
    element.facet_dofs = degree - 1
    element.interior_dofs = (degree - 1) * (degree - 2) // 2
    return Dofs(mesh, element)


@dataclass(frozen=True)
class Jet:
    """Basis functions of some triangles at some points, up to second derivatives in x and y.

    value (e, q, j); gradient (e, q, 2, j); hessian (e, q, 3, j) as (∂xx, ∂yy, ∂xy), no rows unless
    asked for; point (e, q, 2) [m]; jacobian (e, q, 2, 2) = ∂x_a/∂X_b.
    """

    value: Array
    gradient: Array
    hessian: Array
    point: Array
    jacobian: Array


def _inverse(matrices: Array) -> Array:
    """Return inverses of matrices (..., 2, 2)."""
    (a, b), (c, d) = np.moveaxis(matrices, (-2, -1), (0, 1))
    return np.asarray(np.moveaxis(np.array([[d, -b], [-c, a]]) / (a * d - b * c), (0, 1), (-2, -1)))


def _along_arcs(start: Array, end: Array, sagitta: Array, fraction: Array) -> Array:
    """Return points (f, n, 2) at fractions (f,) of the angle of arcs (n, 2).

    The middle of an arc lies `sagitta` from that of its chord.
    """
    chord = end - start
    height = np.linalg.norm(sagitta, axis=1)
    half = 2 * np.arctan(2 * height / np.linalg.norm(chord, axis=1))
    angle = np.multiply.outer(2 * fraction - 1, half)
    along = np.sin(angle) / np.sin(half)
    rise = 1 - 2 * np.sin(angle / 2) ** 2 / (1 - np.cos(half))
    return np.asarray((start + end) / 2 + along[..., None] * chord / 2 + rise[..., None] * sagitta)


def _conical(n: int) -> tuple[Array, Array]:
    """Stroud's conical product of Gauss rules, exact to order 2n − 1 on the reference triangle."""
    (along, first) = roots_jacobi(n, 1, 0)
    (across, second) = roots_jacobi(n, 0, 0)
    x, y = np.meshgrid((along + 1) / 2, (across + 1) / 2, indexing="ij")
    return np.stack([x.ravel(), ((1 - x) * y).ravel()], 1), np.outer(first, second).ravel() / 8


def _by_triangle(numbering: Dofs) -> NDArray[np.int64]:
    return np.asarray(numbering.element_dofs, dtype=np.int64).T


class Space:
    """Scalar Lagrange functions of one degree on a mesh: numbering of unknowns and evaluation.

    Args: mesh: quadratic triangles with sorted vertices. degree: 1 to 6.
    Attributes: dofs (e, n_basis) unknowns of each triangle; size their number; location (size, 2)
    [m].
    """

    def __init__(self, mesh: MeshTri2, degree: int) -> None:
        if degree not in DEGREES:
            raise ParameterError(f"degree = {degree}: expected {DEGREES[0]} to {DEGREES[-1]}")
        self.mesh = mesh
        self.degree = degree
        self._numbering = _numbering(mesh, degree)
        self.dofs = _by_triangle(self._numbering)
        self.size = int(self._numbering.N)

    @cached_property
    def location(self) -> Array:
        """Where the unknowns are, (size, 2) [m]."""
        location = np.empty((self.size, 2))
        location[self.dofs] = reference_basis(self.map_degree, nodes(self.degree)) @ self.map_nodes
        return location

    @cached_property
    def map_degree(self) -> int:
        """Polynomial degree of the map from the reference triangle.

        2, or up to `ARC_DEGREE` where a boundary is curved.
        """
        return min(max(self.degree, 2), ARC_DEGREE) if np.any(self._boundary[-1]) else 2

    @cached_property
    def map_nodes(self) -> Array:
        """Nodes (e, n, 2) [m] of the polynomial map from the reference triangle to each.

        It has the degree `map_degree`.
        """
        degree = self.map_degree
        second = self.dofs if self.degree == 2 else _by_triangle(_numbering(self.mesh, 2))
        place = np.asarray(self.mesh.doflocs).T[second]
        if degree > 2:
            numbering = self._numbering if self.degree == degree else _numbering(self.mesh, degree)
            dofs = _by_triangle(numbering)
            shared = np.empty((int(numbering.N), 2))
            shared[dofs] = reference_basis(2, nodes(degree)) @ place
            facets, start, end, sagitta, arcs = self._boundary
            on_arc = np.asarray(numbering.facet_dofs)[:, facets[arcs]]
            shared[on_arc] = _along_arcs(
                start[arcs], end[arcs], sagitta[arcs], np.arange(1, degree) / degree
            )
            place = shared[dofs]
        return place

    @property
    def arc_nodes(self) -> Array:
        """Nodes (n, 2) [m] between the ends of the curved edges where a film ends."""
        _, start, end, sagitta, arcs = self._boundary
        places = np.arange(1, ARC_DEGREE) / ARC_DEGREE
        return _along_arcs(start[arcs], end[arcs], sagitta[arcs], places).reshape(-1, 2)

    @cached_property
    def least_determinant(self) -> Array:
        """Return the smallest |det ∂x/∂X| [m²] of each triangle's map, (e,).

        It is sought at points along its edges and inside.
        """
        points = nodes(6)
        determinants = [
            np.abs(self.determinant(slice(k, k + 2000), points)).min(axis=1)
            for k in range(0, len(self.dofs), 2000)
        ]
        return np.concatenate(determinants)

    @cached_property
    def _boundary(self) -> tuple[NDArray[np.int64], Array, Array, Array, NDArray[np.bool_]]:
        """Return the facets where a film ends, their two ends, their sagitta, and which are arcs.

        The sagitta (n, 2) [m] is how far the middle of a facet lies off its chord.
        """
        mesh = self.mesh
        ends = mesh.f2t[1] < 0
        if mesh.subdomains:  # two films meet, too
            kind = np.zeros(mesh.nelements, dtype=np.int64)
            for k, members in enumerate(mesh.subdomains.values()):
                kind[members] += 1 << k
            ends |= kind[mesh.f2t[0]] != kind[mesh.f2t[1]]
        facets = np.flatnonzero(ends)
        start, end = (mesh.doflocs[:, mesh.facets[k, facets]].T for k in (0, 1))
        sagitta = mesh.doflocs[:, mesh.nvertices + facets].T - (start + end) / 2
        return (
            facets,
            start,
            end,
            sagitta,
            np.linalg.norm(sagitta, axis=1) > STRAIGHT * np.linalg.norm(end - start, axis=1),
        )

    def boundary_facets(self, name: str) -> NDArray[np.int64]:
        """Return facets on the named boundary; empty where the mesh has no such boundary."""
        return np.asarray((self.mesh.boundaries or {}).get(name, ()), dtype=np.int64)

    def boundary_dofs(self, name: str) -> NDArray[np.int64]:
        """Return unknowns on the named boundary; empty where the mesh has no such boundary."""
        facets = self.boundary_facets(name)
        ends = np.asarray(self._numbering.nodal_dofs)[0, np.unique(self.mesh.facets[:, facets])]
        between = (
            np.asarray(self._numbering.facet_dofs)[:, facets].ravel()
            if self.degree > 1
            else ends[:0]
        )
        return np.concatenate([ends, between]).astype(np.int64)

    def facet_unknowns(self, facet: int) -> NDArray[np.int64]:
        """Return unknowns on one facet: its ends, lower vertex first, then those between."""
        numbering = self._numbering
        ends = np.asarray(numbering.nodal_dofs)[0, self.mesh.facets[:, facet]]
        return np.concatenate([ends, np.asarray(numbering.facet_dofs)[:, facet]]).astype(np.int64)

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return points (q, 2) and weights (q,) on the reference triangle, exact to an order."""
        if order > TABULATED:
            return _conical(order // 2 + 1)
        points, weights = get_quadrature(RefTri, order)
        return np.asarray(points).T, np.asarray(weights)

    def measure(self, triangles: NDArray[np.int64] | slice, points: Array) -> tuple[Array, Array]:
        """Return where reference points (q, 2) lie, (e, q, 2) [m], and |det ∂x/∂X|, (e, q) [m²]."""
        place = reference_basis(self.map_degree, points) @ self.map_nodes[triangles]
        return place, np.abs(self.determinant(triangles, points))

    def determinant(self, triangles: NDArray[np.int64] | slice, points: Array) -> Array:
        """Return det ∂x/∂X (e, q) [m²] at reference points (q, 2)."""
        place = self.map_nodes[triangles]
        first, second = (reference_basis(self.map_degree, points, d) @ place for d in FIRST)
        return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])

    def jet(self, triangles: NDArray[np.int64] | slice, points: Array, second: bool = False) -> Jet:
        """Evaluate on the given triangles at reference points (q, 2); see `Jet`."""
        place = self.map_nodes[triangles]
        gradient_ref = np.stack([reference_basis(self.degree, points, d) for d in FIRST])
        jacobian = np.stack(
            [reference_basis(self.map_degree, points, d) @ place for d in FIRST], -1
        )
        inverse = _inverse(jacobian)  # inverse[b, x] = ∂X_b/∂x
        gradient = np.einsum("eqbx,bqj->eqxj", inverse, gradient_ref, optimize=True)
        hessian = self._hessian(points, place, inverse, gradient) if second else gradient[:, :, :0]
        value = np.broadcast_to(
            reference_basis(self.degree, points), (len(place), len(points), self.dofs.shape[1])
        )
        point = reference_basis(self.map_degree, points) @ place
        return Jet(value, gradient, hessian, point, jacobian)

    def _hessian(self, points: Array, place: Array, inverse: Array, gradient: Array) -> Array:
        """Return ∂²φ/∂x² = J⁻ᵀ (∂²φ/∂X² − Σ_x ∂φ/∂x ∂²x/∂X²) J⁻¹, as (∂xx, ∂yy, ∂xy)."""
        orders = ((2, 0), (0, 2), (1, 1))
        basis = np.stack([reference_basis(self.degree, points, d) for d in orders])
        bend = np.stack(
            [reference_basis(self.map_degree, points, d) @ place for d in orders], axis=2
        )
        raw = basis.transpose(1, 0, 2)[None] - np.einsum(
            "eqcx,eqxj->eqcj", bend, gradient, optimize=True
        )
        # ∂X/∂(x, y), ∂Y/∂(x, y)
        a = inverse[:, :, 0, :]
        b = inverse[:, :, 1, :]
        pairs = ((0, 0), (1, 1), (0, 1))
        turn = np.stack(
            [
                np.stack(
                    [
                        a[..., i] * a[..., j],
                        b[..., i] * b[..., j],
                        a[..., i] * b[..., j] + a[..., j] * b[..., i],
                    ],
                    -1,
                )
                for i, j in pairs
            ],
            axis=2,
        )
        return np.asarray(turn @ raw)

    def prolong(self, values: Array, finer: "Space") -> Array:
        """Carry functions (n, size) to a higher degree on the same mesh.

        Exact, since the spaces are nested.
        """
        carried = np.zeros((len(values), finer.size))
        carried[:, finer.dofs] = (
            values[:, self.dofs] @ reference_basis(self.degree, nodes(finer.degree)).T
        )
        return carried

    def edge_points(self, edge: int, order: int) -> tuple[Array, Array]:
        """Points (q, 2) on one edge of the reference triangle and their weights (q,) on [0, 1]."""
        parameter, weights = get_quadrature(RefLine, order)
        start = VERTICES[EDGES[edge][0]]
        end = VERTICES[EDGES[edge][1]]
        return start + np.asarray(parameter).T * (end - start), np.asarray(weights)
