"""Modes of a perforated rectangle with an even film in the place of its lattice of holes.

The margin without holes around the lattice stays.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from skfem import MeshTri1, MeshTri2

from femnl.core.device import Edge, Model
from femnl.core.domain import Domain, Prestress
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.core.outline import Holes
from femnl.device.mesh import bending_length, film_middle
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import (
    Assembly,
    Cell,
    as_matrix,
    cells,
    curvature,
    deflection,
    in_plane_strain,
    local_matrices,
    local_vectors,
    plane_stress,
    slope,
    vector_dofs,
)
from femnl.mechanics.fem.interior_penalty import isotropic, slope_continuity
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.fem.supports import (
    deflection_springs,
    free_deflections,
    in_plane_draw,
    in_plane_springs,
    in_plane_supports,
    slope_held_facets,
)
from femnl.mechanics.lattice.cell import Cell as LatticeCell
from femnl.mechanics.lattice.cell import solve_cell
from femnl.mechanics.lattice.tiling import array
from femnl.mechanics.modes import solve_pencil
from femnl.mechanics.nonlinearity import solve_nonlinearity, strain_energies

Array = NDArray[np.float64]

DEGREE = 4
QUARTER = np.pi / 2
# elements at the edge in bending lengths, what they gain per distance, and along half a side
LAYER_SIZE = 1.0
GROWTH = 0.6
ACROSS = 8


@dataclass(frozen=True)
class _Film:
    """Two films: the lattice's in the box |x| < reach[0], |y| < reach[1], the bare one around."""

    model: Model
    cell: LatticeCell
    reach: Array

    def choose(self, inside: Array | float, outside: Array | float) -> Callable[[Array], Array]:
        """Return a field with one value on each side, by the place (..., 2) of points.

        Sides do not share points of quadrature.
        """

        def field(point: Array) -> Array:
            within = np.all(np.abs(point) < self.reach, axis=-1)
            return np.where(within.reshape(within.shape + (1,) * np.ndim(inside)), inside, outside)

        return field

    @property
    def membrane(self) -> Callable[[Array], Array]:
        film = self.model.film
        return self.choose(
            self.cell.stiffness, film.thickness * plane_stress(film.young, film.poisson)
        )

    @property
    def tension(self) -> Callable[[Array], Array]:
        film = self.model.film
        even = np.array([1.0, 1.0, 0.0])
        return self.choose(self.cell.tension * even, film.stress * film.thickness * even)

    @property
    def mass(self) -> Callable[[Array], Array]:
        return self.choose(self.cell.mass, self.model.film.density * self.model.film.thickness)

    @property
    def rigidity(self) -> Callable[[Array], Array]:
        film = self.model.film
        return self.choose(
            (self.cell.d_axis + self.cell.d_mixed) / 2,
            film.young * film.thickness**3 / 12 / (1 - film.poisson**2),
        )


def solve_homogenised(
    model: Model, count: int, edge: Edge | None = None, tensor: bool = False
) -> tuple[Modes, Nonlinearity]:
    """Return modes and nonlinearity of a rectangle with a rectangular array of holes.

    The array is taken as an even film.

    ∫ N : ∇w⊗∇w + D κ : κ = ω² ∫ μ w², N = T + C ε(u), with T, C, D and μ of one cell inside the
    array and of the film around it.

    Args: count: how many modes. edge: in-plane edge of the nonlinearity, the model's by default.
    tensor: see `solve_nonlinearity`.
    Returns: Modes on a mesh without holes, whose max|ξ| knows no holes, and their Nonlinearity.
    Raises: ParameterError for outlines that are no rectangle and holes that are no array about its
    centre.
    Valid: waves long against the pitch. Measured against the full model by
    tests/physics/test_lattice.py.
    Source: see `solve_cell`.
    """
    pitch, reach = _array(model)
    film = _Film(model, solve_cell(model, pitch), reach)
    domain = Domain(
        replace(model, holes=Holes(np.empty((0, 2)), 0.0)), _mesh(model, reach), QUARTER
    )
    prestress = _relax(film, domain)
    modes = solve_pencil(_Operators(film, prestress), prestress, count)
    membrane = film.membrane
    energies = partial(
        strain_energies, edge=edge or model.edge, membrane=lambda cell: membrane(cell.jet.point)
    )
    return modes, solve_nonlinearity(modes, edge or model.edge, tensor, energies)


def _array(model: Model) -> tuple[float, Array]:
    """Return the pitch, and half the sides of the box of whole cells; refuse unsuited films.

    Raises: ParameterError for a film that the homogenised one cannot stand for.
    """
    if model.layers:
        raise ParameterError(
            f"{model.name}: [layers]: the homogenised film carries none; solve the full film"
        )
    if model.overhang is not None or any(model.film.gradient) or model.film.taper > 0:
        raise ParameterError(
            f"{model.name}: the homogenised film knows no overhang, no gradient of the thickness "
            "and no taper; solve the full film"
        )
    if not all(s.clamped for s in model.outline.segments):
        raise ParameterError(
            f"{model.name}: the homogenised film is held at all its edges, and one of this film's "
            "ends free; solve the full film"
        )
    if film_middle(model).any():
        x, y = film_middle(model)
        raise ParameterError(
            f"{model.name}: the homogenised film lies about the origin, and the middle of this one "
            f"at ({x:.4g}, {y:.4g}) m; move it there, or solve the full film"
        )
    pitch, counts = array(model, "the homogenised film")
    return pitch, np.array(counts) * pitch / 2


