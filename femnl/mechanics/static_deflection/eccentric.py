"""Layers beside the film's middle plane couple its bending to its stretching."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.device import Edge
from femnl.core.domain import Prestress
from femnl.core.errors import ParameterError
from femnl.mechanics.fem.elements import Jet, Space
from femnl.mechanics.fem.forms import (
    CHUNK,
    Assembly,
    as_matrix,
    curvature,
    in_plane_strain,
    local_matrices,
    local_vectors,
    slope,
    strain_rows,
    stretch,
    vector_dofs,
)
from femnl.mechanics.fem.interior_penalty import edges_by_local_number, side_of_edge
from femnl.mechanics.fem.sheet import Sheet

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Parity = tuple[int, ...]


@dataclass(frozen=True)
class _Place:
    """Some triangles, or one side of some edges, where a strain meets a turn.

    triangles (e,); jet: the basis of u and w there; turn Q (e, q, 3, j): rows (xx, yy, 2xy), which
    are −∇∇v in triangles, and on edges the share of a side in n⊗n [∂ₙv]; turned (e, j): the
    unknowns of w that Q acts on; dx (e, q); rest (e, q, 3): the strain ε(u₀) of the flat film;
    couple B (e, q, 3, 3) [N]. mirror: the mirror line that the edges lie on, if any.
    """

    triangles: Index
    jet: Jet
    turn: Array
    turned: Index
    dx: Array
    rest: Array
    couple: Array
    mirror: int | None


class Eccentricity:
    """The part of the energy by which layers couple the turn of a film to its strain.

    With the strain E = ε(u) + ½ ∇w⊗∇w of the film's middle and the curvature κ = ∇∇w, a film at
    height z is strained by E − zκ. Beside ∫ ½ A E:E and ∫ ½ D κ:κ about the middle, which `Film`
    holds, this gives

        W_B = −∫ (M₀ I + B (ε(u₀) + E)) : κ,   M₀ = Σ σᵢhᵢzᵢ,   B = Σ Cᵢhᵢzᵢ,

    and on edges of triangles ∮ {nᵀ(M₀ I + B (ε(u₀) + E))n} [∂ₙw], which makes kinks of the elements
    consistent with it, as `fem.interior_penalty` does for D, with its weights of the two sides.

    Args: space: of u and w. prestress: the relaxed flat film, ε(u₀). edge: in its plane.
    Valid: Kirchhoff's plate in steps; edges hold the middle of the film, not that of its layers.
    Source: Jones, Mechanics of Composite Materials (1999), section 4.2.
    """

    def __init__(self, space: Space, prestress: Prestress, edge: Edge) -> None:
        self._space = space
        self._prestress = prestress
        self._flat = Space(prestress.domain.mesh, prestress.degree)
        # That of the paper stretches without Poisson's ratio
        self._sheet = Sheet(prestress.domain, 0.0 if edge == "paper" else None)
        subdomains = prestress.domain.mesh.subdomains or {}
        layers = [name for name in subdomains if name.startswith("layer-")]
        self._covered = np.unique(np.concatenate([subdomains[name] for name in layers]))
        self._refuse_turning_edges()

    def load(self) -> Array:
        """Return what the stresses of the flat film push w with, (size,) [N per unknown]."""
        load = np.zeros(self._space.size)
        for place in self._places():
            moment = self._sheet.moment(place.triangles, place.jet.point)
            total = moment[..., None] * np.array([1.0, 1.0, 0.0]) + _product(
                place.couple, place.rest
            )
            np.add.at(load, place.turned, -local_vectors(place.turn, total, place.dx))
        return load

    def derivatives(self, state: Array, parity: Parity) -> tuple[Array, csc_matrix]:
        """Return the first and second derivative of what is not linear in (u, w) of W_B.

        Args: state (3·size,), of a deflection that is even. parity: of motions about it.
        """
        size = self._space.size
        force = np.zeros(3 * size)
        tangent = Assembly(3 * size)
        for place in self._places():
            if place.mirror is not None and parity[place.mirror] < 0:
                continue
            dofs, w = self._unknowns(place)
            turned = place.turned + 2 * size
            grad = np.einsum("eqxj,ej->eqx", slope(place.jet), state[w])
            moved = state[dofs[:, : -w.shape[1]]]
            strain = np.einsum("eqcj,ej->eqc", in_plane_strain(place.jet), moved)
            strain += stretch(grad, grad)
            rows = strain_rows(place.jet, grad)
            turn = _product(place.couple, np.einsum("eqcj,ej->eqc", place.turn, state[turned]))
            np.add.at(force, dofs, local_vectors(rows, turn, place.dx))
            np.add.at(
                force, turned, local_vectors(place.turn, _product(place.couple, strain), place.dx)
            )
            tangent.add(_across(rows, place), np.concatenate([dofs, turned], axis=1))
            tangent.add(local_matrices(slope(place.jet), as_matrix(turn), place.dx), w)
        return force, tangent.matrix()

    def second_order(self, motions: Array, parities: tuple[Parity, ...]) -> Array:
        """Return the load (3·size, n) of second order of motions x (n, 3·size) by unknowns y.

        Half of the third derivative of W_B: Q(y) : B ½∇w_x⊗∇w_x + Q(x) : B sym(∇w_x⊗∇w_y).
        """
        size = self._space.size
        loads = np.zeros((3 * size, len(motions)))
        for place in self._places():
            _, w = self._unknowns(place)
            turned = place.turned + 2 * size
            for k, (motion, parity) in enumerate(zip(motions, parities, strict=True)):
                grad = np.einsum("eqxj,ej->eqx", slope(place.jet), motion[w])
                own = _product(place.couple, stretch(grad, grad))
                np.add.at(loads[:, k], turned, local_vectors(place.turn, own, place.dx))
                if place.mirror is not None and parity[place.mirror] < 0:
                    continue
                turn = np.einsum("eqcj,ej->eqc", place.turn, motion[turned])
                rows = strain_rows(place.jet, grad)[..., -w.shape[1] :]
                pull = local_vectors(rows, _product(place.couple, turn), place.dx)
                np.add.at(loads[:, k], w, pull)
        return loads

    def _unknowns(self, place: _Place) -> tuple[Index, Index]:
        """Return all unknowns (u_x, u_y, w) of a place's triangles, and those of w."""
        w = self._space.dofs[place.triangles] + 2 * self._space.size
        return np.concatenate([vector_dofs(self._space, place.triangles), w], axis=1), w

    def _refuse_turning_edges(self) -> None:
        model = self._prestress.domain.model
        held = self._space.boundary_facets("clamped")
        beside = np.isin(np.asarray(self._space.mesh.f2t)[0, held], self._covered)
        if np.isfinite(model.clamp.rotation) and beside.any():
            raise ParameterError(
                f"{model.name}: [layers]: a layer with a shape reaches an edge that may turn, and "
                "the rest of such a film is not modelled; end the layer before the edge, leave its "
                "shape out, or leave [clamp] rotation out"
            )

    def _places(self) -> Iterator[_Place]:
        yield from self._in_triangles()
        inside = np.flatnonzero(np.asarray(self._space.mesh.f2t)[1] >= 0)
        yield from self._on_edges(inside, None)
        if np.isinf(self._prestress.domain.model.clamp.rotation):
            yield from self._on_edges(self._space.boundary_facets("clamped"), None)
        for mirror in (0, 1):
            yield from self._on_edges(self._space.boundary_facets(f"mirror-{mirror}"), mirror)

    def _in_triangles(self) -> Iterator[_Place]:
        points, weights = self._space.quadrature(4 * self._space.degree - 4)
        for start in range(0, len(self._covered), CHUNK):
            triangles = self._covered[start : start + CHUNK]
            jet = self._space.jet(triangles, points, second=True)
            dx = np.abs(self._space.determinant(triangles, points)) * weights
            flat = self._flat.jet(triangles, points)
            yield self._place(
                triangles, (jet, flat), -curvature(jet), self._space.dofs[triangles], dx, None
            )

    def _on_edges(self, facets: Index, mirror: int | None) -> Iterator[_Place]:
        order = 3 * self._space.degree - 3
        beside = np.isin(np.asarray(self._space.mesh.f2t)[:, facets], self._covered).any(axis=0)
        for edges in edges_by_local_number(self._space, facets[beside]):
            sides = [
                (
                    *side_of_edge(self._space, triangles, edge, order),
                    side_of_edge(self._flat, triangles, edge, order)[0],
                )
                for triangles, edge in zip(edges.triangles, edges.local, strict=True)
            ]
            normal = sides[0][1]
            slopes = [np.einsum("eqx,eqxj->eqj", normal, jet.gradient) for jet, *_ in sides]
            jump = np.concatenate([slopes[0], *(-s for s in slopes[1:])], axis=-1)
            x, y = np.moveaxis(normal, -1, 0)
            across = np.stack([x**2, y**2, 2 * x * y], axis=-1)
            turned = np.concatenate([self._space.dofs[t] for t in edges.triangles], axis=1)
            soft = [
                1 / self._sheet.bending_about_middle(triangles, jet.point)[..., 0, 0]
                for triangles, (jet, *_) in zip(edges.triangles, sides, strict=True)
            ]
            for triangles, (jet, _, ds, flat), own in zip(
                edges.triangles, sides, soft, strict=True
            ):
                share = own / np.sum(soft, axis=0)
                turn = (share[..., None] * across)[..., None] * jump[..., None, :]
                yield self._place(triangles, (jet, flat), turn, turned, ds, mirror)

    def _place(
        self,
        triangles: Index,
        jets: tuple[Jet, Jet],
        turn: Array,
        turned: Index,
        dx: Array,
        mirror: int | None,
    ) -> _Place:
        jet, flat = jets
        moved = self._prestress.displacement[vector_dofs(self._flat, triangles)]
        rest = np.einsum("eqcj,ej->eqc", in_plane_strain(flat), moved)
        couple = self._sheet.couple(triangles, jet.point)
        return _Place(triangles, jet, turn, turned, dx, rest, couple, mirror)


def _across(rows: Array, place: _Place) -> Array:
    """Return ∫ E(x) : B Q(y) + Q(x) : B E(y) of rows E (e, q, 3, i): (e, i + j, i + j)."""
    turn = (place.couple * place.dx[..., None, None]) @ place.turn
    one = np.einsum("eqci,eqcj->eij", rows, turn, optimize=True)
    other = np.swapaxes(one, 1, 2)
    none = [np.zeros((len(one), n, n)) for n in one.shape[1:]]
    return np.concatenate(
        [np.concatenate([none[0], one], axis=2), np.concatenate([other, none[1]], axis=2)], axis=1
    )


def _product(moduli: Array, strain: Array) -> Array:
    """Return the stresses (e, q, 3) of strains (e, q, 3)."""
    return np.asarray((strain[..., None, :] @ moduli)[..., 0, :])
