"""One strain energy of a stressed plate, and the weak forms that follow from it.

    W(u, w) = ∫ h [σ₀ tr E + ½ E : C E] + (h³/24) κ : C κ,   E = ε(u) + ½ ∇w⊗∇w,   κ = ∇∇w

Every form below is ∫ B(v)ᵀ C B(w): a strain operator B, one row per component, and its moduli C.
Symmetric tensors are vectors (xx, yy, 2xy) for strains and (xx, yy, xy) for stresses. What keeps
slopes continuous across edges is in `interior_penalty`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix
from scipy.spatial import cKDTree

from femnl.core.device import Film, Model
from femnl.mechanics.fem.elements import Jet, Space

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Strain = Callable[[Jet], Array]

# Orders of quadrature that a film with a taper takes beyond those that its elements ask for
KINKED = 8
SUMMED = 4_000_000  # entries of a matrix that are held before equal places are summed
SHAPES = 16  # of which energies are integrated at a time, which bounds the memory likewise
CHUNK = 2000  # triangles evaluated at a time, which bounds the memory of a mesh of any size


def plane_stress(young: float, poisson: float) -> Array:
    """Return C of σ = C ε in plane stress, (3, 3) [Pa]."""
    nu = poisson
    return young / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])


def thickness(model: Model, point: Array) -> Array:
    """Return the thickness h(x) [m] of the suspended film at points (..., 2).

    Graded as deposited, thinned from below towards the holes.
    """
    film: Film = model.film
    h = film.thickness + point @ np.asarray(film.gradient)
    if film.taper > 0:
        gaps = [np.asarray(cKDTree(h.centres).query(point)[0]) for h in model.etched_from]
        radii = [h.radius for h in model.etched_from]
        rim = np.min([gap - radius for gap, radius in zip(gaps, radii, strict=True)], axis=0)
        h = h - film.taper * np.clip(1 - rim / film.taper_length, 0, 1)
    return np.asarray(h)


def quadrature_order(model: Model, order: int) -> int:
    """Return the order by which polynomials of the given one are integrated over a film.

    Beyond it where a taper's foot kinks the thickness.

    The foot runs through triangles. By as few points as a smooth film takes, it costs up to 2e-5 of
    a frequency, much the same in all degrees, so that their differences do not show it.
    """
    return order + KINKED if model.film.taper > 0 else order


def deflection(jet: Jet) -> Array:
    """Return w, as one row."""
    return jet.value[:, :, None, :]


def slope(jet: Jet) -> Array:
    """Return ∇w, rows (x, y)."""
    return jet.gradient


def curvature(jet: Jet) -> Array:
    """Return κ = ∇∇w, rows (xx, yy, 2xy)."""
    return np.asarray(jet.hessian * np.array([1.0, 1.0, 2.0])[:, None])


def in_plane_strain(jet: Jet) -> Array:
    """Return ε(u) of u = (u_x, u_y), rows (xx, yy, 2xy); columns all of u_x, then all of u_y."""
    dx = jet.gradient[:, :, 0]
    dy = jet.gradient[:, :, 1]
    zero = np.zeros_like(dx)
    rows = [np.concatenate(pair, -1) for pair in ((dx, zero), (zero, dy), (dy, dx))]
    return np.stack(rows, axis=2)


def stretch(first: Array, second: Array) -> Array:
    """Return ½ sym(∇a⊗∇b) of slopes (..., 2), as a strain (xx, yy, 2xy).

    The second-order strain that deflections cause.
    """
    xy = first[..., 0] * second[..., 1] + first[..., 1] * second[..., 0]
    return np.stack([first[..., 0] * second[..., 0], first[..., 1] * second[..., 1], xy], -1) / 2


def strain_rows(jet: Jet, grad: Array) -> Array:
    """Return ε(u) + sym(∇w₀⊗∇w) of unknowns (u_x, u_y, w), rows (xx, yy, 2xy).

    Args: grad (e, q, 2): ∇w₀.
    """
    dx = jet.gradient[:, :, 0]
    dy = jet.gradient[:, :, 1]
    wx = grad[..., :1]
    wy = grad[..., 1:]
    return np.concatenate(
        [in_plane_strain(jet), np.stack([wx * dx, wy * dy, wx * dy + wy * dx], axis=2)],
        axis=-1,
    )


def as_matrix(stress: Array) -> Array:
    """Return a symmetric tensor (xx, yy, xy) in the last axis as a matrix (..., 2, 2)."""
    return np.stack([stress[..., [0, 2]], stress[..., [2, 1]]], -2)


def vector_dofs(space: Space, triangles: slice | Index) -> Index:
    """Return the unknowns of u = (u_x, u_y) on the given triangles.

    Those of u_x come first, then those of u_y, offset by `space.size`.
    """
    return np.concatenate([space.dofs[triangles], space.dofs[triangles] + space.size], axis=1)


@dataclass(frozen=True)
class Cell:
    """Some triangles at their quadrature points.

    triangles: which ones; jet: the basis there; dx (e, q) [m²]: the area element.
    """

    triangles: slice
    jet: Jet
    dx: Array


def cells(space: Space, order: int, second: bool = False) -> Iterator[Cell]:
    """Walk over the mesh in chunks, with quadrature exact to the given order."""
    points, weights = space.quadrature(order)
    for start in range(0, len(space.dofs), CHUNK):
        triangles = slice(start, min(start + CHUNK, len(space.dofs)))
        jet = space.jet(triangles, points, second)
        yield Cell(triangles, jet, np.abs(np.linalg.det(jet.jacobian)) * weights)


def local_matrices(strain: Array, moduli: Array, dx: Array) -> Array:
    """Return ∫ Bᵀ C B of each triangle or edge.

    strain (e, q, c, j), moduli (..., c, c), dx (e, q) -> (e, j, j).
    """
    stress = (moduli * dx[..., None, None]) @ strain
    n, q, c, j = strain.shape
    return np.asarray(strain.reshape(n, q * c, j).transpose(0, 2, 1) @ stress.reshape(n, q * c, j))


def local_vectors(strain: Array, stress: Array, dx: Array) -> Array:
    """Return ∫ Bᵀ s (e, j) of each triangle: strain (e, q, c, j), stress (e, q, c), dx (e, q)."""
    n, q, c, j = strain.shape
    return np.asarray(
        (
            strain.reshape(n, q * c, j).transpose(0, 2, 1)
            @ (stress * dx[..., None]).reshape(n, q * c, 1)
        )[..., 0]
    )


@dataclass(frozen=True)
class Term:
    """The form ∫ Bᵀ C B on some triangles or edges, at quadrature points.

    strain B (e, q, c, j), moduli C (..., c, c), dx (e, q), dofs (e, j) the unknowns of each.
    """

    strain: Array
    moduli: Array
    dx: Array
    dofs: Index

    def energies(self, shapes: Array) -> Array:
        """Return ∫ wᵀ Bᵀ C B w of shapes w (n, size), (n,).

        B w comes first: the entries of BᵀCB cancel, those of small stiff elements by far more than
        what is left.
        """
        n, q, c, j = self.strain.shape
        flat = self.strain.reshape(n, q * c, j)
        found = np.empty(len(shapes))
        for start in range(0, len(shapes), SHAPES):
            some = slice(start, start + SHAPES)
            local = shapes[some, self.dofs].transpose(1, 2, 0)
            strained = (flat @ local).reshape(n, q, c, -1)
            stressed = (self.moduli * self.dx[..., None, None]) @ strained
            found[some] = np.einsum("eqcn,eqcn->n", strained, stressed)
        return found


class Assembly:
    """A sparse matrix gathered from local ones.

    When more than `held` entries have come together they are summed, which bounds the memory of a
    mesh of any size.
    """

    def __init__(self, size: int, held: int = SUMMED) -> None:
        self._size = size
        self._held = held
        self._parts: list[tuple[Array, NDArray[np.int32], NDArray[np.int32]]] = []
        self._entries = 0
        self._summed = csc_matrix((size, size))

    def add(self, local: Array, dofs: Index) -> None:
        """Add local matrices (e, j, j) that act on unknowns (e, j)."""
        rows = np.broadcast_to(dofs[:, :, None], local.shape).astype(np.int32)
        columns = np.broadcast_to(dofs[:, None, :], local.shape).astype(np.int32)
        self._parts.append((local.ravel(), rows.ravel(), columns.ravel()))
        self._entries += local.size
        if self._entries > self._held:
            self._summed = self.matrix()
            self._parts = []
            self._entries = 0

    def matrix(self) -> csc_matrix:
        """Return the sum of what was added."""
        if not self._parts:
            return self._summed
        data, rows, columns = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        total = csc_matrix(coo_matrix((data, (rows, columns)), shape=(self._size, self._size)))
        total.sum_duplicates()
        return csc_matrix(self._summed + total) if self._summed.nnz else total
