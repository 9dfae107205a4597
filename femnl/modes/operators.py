"""Stiffness and mass of the deflection w: tension by the relaxed stress, plate bending, inertia."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.errors import ParameterError
from femnl.fem.elements import Space
from femnl.fem.forms import (
    Assembly,
    as_matrix,
    cells,
    curvature,
    deflection,
    local_matrices,
    plane_stress,
    slope,
    slope_continuity,
    thickness,
)
from femnl.fem.stress import relaxed_stress
from femnl.fem.supports import slope_held_facets
from femnl.types.mechanics import Domain, Prestress

Array = NDArray[np.float64]


class Operators:
    """K and M of ∫ N : ∇w⊗∇v + D[(1−ν)∇∇w:∇∇v + ν Δw Δv] = ω² ∫ ρh w v on one mesh, with N = h(σ₀ I + C ε(u)).

    Args: prestress: the relaxed stress. degree: polynomial degree of w, 2 to 4 (1 without bending).
    Attributes: space; mass (size, size) on all unknowns.
    """

    def __init__(self, prestress: Prestress, degree: int) -> None:
        domain, film = prestress.domain, prestress.domain.model.film
        if domain.model.bending and degree < 2:
            raise ParameterError(f"degree = {degree}: bending needs 2 or more, as straight elements have no curvature")
        self.space = Space(domain.mesh, degree)
        self._prestress, self._bends = prestress, domain.model.bending
        moduli = plane_stress(film.young, film.poisson)
        stiffness = Assembly(self.space.size)
        order = 2 * degree
        for cell, stress in zip(cells(self.space, order, second=self._bends), relaxed_stress(prestress, order), strict=True):
            h, dofs = thickness(domain.model, cell.jet.point), self.space.dofs[cell.triangles]
            local = local_matrices(slope(cell.jet), as_matrix(stress), h * cell.dx)
            if self._bends:
                local += local_matrices(curvature(cell.jet), moduli, h**3 / 12 * cell.dx)
            stiffness.add(local, dofs)
        if self._bends:
            inside = np.flatnonzero(domain.mesh.f2t[1] >= 0)
            self._add_slope_continuity(stiffness, inside)
        self._stiffness = stiffness.matrix()
        self.mass = mass_matrix(domain, self.space)

    def stiffness(self, parity: tuple[int, ...]) -> csc_matrix:
        """K (size, size) for deflections of the given parity about the mirrors: held slopes depend on it."""
        facets = slope_held_facets(self.space, parity)
        if not self._bends or len(facets) == 0:
            return self._stiffness
        edge = Assembly(self.space.size)
        self._add_slope_continuity(edge, facets)
        return csc_matrix(self._stiffness + edge.matrix())

    def _add_slope_continuity(self, assembly: Assembly, facets: NDArray[np.int64]) -> None:
        model = self._prestress.domain.model
        film = model.film

        def rigidity(point: Array) -> Array:
            return np.asarray(film.young * thickness(model, point) ** 3 / 12 / (1 - film.poisson**2))

        for local, dofs in slope_continuity(self.space, facets, rigidity, film.poisson):
            assembly.add(local, dofs)


def mass_matrix(domain: Domain, space: Space) -> csc_matrix:
    """M of ∫ ρh w v over the mesh, (size, size) [kg]."""
    mass = Assembly(space.size)
    for cell in cells(space, 2 * space.degree):
        weight = domain.model.film.density * thickness(domain.model, cell.jet.point) * cell.dx
        mass.add(local_matrices(deflection(cell.jet), np.eye(1), weight), space.dofs[cell.triangles])
    return mass.matrix()
