"""Continuity of slopes across edges of triangles: the interior penalty form of a bent plate.

Continuous elements have kinks in slope across edges; the symmetric interior penalty form (Engel et
al., Comput. Methods Appl. Mech. Eng. 191, 3669 (2002); Brenner & Sung, J. Sci. Comput. 22, 83
(2005)) makes them consistent with the plate equation.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.mechanics.fem.elements import Jet, Space
from femnl.mechanics.fem.forms import Term, as_matrix, local_matrices, plane_stress
from femnl.mechanics.fem.reference import EDGES, VERTICES

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
    """Yield local matrices and unknowns of `slope_terms`, whose arguments are the same."""
    for term in slope_terms(space, facets, bending, poisson, rotation):
        yield local_matrices(term.strain, term.moduli, term.dx), term.dofs


def slope_terms(
    space: Space, facets: Index, bending: Bending, poisson: float, rotation: float = np.inf
) -> Iterator[Term]:
    """Yield the jump terms of C⁰ interior-penalty bending.

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
