"""One kind of tile: stiffness, mass and in-plane response on the sides that it shares.

What its inner unknowns leave of them.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csc_matrix

from femnl.core.device import Model
from femnl.core.errors import ConvergenceError
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import (
    Assembly,
    Cell,
    as_matrix,
    curvature,
    deflection,
    in_plane_strain,
    local_matrices,
    plane_stress,
    quadrature_order,
    slope,
    thickness,
    vector_dofs,
)
from femnl.mechanics.fem.interior_penalty import isotropic, slope_continuity
from femnl.mechanics.fem.solvers import INDEFINITE
from femnl.mechanics.lattice.sides import Sides

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Degrees of the inertial loads, and of those of the responses to them, that a tile's basis answers
# to
LOADS = (3, 1)

INDEPENDENT = 1e-9  # of a unit vector, that it adds to others at least


def all_triangles(space: Space, order: int, second: bool = False) -> Cell:
    """Return the whole of a small mesh at points of quadrature exact to the given order."""
    points, weights = space.quadrature(order)
    jet = space.jet(slice(None), points, second)
    return Cell(slice(None), jet, np.abs(np.linalg.det(jet.jacobian)) * weights)


def factor(matrix: Array) -> tuple[Array, bool]:
    """Return Cholesky's factor of a symmetric matrix, for `cho_solve`.

    Raises: ConvergenceError where it is not positive definite.
    """
    try:
        found, lower = cho_factor(matrix)
    except np.linalg.LinAlgError as error:
        raise ConvergenceError(INDEFINITE) from error
    return found, bool(lower)


def gathered(local: Array, dofs: Index, size: int) -> csc_matrix:
    """Return the sum of local matrices (e, j, j) on unknowns (e, j)."""
    assembly = Assembly(size)
    assembly.add(local, dofs)
    return assembly.matrix()


class Membrane:
    """In-plane response of a tile: ∫ hC ε(u) : ε(v), its inner unknowns eliminated.

    Args: sides: of the tile. model: the film. poisson: of its response. order: of polynomials that
    are to be integrated exactly.
    Attributes: cell: the tile's triangles; modulus: hC (e, q, 3, 3) [N/m] in them; edge: unknowns
        (u_x, then u_y) on the sides; lift (2·size, n): displacements that go with those, at rest
        inside; stiffness (n, n) of them.
    """

    def __init__(self, sides: Sides, model: Model, poisson: float, order: int) -> None:
        space = sides.space
        self.cell = cell = all_triangles(space, quadrature_order(model, order))
        self.thickness = thickness(model, cell.jet.point)
        self.modulus = self.thickness[..., None, None] * plane_stress(model.film.young, poisson)
        self._basis = in_plane_strain(cell.jet)
        self._dofs = vector_dofs(space, cell.triangles)
        self._size = 2 * space.size
        whole = gathered(
            local_matrices(self._basis, self.modulus, cell.dx), self._dofs, self._size
        ).toarray()
        self.edge = np.concatenate([sides.dofs, sides.dofs + space.size])
        self._inner = np.concatenate([sides.inner, sides.inner + space.size])
        self._factor = factor(whole[np.ix_(self._inner, self._inner)])
        coupling = whole[np.ix_(self._inner, self.edge)]
        self.lift = np.zeros((self._size, len(self.edge)))
        self.lift[self.edge] = np.eye(len(self.edge))
        self.lift[self._inner] = -cho_solve(self._factor, coupling)
        self.stiffness = whole[np.ix_(self.edge, self.edge)] + coupling.T @ self.lift[self._inner]

    def strain(self, displacement: Array) -> Array:
        """Return ε (n, e, q, 3) of displacements (2·size, n)."""
        return np.asarray(
            np.einsum("eqcj,ejn->neqc", self._basis, displacement[self._dofs], optimize=True)
        )

    def load(self, stress: Array) -> Array:
        """Return −∫ s : ε(v), (2·size, n), of stresses (n, e, q, 3) [N/m]."""
        dx = self.cell.dx
        weighted = (stress * dx[..., None]).transpose(1, 2, 3, 0).reshape(len(dx), -1, len(stress))
        local = (
            self._basis.reshape(len(dx), -1, self._basis.shape[-1]).transpose(0, 2, 1) @ weighted
        )
        whole = np.zeros((self._size, len(stress)))
        np.add.at(whole, self._dofs, -local)
        return whole

    def respond(self, load: Array) -> tuple[Array, Array]:
        """Return displacements (2·size, n) under loads, and loads on the sides, which are held."""
        still = np.zeros_like(load)
        still[self._inner] = cho_solve(self._factor, load[self._inner])
        return still, self.lift.T @ load


class Flexure:
    """K and M of the deflection of a tile, and its basis.

    What its sides span together with its own slow responses.

    Args: sides: of the tile. model: the film. stress: typical relaxed stress (e, q, 3) [Pa], with
    which the basis is at rest.
    Attributes: basis (size, m): deflections that go with unknowns on the sides, then with inner
        ones; n_sides of the former; bend, inertia (size, size): K of bending, M.
    """

    def __init__(self, sides: Sides, model: Model, stress: Array, degree: int) -> None:
        space = sides.space
        bends = model.bending
        film = model.film
        cell = all_triangles(space, quadrature_order(model, 2 * degree), second=bends)
        h = thickness(model, cell.jet.point)
        self.cell = cell
        self._weight = h * cell.dx
        self._size = space.size + len(sides.slope_place)
        self._dofs = space.dofs
        mass = gathered(
            local_matrices(deflection(cell.jet), np.eye(1), film.density * self._weight),
            space.dofs,
            self._size,
        )
        bend = csc_matrix((self._size, self._size))
        if bends:
            bend = bend + gathered(
                local_matrices(
                    curvature(cell.jet), plane_stress(film.young, film.poisson), h**3 / 12 * cell.dx
                ),
                space.dofs,
                self._size,
            )
            joints = Assembly(self._size)

            def rigidity(point: Array) -> Array:
                return np.asarray(
                    film.young * thickness(model, point) ** 3 / 12 / (1 - film.poisson**2)
                )

            inside = np.flatnonzero(space.mesh.f2t[1] >= 0)
            for local, dofs in slope_continuity(
                space, inside, isotropic(rigidity, film.poisson), film.poisson
            ):
                joints.add(local, dofs)
            bend = bend + joints.matrix() + sides.continuity(model)
        self.bend = csc_matrix(bend)
        self.inertia = mass
        self.inner = sides.inner
        edge = np.concatenate([sides.dofs, np.arange(space.size, self._size)])
        self.n_sides = len(edge)
        whole = (self.bend + self.tension(stress)).toarray()
        self._factor = factor(whole[np.ix_(self.inner, self.inner)])
        basis = np.zeros((self._size, len(edge)))
        basis[edge] = np.eye(len(edge))
        basis[self.inner] = -cho_solve(self._factor, whole[np.ix_(self.inner, edge)])
        self.basis = np.concatenate([basis, self._slow(space.location)], axis=1)
        scatter = (np.ones(space.dofs.size), (space.dofs.ravel(), np.arange(space.dofs.size)))
        self._scatter = csc_matrix(scatter, shape=(self._size, space.dofs.size))

    def extend(self, found: Array) -> None:
        """Take more responses (size, n) of the clamped tile into the basis."""
        known = self.basis[:, self.n_sides :]
        found = found / np.linalg.norm(found, axis=0)
        for _ in range(2):
            found = found - known @ (known.T @ found)
        self.basis = np.concatenate([self.basis, self._independent(found)], axis=1)

    def _independent(self, found: Array) -> Array:
        """Return orthonormal columns (size, m) of what the given ones add, zero on the sides."""
        left, size, _ = np.linalg.svd(found[self.inner], full_matrices=False)
        whole = np.zeros((self._size, int(np.sum(size > INDEPENDENT))))
        whole[self.inner] = left[:, : whole.shape[1]]
        return whole

    def missed(self, stress: Array, squares: Array, shapes: Array) -> tuple[Array, Array]:
        """Return what the basis misses of shapes (size, tiles, n) with ω² = squares (n,).

        The relaxed stress (tiles, e, q, 3) [Pa] is that of each tile.

        The residual r = (K − ω²M) w inside relaxes by z = K⁻¹r, K that of the typical tile, and
        lowers ω² by zᵀr / wᵀMw.

        Returns: z (size, tiles, n) and Σ zᵀr (n,).
        """
        flat = shapes.reshape(self._size, -1)
        residual = self.bend @ flat - (self.inertia @ flat) * np.tile(squares, shapes.shape[1])
        gradient = self.cell.jet.gradient
        n, q, _, j = gradient.shape
        slopes = (gradient.reshape(n, 2 * q, j) @ flat[self._dofs]).reshape(
            n, q, 2, *shapes.shape[1:]
        )
        weighted = (stress * self._weight[..., None]).transpose(1, 2, 3, 0)[..., None]
        x = slopes[:, :, 0]
        y = slopes[:, :, 1]
        xx, yy, xy = (weighted[:, :, c] for c in range(3))
        force = np.stack([xx * x + xy * y, xy * x + yy * y], axis=2).reshape(n, 2 * q, -1)
        local = gradient.reshape(n, 2 * q, j).transpose(0, 2, 1) @ force
        residual += self._scatter @ local.reshape(n * j, -1)
        correction = self.relax(residual)
        energy = np.einsum("im,im->m", residual[self.inner], correction[self.inner])
        return correction.reshape(shapes.shape), energy.reshape(shapes.shape[1:]).sum(axis=0)

    def _slow(self, place: Array) -> Array:
        """Return responses of the clamped tile to smooth inertial loads, orthogonal."""
        x, y = ((place - place.mean(axis=0)) / np.ptp(place, axis=0)).T
        loads = np.stack(
            [x**a * y**b for n in range(LOADS[0] + 1) for a in range(n, -1, -1) for b in (n - a,)],
            1,
        )
        first = self.relax(self.inertia[:, : len(place)] @ loads)
        n_second = (LOADS[1] + 1) * (LOADS[1] + 2) // 2
        second = self.relax(self.inertia @ first[:, :n_second])
        found = np.concatenate([first, second], axis=1)
        return self._independent(found / np.linalg.norm(found, axis=0))

    def relax(self, load: Array) -> Array:
        """Return the deflection (size, n) of the tile under loads while its sides are held."""
        found = np.zeros(load.shape)
        found[self.inner] = cho_solve(self._factor, load[self.inner])
        return found

    def tension(self, stress: Array) -> csc_matrix:
        """Return ∫ hσ : ∇w⊗∇v of a stress (e, q, 3) [Pa]."""
        return gathered(
            local_matrices(slope(self.cell.jet), as_matrix(stress), self._weight),
            self._dofs,
            self._size,
        )

    def reduced(self, matrix: csc_matrix) -> Array:
        """Return a matrix in the tile's basis."""
        return np.asarray(self.basis.T @ (matrix @ self.basis))
