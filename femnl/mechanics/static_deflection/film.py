"""The strain energy of the film in all its unknowns, and its derivatives."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csc_matrix

from femnl.core.device import Edge
from femnl.core.errors import ConvergenceError
from femnl.core.modes import Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import (
    Assembly,
    Cell,
    as_matrix,
    cells,
    in_plane_strain,
    local_matrices,
    local_vectors,
    quadrature_order,
    slope,
    strain_rows,
    stretch,
    vector_dofs,
)
from femnl.mechanics.fem.interior_penalty import edge_moment
from femnl.mechanics.fem.offset import covers_evenly, ends_free, own_moment
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.fem.supports import in_plane_springs, in_plane_supports
from femnl.mechanics.modes.operators import Operators
from femnl.mechanics.nonlinearity import film_membrane
from femnl.mechanics.static_deflection.eccentric import Eccentricity

Array = NDArray[np.float64]
Parity = tuple[int, ...]

STEPS = 60  # of Newton's method
SETTLED = 1e-16  # work of what the last step mends, over that of the load


class Film:
    """The energy of a film that may be bent, about its flat relaxed state.

    W(u, w) = ½ w·Kw + ∫ ½ h C E : E, E = ε(u) + ½ ∇w⊗∇w. The tension, bending and edge of the flat
    film are in K.

    States are vectors (3·size,) of u_x, u_y and w at the unknowns of the modes' space. A state
    whose w is odd about a mirror is its own image there with w reversed; its in-plane part is even.
    So about a bow of parity b, a motion with w of parity p has u of parity b·p.

    Args: eccentric: layers act where they lie, beside the film's middle, as `Eccentricity` says;
        else K bends them about the neutral plane, as in the modes.
    """

    def __init__(self, modes: Modes, edge: Edge, eccentric: bool = False) -> None:
        self.domain = modes.domain
        self.edge = edge
        self.space = Space(self.domain.mesh, modes.degree)
        self._operators = Operators(modes.prestress, modes.degree, about_middle=eccentric)
        self._membrane = film_membrane(modes, edge)
        self._beside = Eccentricity(self.space, modes.prestress, edge) if eccentric else None

    @property
    def mass(self) -> csc_matrix:
        """Inertia of w, (size, size) [kg]."""
        return self._operators.mass

    @property
    def inertia(self) -> csc_matrix:
        """The same in the place of w, (3·size, 3·size): the film in its plane has none."""
        return csc_matrix(block_diag([csc_matrix((2 * self.space.size,) * 2), self.mass]))

    @property
    def area(self) -> Array:
        """∫ v of every unknown of w, (size,) [m²]: the load of a pressure of 1 Pa."""
        load = np.zeros(self.space.size)
        for cell in cells(self.space, self.space.degree):
            np.add.at(
                load,
                self.space.dofs[cell.triangles],
                np.einsum("eqj,eq->ej", cell.jet.value, cell.dx),
            )
        return load

    @property
    def of_layers(self) -> Array:
        """The load of the stresses of layers, (size,) [N per unknown]."""
        model = self.domain.model
        if self._beside is not None:
            return self._beside.load()
        if covers_evenly(model) and model.bending and ends_free(model):
            return own_moment(model) * self._moment
        return np.zeros(self.space.size)

    @property
    def _moment(self) -> Array:
        """The load (size,) [m] of a moment by length of 1 N, the same everywhere in the film.

        ∫ Δv less what edges take up: it acts at edges that are free or whose springs let them turn.
        """
        sheet = Sheet(self.domain)
        poisson = sheet.largest_poisson
        free = self.space.boundary_facets("free")
        load = edge_moment(self.space, free, sheet.bending, poisson, None)
        rotation = self.domain.model.clamp.rotation
        if np.isfinite(rotation):
            held = self.space.boundary_facets("clamped")
            load = load + edge_moment(self.space, held, sheet.bending, poisson, rotation)
        return load

    def admissible(self, parity: Parity, bow: Parity) -> csc_matrix:
        """Columns that span the motions of a parity about a bow of a parity, (3·size, n_free)."""
        free = self._operators.free(parity)
        across = csc_matrix(
            (np.ones(len(free)), (free, np.arange(len(free)))), shape=(self.space.size, len(free))
        )
        even = tuple(a * b > 0 for a, b in zip(parity, bow, strict=True))
        return csc_matrix(block_diag([self._supports(even), across]))

    def _supports(self, even: tuple[bool, ...]) -> csc_matrix:
        return in_plane_supports(
            self.space, self.domain.wedge, self.edge, even, self.domain.model.clamp
        )

    def linear(self, parity: Parity) -> csc_matrix:
        """Return K of deflections of a parity and the edge's in-plane springs, (3·size, 3·size)."""
        springs = in_plane_springs(self.space, self.domain.model.clamp)
        return csc_matrix(block_diag([springs, self._operators.stiffness(parity)]))

    def stretching(self, state: Array, stressed: bool = True) -> tuple[Array, csc_matrix]:
        """Return the first and second derivative of ∫ ½ h C E : E.

        stressed: else the strain of the state itself counts as relaxed.
        """
        force = np.zeros(3 * self.space.size)
        tangent = Assembly(3 * self.space.size)
        for cell in self._cells():
            dofs, w = self._unknowns(cell)
            moduli = self._membrane(cell)
            grad = np.einsum("eqxj,ej->eqx", slope(cell.jet), state[w])
            rows = strain_rows(cell.jet, grad)
            tangent.add(local_matrices(rows, moduli, cell.dx), dofs)
            if stressed:
                strain = np.einsum(
                    "eqcj,ej->eqc", in_plane_strain(cell.jet), state[dofs[:, : -w.shape[1]]]
                ) + stretch(grad, grad)
                stress = (strain[..., None, :] @ moduli)[..., 0, :]
                np.add.at(force, dofs, local_vectors(rows, stress, cell.dx))
                tangent.add(local_matrices(slope(cell.jet), as_matrix(stress), cell.dx), w)
        return force, tangent.matrix()

    def coupling(self, state: Array, parity: Parity) -> tuple[Array, csc_matrix]:
        """Return the first and second derivative of what eccentric layers add to the energy.

        The latter is that of motions of a parity about the state.
        """
        if self._beside is not None:
            return self._beside.derivatives(state, parity)
        size = 3 * self.space.size
        return np.zeros(size), csc_matrix((size, size))

    def second_order(
        self, state: Array, motions: Array, parities: tuple[Parity, ...]
    ) -> tuple[Array, Array]:
        """Return what motions x (n, 3·size), of some parities, cause at second order about a state.

        With E₁(y) = ε(u_y) + sym(∇w₀⊗∇w_y) and E₂(x, y) = ½ sym(∇w_x⊗∇w_y): the load (3·size, n),
        by unknowns y, ∫ h C [E₁(y) : E₂(x, x) + 2 E₁(x) : E₂(x, y)], and ∫ h C E₂ : E₂ (n,), over
        the wedge.
        """
        loads = np.zeros((3 * self.space.size, len(motions)))
        energies = np.zeros(len(motions))
        for cell in self._cells():
            dofs, w = self._unknowns(cell)
            moduli = self._membrane(cell)
            half = slope(cell.jet)
            rest = strain_rows(cell.jet, np.einsum("eqxj,ej->eqx", half, state[w]))
            for k, motion in enumerate(motions):
                grad = np.einsum("eqxj,ej->eqx", half, motion[w])
                moved = strain_rows(cell.jet, grad)[..., -w.shape[1] :]
                first = np.einsum("eqcj,ej->eqc", rest, motion[dofs])
                second = stretch(grad, grad)
                stress, own = (
                    np.einsum("eqcd,eqd->eqc", moduli, strain) for strain in (second, first)
                )
                np.add.at(loads[:, k], dofs, local_vectors(rest, stress, cell.dx))
                np.add.at(loads[:, k], w, local_vectors(moved, own, cell.dx))
                energies[k] += np.einsum("eqc,eqc,eq->", second, stress, cell.dx)
        if self._beside is not None:
            loads += self._beside.second_order(motions, parities)
        return loads, energies

    def relax(self, deflection: Array, even: Parity) -> Array:
        """Return the state of a given w (size,), relaxed in plane."""
        size = self.space.size
        state = np.concatenate([np.zeros(2 * size), deflection])
        supports = self._supports(tuple(p > 0 for p in even))
        force, tangent = self.stretching(state)
        plane = tangent[: 2 * size, : 2 * size] + in_plane_springs(
            self.space, self.domain.model.clamp
        )
        solve = factorize(csc_matrix(supports.T @ plane @ supports))
        state[: 2 * size] = -(supports @ solve(supports.T @ force[: 2 * size]))
        return state

    def deflect(self, load: Array, parity: Parity, state: Array | None = None) -> Array:
        """Return the state that carries a load (size,) [N per unknown] of w, by Newton's method.

        Newton's method begins at a nearby state, else at the flat film.

        Raises: ConvergenceError.
        """
        size = self.space.size
        state = np.zeros(3 * size) if state is None else state
        force = np.concatenate([np.zeros(2 * size), load])
        columns = self.admissible(parity, parity)
        linear = self.linear(parity)
        for _ in range(STEPS):
            pull, tangent = self.stretching(state)
            beside, coupled = self.coupling(state, parity)
            rest = columns.T @ (force - pull - beside - linear @ state)
            stiffness = columns.T @ (tangent + coupled + linear) @ columns
            try:
                step = factorize(csc_matrix(stiffness))(rest)
            except ConvergenceError as error:  # a step went so far that the film under it buckles
                raise ConvergenceError(
                    f"the static deflection did not converge, as {error}; lower the load"
                ) from error
            state = state + columns @ step
            if rest @ step <= SETTLED * abs(force @ state):
                return state
        raise ConvergenceError(
            f"the static deflection did not converge in {STEPS} steps of Newton's method; lower "
            "the load"
        )

    def _cells(self) -> Iterator[Cell]:
        return cells(self.space, quadrature_order(self.domain.model, 4 * self.space.degree - 4))

    def _unknowns(self, cell: Cell) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return all unknowns of a cell's triangles, and those of w."""
        w = self.space.dofs[cell.triangles] + 2 * self.space.size
        return np.concatenate([vector_dofs(self.space, cell.triangles), w], axis=1), w