def _mesh(model: Model, reach: Array) -> MeshTri2:
    """Mesh a quarter in rows and columns of triangles, fine at the clamped edge.

    A line of the mesh lies on the border of the array.
    """
    corners = np.array([s.start for s in model.outline.segments])
    lines = [
        _lines(half, box, bending_length(model))
        for half, box in zip(np.abs(corners).max(axis=0), reach, strict=True)
    ]
    grid = MeshTri2.from_mesh(MeshTri1.init_tensor(*lines))
    x, y = grid.p
    edges = {
        "mirror-0": (y, 0.0),
        "mirror-1": (x, 0.0),
        "right": (x, lines[0][-1]),
        "top": (y, lines[1][-1]),
    }
    found = {
        name: np.flatnonzero(np.all(along[grid.facets] == place, axis=0))
        for name, (along, place) in edges.items()
    }
    bounds = {"clamped": np.union1d(found.pop("right"), found.pop("top")), **found}
    return MeshTri2(np.ascontiguousarray(grid.doflocs), grid.t, _boundaries=bounds)


def _lines(half: float, box: float, layer: float) -> Array:
    """Return places from 0 to half, closer towards half, with one at the box."""
    places = [half]
    largest = half / ACROSS
    while places[-1] > 0:
        size = min(largest, max(LAYER_SIZE * layer, half / 64) + GROWTH * (half - places[-1]))
        places.append(places[-1] - size)
        if places[-1] < box < places[-2]:
            places[-1] = box
    places[-1] = 0.0
    if places[-2] < largest / 3:
        del places[-2]
    return np.array(places[::-1])


def _relax(film: _Film, domain: Domain) -> Prestress:
    """Relax the two films' tension in plane, clamped at the outline."""
    space = Space(domain.mesh, DEGREE)
    load = in_plane_draw(space, domain.model.clamp)
    matrix = Assembly(2 * space.size)
    for cell in cells(space, 2 * DEGREE):
        basis = in_plane_strain(cell.jet)
        dofs = vector_dofs(space, cell.triangles)
        np.add.at(load, dofs, -local_vectors(basis, film.tension(cell.jet.point), cell.dx))
        matrix.add(local_matrices(basis, film.membrane(cell.jet.point), cell.dx), dofs)
    supports = in_plane_supports(space, domain.wedge, "clamped", (True, True), domain.model.clamp)
    solve = factorize(
        csc_matrix(
            supports.T @ (matrix.matrix() + in_plane_springs(space, domain.model.clamp)) @ supports
        )
    )
    return Prestress(domain, DEGREE, supports @ solve(supports.T @ load))


class _Operators:
    """K and M of the two films."""

    def __init__(self, film: _Film, prestress: Prestress) -> None:
        domain = prestress.domain
        self.space = Space(domain.mesh, DEGREE)
        self._film = film
        self._bends = domain.model.bending
        stiffness = Assembly(self.space.size)
        mass = Assembly(self.space.size)
        poisson = film.model.film.poisson
        bend = plane_stress(1.0, poisson) * (1 - poisson**2)
        for cell in cells(self.space, 2 * DEGREE, second=self._bends):
            dofs = self.space.dofs[cell.triangles]
            point = cell.jet.point
            mass.add(
                local_matrices(deflection(cell.jet), np.eye(1), film.mass(point) * cell.dx), dofs
            )
            local = local_matrices(
                slope(cell.jet), as_matrix(self._stress(prestress, cell)), cell.dx
            )
            if self._bends:
                local += local_matrices(curvature(cell.jet), bend, film.rigidity(point) * cell.dx)
            stiffness.add(local, dofs)
        if self._bends:
            self._continue_slopes(stiffness, np.flatnonzero(domain.mesh.f2t[1] >= 0))
        self._stiffness = csc_matrix(
            stiffness.matrix() + deflection_springs(self.space, domain.model.clamp)
        )
        self.mass = mass.matrix()

    def _stress(self, prestress: Prestress, cell: Cell) -> Array:
        """Return N = T + C ε(u) [N/m] as (xx, yy, xy)."""
        local = prestress.displacement[vector_dofs(self.space, cell.triangles)]
        strain = np.einsum("eqcj,ej->eqc", in_plane_strain(cell.jet), local)
        point = cell.jet.point
        return np.asarray(
            self._film.tension(point)
            + np.einsum("eqcd,eqd->eqc", self._film.membrane(point), strain)
        )

    def _continue_slopes(
        self, assembly: Assembly, facets: NDArray[np.int64], rotation: float = np.inf
    ) -> None:
        poisson = self._film.model.film.poisson
        bending = isotropic(self._film.rigidity, poisson)
        for local, dofs in slope_continuity(self.space, facets, bending, poisson, rotation):
            assembly.add(local, dofs)

    def free(self, parity: tuple[int, ...]) -> NDArray[np.int64]:
        """Return unknowns of deflections of the given parity that nothing holds."""
        return free_deflections(self.space, parity, self._film.model.clamp)

    def stiffness(self, parity: tuple[int, ...]) -> csc_matrix:
        """Return K (size, size) for deflections of the given parity about the mirrors."""
        if not self._bends:
            return self._stiffness
        edge = Assembly(self.space.size)
        facets = slope_held_facets(self.space, parity)
        clamped = np.isin(facets, self.space.boundary_facets("clamped"))
        self._continue_slopes(edge, facets[~clamped])
        self._continue_slopes(edge, facets[clamped], self._film.model.clamp.rotation)
        return csc_matrix(self._stiffness + edge.matrix())
