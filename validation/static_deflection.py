"""k₃ from the static deflection of the full geometrically nonlinear film, by Newton's method on its energy."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csc_matrix

import femnl
from femnl import geometry
from femnl.errors import ConvergenceError
from femnl.fem.elements import Space
from femnl.fem.forms import Assembly, cells, in_plane_strain, local_matrices, local_vectors, plane_stress, slope, thickness, vector_dofs
from femnl.fem.solvers import factorize
from femnl.fem.supports import free_deflections, in_plane_supports
from femnl.modes.operators import Operators
from femnl.types.mechanics import Modes
from femnl.validation import Case, Reference

Array = NDArray[np.float64]

SQUARE = """
name = "square"
source = "an even square film, without bending"
[outline]
kind = "square"
side = "100 um"
[film]
thickness = "200 nm"
young = "250 GPa"
poisson = 0.23
density = "3100 kg/m^3"
stress = "1 GPa"
[model]
bending = false
"""
HEXAGON = """
name = "hexagon"
source = "a stiff hexagon with large holes: bending, uneven thickness and a stress far from even"
[outline]
kind = "regular-polygon"
sides = 6
long_axis = "20 um"
[holes]
lattice = "square"
pitch = "4 um"
count = [3, 3]
radius = "1 um"
[film]
thickness = "500 nm"
young = "250 GPa"
poisson = 0.27
density = "3100 kg/m^3"
stress = "0.2 GPa"
taper = "150 nm"
taper_length = "1 um"
"""
STEPS = np.array([0.01, 0.02, 0.03, 0.04])  # wanted k₃q²/k


class Film:
    """Energy of one mode's symmetry: ½ w·K w + ∫ ½ h C E : E with E = ε(u) + ½ ∇w⊗∇w, about the relaxed film."""

    def __init__(self, modes: Modes, index: int) -> None:
        self.domain, film = modes.domain, modes.domain.model.film
        self.space, self.moduli = Space(self.domain.mesh, modes.degree), plane_stress(film.young, film.poisson)
        operators, parity = Operators(modes.prestress, modes.degree), modes.parity[index]
        self.linear, self.load = operators.stiffness(parity), operators.mass @ modes.shapes[index]
        free = free_deflections(self.space, parity)
        across = csc_matrix((np.ones(len(free)), (free, np.arange(len(free)))), shape=(self.space.size, len(free)))
        along = in_plane_supports(self.space, self.domain.wedge, "clamped", tuple(True for _ in parity))
        self.admissible = csc_matrix(block_diag([along, across]))

    def gradient(self, state: Array) -> tuple[Array, csc_matrix]:
        """First and second derivative of the energy in all unknowns (u_x, u_y, w)."""
        size = self.space.size
        force, tangent = np.zeros(3 * size), Assembly(3 * size)
        force[2 * size :] = self.linear @ state[2 * size :]
        for cell in cells(self.space, 4 * self.space.degree - 4):
            plane, w = vector_dofs(self.space, cell.triangles), self.space.dofs[cell.triangles] + 2 * size
            dofs, weight = np.concatenate([plane, w], axis=1), thickness(self.domain.model, cell.jet.point) * cell.dx
            grad = np.einsum("eqxj,ej->eqx", slope(cell.jet), state[w])
            dx, dy = cell.jet.gradient[:, :, 0], cell.jet.gradient[:, :, 1]
            wx, wy = grad[..., :1], grad[..., 1:]
            rows = np.concatenate([in_plane_strain(cell.jet), np.stack([wx * dx, wy * dy, wx * dy + wy * dx], axis=2)], axis=-1)
            stretched = np.stack([wx[..., 0] ** 2 / 2, wy[..., 0] ** 2 / 2, wx[..., 0] * wy[..., 0]], -1)
            strain = np.einsum("eqcj,ej->eqc", in_plane_strain(cell.jet), state[plane]) + stretched
            stress = strain @ self.moduli
            np.add.at(force, dofs, local_vectors(rows, stress, weight))
            tangent.add(local_matrices(rows, self.moduli, weight), dofs)
            tensor = np.stack([stress[..., [0, 2]], stress[..., [2, 1]]], -2)
            tangent.add(local_matrices(slope(cell.jet), tensor, weight), w)
        return force, csc_matrix(tangent.matrix() + block_diag([csc_matrix((2 * size, 2 * size)), self.linear]))

    def deflect(self, force: float, state: Array) -> Array:
        """The state in which the film carries the load force·Mξ/(ξ·Mξ), from a nearby one."""
        size = self.space.size
        load = np.concatenate([np.zeros(2 * size), force * self.load])
        for _ in range(30):
            pull, tangent = self.gradient(state)
            rest = self.admissible.T @ (load - pull)
            step = factorize(csc_matrix(self.admissible.T @ tangent @ self.admissible))(rest)
            state = state + self.admissible @ step
            if rest @ step < 1e-16 * (load @ state):
                return state
        raise ConvergenceError("the static deflection did not converge in 30 Newton steps")


def ratio(modes: Modes, index: int) -> float:
    """The cubic coefficient of the static force–deflection curve of one mode over its k₃."""
    film, square = Film(modes, index), (2 * np.pi * modes.frequency[index]) ** 2
    alpha = femnl.solve_nonlinearity(modes, edge="clamped").alpha[index]
    shape, size = modes.shapes[index], film.space.size
    state, bend, squares = np.zeros(3 * size), [], []
    for step in STEPS:
        force = square * np.sqrt(step / alpha) * (1 + step)
        state = film.deflect(force, state)
        q = film.load @ state[2 * size :] / (film.load @ shape)
        squares.append(q**2)
        bend.append((force / (square * q) - 1) / q**2)
    limit = np.polynomial.Polynomial.fit(squares, bend, len(STEPS) - 1)(0.0)
    return float(limit / alpha)


def compute() -> Iterator[float]:
    """Bend each film step by step, and take the curve's limit at no deflection."""
    modes = femnl.solve_modes(geometry.parse(SQUARE), count=4, resolution=0.7, cache=False)
    for index in (0, 1, 3):
        yield ratio(modes, index)
    modes = femnl.solve_modes(geometry.parse(HEXAGON), count=2, resolution=0.5, cache=False)
    for index in (0, 1):
        yield ratio(modes, index)


CASE = Case(
    claim="k₃ is the cubic coefficient of the static deflection under the mode's own load, in even and in perforated films",
    source="Newton's method on the von Kármán energy in all unknowns (u, w), four loads, limit by a polynomial in q²",
    references=(
        *(Reference(f"static/modal k₃, square {label}", 1.0, relative=1e-5) for label in ("(1,1)", "(2,1)", "(2,2)")),
        *(Reference(f"static/modal k₃, perforated hexagon, mode {k}", 1.0, relative=1e-5) for k in (1, 2)),
    ),
    compute=compute,
)
