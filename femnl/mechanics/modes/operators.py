"""Stiffness and mass of the deflection w: tension by the relaxed stress, plate bending, inertia."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.errors import ParameterError
from femnl.core.mechanics import Domain, Prestress
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import (
    Assembly,
    as_matrix,
    cells,
    curvature,
    deflection,
    local_matrices,
    quadrature_order,
    slope,
    slope_continuity,
)
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.stress import relaxed_tension
from femnl.mechanics.fem.supports import deflection_springs, free_deflections, slope_held_facets

Array = NDArray[np.float64]


class Operators:
    """K and M of the deflection w.

    ∫ N : ∇w⊗∇v + D[(1−ν)∇∇w:∇∇v + ν Δw Δv] + ∮ k w v + k_θ ∂ₙw ∂ₙv = ω² ∫ ρh w v, with N = h(σ₀
    I + C ε(u)).

    Args: prestress: the relaxed stress. degree: polynomial degree of w, 2 to 4 (1 without bending).
    Attributes: space; mass (size, size) on all unknowns.
    """

    def __init__(self, prestress: Prestress, degree: int) -> None:
        domain = prestress.domain
        if domain.model.bending and degree < 2:
            raise ParameterError(
                f"degree = {degree}: bending needs 2 or more, as straight elements have no "
                "curvature"
            )
        self.space = Space(domain.mesh, degree)
        self._domain = domain
        self._bends = domain.model.bending
        self._sheet = Sheet(domain)
        stiffness = Assembly(self.space.size)
        order = quadrature_order(domain.model, 2 * degree)
        for cell, tension in zip(
            cells(self.space, order, second=self._bends),
            relaxed_tension(prestress, order),
            strict=True,
        ):
            dofs = self.space.dofs[cell.triangles]
            local = local_matrices(slope(cell.jet), as_matrix(tension), cell.dx)
            if self._bends:
                moduli = self._sheet.bending(cell.triangles, cell.jet.point)
                local += local_matrices(curvature(cell.jet), moduli, cell.dx)
            stiffness.add(local, dofs)
        if self._bends:
            inside = np.flatnonzero(domain.mesh.f2t[1] >= 0)
            self._add_slope_continuity(stiffness, inside)
        self._stiffness = csc_matrix(
            stiffness.matrix() + deflection_springs(self.space, domain.model.clamp)
        )
        self.mass = mass_matrix(domain, self.space)

    def free(self, parity: tuple[int, ...]) -> NDArray[np.int64]:
        """Unknowns of deflections of the given parity about the mirrors that nothing holds."""
        return free_deflections(self.space, parity, self._domain.model.clamp)

    def stiffness(self, parity: tuple[int, ...]) -> csc_matrix:
        """K (size, size) for deflections of the given parity about the mirrors.

        Held slopes depend on it.
        """
        facets = slope_held_facets(self.space, parity)
        if not self._bends or len(facets) == 0:
            return self._stiffness
        edge = Assembly(self.space.size)
        clamped = np.isin(facets, self.space.boundary_facets("clamped"))
        self._add_slope_continuity(edge, facets[~clamped])
        self._add_slope_continuity(edge, facets[clamped], self._domain.model.clamp.rotation)
        return csc_matrix(self._stiffness + edge.matrix())

    def _add_slope_continuity(
        self, assembly: Assembly, facets: NDArray[np.int64], rotation: float = np.inf
    ) -> None:
        poisson = self._sheet.largest_poisson
        for local, dofs in slope_continuity(
            self.space, facets, self._sheet.bending, poisson, rotation
        ):
            assembly.add(local, dofs)


def mass_matrix(domain: Domain, space: Space) -> csc_matrix:
    """M of ∫ ρh w v over the mesh, (size, size) [kg]."""
    mass = Assembly(space.size)
    sheet = Sheet(domain)
    for cell in cells(space, quadrature_order(domain.model, 2 * space.degree)):
        weight = sheet.inertia(cell.triangles, cell.jet.point) * cell.dx
        mass.add(
            local_matrices(deflection(cell.jet), np.eye(1), weight), space.dofs[cell.triangles]
        )
    return mass.matrix()
