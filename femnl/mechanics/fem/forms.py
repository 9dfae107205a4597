"""One strain energy of a stressed plate, and the weak forms that follow from it.

    W(u, w) = ∫ h [σ₀ tr E + ½ E : C E] + (h³/24) κ : C κ,   E = ε(u) + ½ ∇w⊗∇w,   κ = ∇∇w

Every form below is ∫ B(v)ᵀ C B(w): a strain operator B, one row per component, and its moduli C.
Symmetric tensors are vectors (xx, yy, 2xy) for strains and (xx, yy, xy) for stresses. Continuous
elements have kinks in slope across edges; the symmetric interior penalty form (Engel et al.,
Comput. Methods Appl. Mech. Eng. 191, 3669 (2002); Brenner & Sung, J. Sci. Comput. 22, 83 (2005))
makes them consistent with the plate equation.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix
from scipy.spatial import cKDTree

from femnl.core.device import Film, Model
from femnl.mechanics.fem.elements import EDGES, VERTICES, Jet, Space

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

    When `SUMMED` entries have come together they are summed, which bounds the memory of a mesh of
    any size.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._parts: list[tuple[Array, NDArray[np.int32], NDArray[np.int32]]] = []
        self._entries = 0
        self._summed = csc_matrix((size, size))

    def add(self, local: Array, dofs: Index) -> None:
        """Add local matrices (e, j, j) that act on unknowns (e, j)."""
        rows = np.broadcast_to(dofs[:, :, None], local.shape).astype(np.int32)
        columns = np.broadcast_to(dofs[:, None, :], local.shape).astype(np.int32)
        self._parts.append((local.ravel(), rows.ravel(), columns.ravel()))
        self._entries += local.size
        if self._entries > SUMMED:
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


@dataclass(frozen=True)
class Edges:
    """Some mesh edges with the triangle(s) beside them.

    triangles (sides, n) and the local edge number in each.
    """

    triangles: Index
    local: tuple[int, ...]


def edges_by_local_number(space: Space, facets: Index) -> Iterator[Edges]:
    """Group facets by their local edge numbers in the neighbouring triangles."""
    mesh = space.mesh
    sides = np.asarray(mesh.f2t[:, facets], dtype=np.int64)  # −1 beyond the film's edge
    number = np.where(
        sides >= 0, [np.argmax(mesh.t2f[:, side] == facets, axis=0) for side in sides], -1
    )
    for local in np.unique(number, axis=1).T:
        chosen = np.all(number == local[:, None], axis=0)
        present = local >= 0
        yield Edges(sides[present][:, chosen], tuple(int(e) for e in local[present]))


Bending = Callable[[Index, Array], Array]


def isotropic(rigidity: Callable[[Array], Array], poisson: float) -> Bending:
    """Return h³/12 C (e, q, 3, 3) [N m] of a film with rigidity D(x) [N m] at points (e, q, 2)."""
    moduli = plane_stress(1 - poisson**2, poisson)
    return lambda _, point: rigidity(point)[..., None, None] * moduli


def slope_continuity(
    space: Space, facets: Index, bending: Bending, poisson: float, rotation: float = np.inf
) -> Iterator[tuple[Array, Index]]:
    """Local matrices and unknowns of `slope_terms`, whose arguments are the same."""
    for term in slope_terms(space, facets, bending, poisson, rotation):
        yield local_matrices(term.strain, term.moduli, term.dx), term.dofs


def slope_terms(
    space: Space, facets: Index, bending: Bending, poisson: float, rotation: float = np.inf
) -> Iterator[Term]:
    """The jump terms of C⁰ interior-penalty bending.

    −{Mₙₙ(w)}[∂ₙv] − {Mₙₙ(v)}[∂ₙw] + σ[∂ₙw][∂ₙv] on interior facets, or with one side on facets
    where ∂ₙw is held.

    bending: h³/12 C (e, q, 3, 3) [N m] of triangles (e,) at points (e, q, 2). poisson: the largest
    of the film.
    rotation: k [N] of the springs that hold ∂ₙw, Mₙₙ = −k ∂ₙw; infinite where it is zero.

    {M} = Σ ωᵢMᵢ weighs the sides by ωᵢ ∝ 1/Dᵢ, so that a stiff side leaves the soft one its slope
    (Ern, Stephansen & Zunino, IMA J. Numer. Anal. 29, 235 (2009)). The penalty σ = Σ ωᵢ²·6
    Dᵢ(1+|ν|)·(p+1)(p+2)/2·|e|/|K|ᵢ with p = degree − 2 follows from the sharp trace inequality of
    polynomials on triangles (Warburton & Hesthaven, Comput. Methods Appl. Mech. Eng. 192, 2765
    (2003)) and keeps the form coercive on stretched triangles; |K| counts as that of the most
    squeezed place of a curved one. Springs turn the terms into −θ, θσ with θ = k/(k + σ), and
    −Mₙₙ(w)Mₙₙ(v)/(k + σ), which is as stable for every k (Juntunen & Stenberg, Math. Comp. 78, 1353
    (2009)).
    """
    for edges in edges_by_local_number(space, facets):
        moments = []
        slopes = []
        ratios = []
        rigid = []
        normal = np.empty(0)
        for side, (triangles, edge) in enumerate(zip(edges.triangles, edges.local, strict=True)):
            jet, outward, ds = side_of_edge(space, triangles, edge, 2 * space.degree, second=True)
            normal = outward if side == 0 else normal
            moduli = bending(triangles, jet.point)
            moments.append(_normal_moment(jet, normal, moduli))
            slopes.append(np.einsum("eqx,eqxj->eqj", normal, jet.gradient))
            ratios.append(
                ds.sum(axis=-1, keepdims=True) / (space.least_determinant[triangles, None] / 2)
            )
            rigid.append(moduli[..., 0, 0])
        soft = 1 / np.stack(rigid)
        weight = soft / soft.sum(axis=0)
        jump = np.concatenate([slopes[0]] + [-s for s in slopes[1:]], -1)
        mean = np.concatenate([w[..., None] * m for w, m in zip(weight, moments, strict=True)], -1)
        sigma = _penalty(space, poisson) * np.sum(
            weight**2 * np.stack(rigid) * np.stack(ratios), axis=0
        )
        share = 1 / (1 + sigma / rotation) if rotation > 0 else np.zeros_like(sigma)
        moduli = as_matrix(np.stack([-1 / (rotation + sigma), share * sigma, -share], -1))
        dofs = np.concatenate([space.dofs[t] for t in edges.triangles], axis=1)
        yield Term(np.stack([mean, jump], axis=2), moduli, ds, dofs)


def edge_moment(
    space: Space, facets: Index, bending: Bending, poisson: float, rotation: float | None
) -> Array:
    """Return the load (size,) [N·m by m of ∂ₙw] of a moment of 1 N on edges, ∮ ∂ₙv.

    On facets that springs hold, as in `slope_continuity`, it is ∮ (σ ∂ₙv − Mₙₙ(v))/(k + σ): there
    Mₙₙ = 1 N − k ∂ₙw, to which its terms are consistent.

    Args: as of `slope_continuity`; rotation: None on free edges.
    """
    load = np.zeros(space.size)
    for edges in edges_by_local_number(space, facets):
        triangles = edges.triangles[0]
        jet, normal, ds = side_of_edge(
            space, triangles, edges.local[0], 2 * space.degree, second=True
        )
        turn = np.einsum("eqx,eqxj->eqj", normal, jet.gradient)
        if rotation is not None:
            moduli = bending(triangles, jet.point)
            ratio = ds.sum(axis=-1, keepdims=True) / (space.least_determinant[triangles, None] / 2)
            sigma = _penalty(space, poisson) * moduli[..., 0, 0] * ratio
            moment = _normal_moment(jet, normal, moduli)
            turn = (sigma[..., None] * turn - moment) / (rotation + sigma)[..., None]
        np.add.at(load, space.dofs[triangles], np.einsum("eqj,eq->ej", turn, ds))
    return load


def _penalty(space: Space, poisson: float) -> float:
    """Return the number by which σ of `slope_continuity` is above ΣωD|e|/|K|."""
    p = space.degree - 2
    return 6 * (1 + abs(poisson)) * (p + 1) * (p + 2) / 2


def side_of_edge(
    space: Space, triangles: Index, edge: int, order: int, second: bool = False
) -> tuple[Jet, Array, Array]:
    """Return one edge of each triangle at quadrature points.

    The basis, the outward normal (e, q, 2) and the length element (e, q) [m].
    """
    points, weights = space.edge_points(edge, order)
    jet = space.jet(triangles, points, second)
    start, end = VERTICES[list(EDGES[edge])]
    along = np.einsum("eqxb,b->eqx", jet.jacobian, end - start)
    length = np.linalg.norm(along, axis=-1)
    normal = np.stack([along[..., 1], -along[..., 0]], -1) / length[..., None]
    inner = jet.jacobian @ (np.full(2, 1 / 3) - points)[None, :, :, None]
    return (
        jet,
        -normal * np.sign(np.einsum("eqx,eqx->eq", normal, inner[..., 0]))[..., None],
        length * weights,
    )


def _normal_moment(jet: Jet, normal: Array, bending: Array) -> Array:
    """Return the mₙₙ = nᵀ M n of M = h³/12 C ∇∇w, shape (e, q, j)."""
    nx = normal[..., 0]
    ny = normal[..., 1]
    rows = (np.stack([nx**2, ny**2, 2 * nx * ny], -1)[..., None, :] @ bending)[..., 0, :]
    return np.asarray(np.einsum("eqc,eqcj->eqj", rows * np.array([1.0, 1.0, 2.0]), jet.hessian))
