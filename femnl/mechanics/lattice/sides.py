"""The sides of a tile: what it shares with its neighbours, and how slopes go on across them."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine

from femnl.core.device import Model
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import Assembly, as_matrix, local_matrices, thickness
from femnl.mechanics.fem.interior_penalty import edges_by_local_number

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Sides:
    """Unknowns of a tile on its sides.

    Deflections, and slopes ∂w/∂x or ∂w/∂y across straight edges at Gauss points of them.

    Args: space: of the tile's mesh. slopes: whether there are any; a film without bending has none.
    Attributes: dofs: of the deflections, at `place` (n, 2) [m]; slope_place (n_slopes, 2) [m] and
    slope_axis (n_slopes,), 0 for ∂w/∂x.
    """

    def __init__(self, space: Space, slopes: bool) -> None:
        self.space = space
        self.dofs: Index = np.unique(space.boundary_dofs("side"))
        self.place = space.location[self.dofs]
        self._facets = space.boundary_facets("side")
        start, end = (space.mesh.p[:, space.mesh.facets[k, self._facets]].T for k in (0, 1))
        self._axis = np.argmin(np.abs(end - start), axis=1)
        self._length = np.linalg.norm(end - start, axis=1)
        fraction = _gauss(space.degree) if slopes else np.empty(0)
        self.slope_place = (start[:, None] + (end - start)[:, None] * fraction[:, None]).reshape(
            -1, 2
        )
        self.slope_axis: Index = np.repeat(self._axis, len(fraction))

    @property
    def inner(self) -> Index:
        """Deflections that are not on the sides."""
        return np.setdiff1d(np.arange(self.space.size), self.dofs)

    def continuity(self, model: Model) -> csc_matrix:
        """Return the jump terms on the sides, −M(w)[v] − M(v)[w] + σ[w][v].

        [w] = ∂ₙw less the slope that is an unknown of its own: w, then slopes.

        Tiles that meet see one slope. M = D (∂²w/∂n² + ν ∂²w/∂t²) and σ as on a clamped edge, see
        `slope_continuity`.
        """
        space = self.space
        p = self.space.degree
        film = model.film
        whole = Assembly(space.size + len(self.slope_place))
        for edges in edges_by_local_number(space, self._facets):
            (triangles,) = edges.triangles
            (edge,) = edges.local
            at = np.searchsorted(self._facets, space.mesh.t2f[edge, triangles])
            points, weights = space.edge_points(edge, 2 * p)
            jet = space.jet(triangles, points, second=True)
            axis = self._axis[at]
            row = np.arange(len(at))
            rigidity = film.young * thickness(model, jet.point) ** 3 / 12 / (1 - film.poisson**2)
            bend = jet.hessian[row, :, axis] + film.poisson * jet.hessian[row, :, 1 - axis]
            outward = self._outward(at)[:, None, None]
            slopes = np.broadcast_to(_on_edge(p, 2 * p), (len(at), len(weights), p))
            jump = outward * np.concatenate([jet.gradient[row, :, axis], -slopes], -1)
            moment = np.concatenate([rigidity[..., None] * bend, np.zeros_like(slopes)], -1)
            ratio = self._length[at] / (space.least_determinant[triangles] / 2)
            penalty = 6 * rigidity * (1 + abs(film.poisson)) * (p - 1) * p / 2 * ratio[:, None]
            one = np.ones_like(penalty)
            local = local_matrices(
                np.stack([moment, jump], 2),
                as_matrix(np.stack([0 * one, penalty, -one], -1)),
                self._length[at, None] * weights,
            )
            whole.add(
                local,
                np.concatenate(
                    [space.dofs[triangles], space.size + at[:, None] * p + np.arange(p)], axis=1
                ),
            )
        return whole.matrix()

    def _outward(self, at: Index) -> Array:
        """Return 1 where the outer normal of a side's edge points along its axis, else −1."""
        mesh = self.space.mesh
        facets = self._facets[at]
        away = mesh.p[:, mesh.facets[:, facets]].mean(axis=1) - mesh.p[
            :, mesh.t[:3, mesh.f2t[0, facets]]
        ].mean(axis=1)
        return np.asarray(np.sign(away[self._axis[at], np.arange(len(at))]))


def _gauss(n: int) -> Array:
    return np.asarray((np.polynomial.legendre.leggauss(n)[0] + 1) / 2)


def _on_edge(n: int, order: int) -> Array:
    """Return polynomials (q, n) that are 1 at one Gauss point of an edge and 0 at the others.

    They are evaluated at the q points of quadrature.
    """
    where = np.asarray(get_quadrature(RefLine, order)[0])[0]
    powers = np.vander(_gauss(n), increasing=True)
    return np.asarray(np.linalg.solve(powers.T, np.vander(where, n, increasing=True).T).T)
