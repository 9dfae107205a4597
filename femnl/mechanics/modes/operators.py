"""Stiffness and mass of the deflection w: tension by the relaxed stress, plate bending, inertia."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.domain import Domain, Prestress
from femnl.core.errors import ParameterError
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import (
    Assembly,
    Term,
    as_matrix,
    cells,
    curvature,
    deflection,
    local_matrices,
    quadrature_order,
    slope,
)
from femnl.mechanics.fem.interior_penalty import slope_terms
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.stress import relaxed_tension
from femnl.mechanics.fem.supports import deflection_springs, free_deflections, slope_held_facets

Array = NDArray[np.float64]


class Operators:
    """K and M of the deflection w.

    ∫ N : ∇w⊗∇v + D[(1−ν)∇∇w:∇∇v + ν Δw Δv] + ∮ k w v + k_θ ∂ₙw ∂ₙv = ω² ∫ ρh w v, with N = h(σ₀
    I + C ε(u)).

    Args: prestress: the relaxed stress. degree: polynomial degree of w, 2 to 4 (1 without bending).
        about_middle: bend layers about the middle of the film, not about the neutral plane.
    Attributes: space; mass (size, size) on all unknowns.
    """

    def __init__(self, prestress: Prestress, degree: int, about_middle: bool = False) -> None:
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
        sheet = self._sheet
        self._bending = sheet.bending_about_middle if about_middle else sheet.bending
        self._prestress = prestress
        self._springs = deflection_springs(self.space, domain.model.clamp)
        stiffness = Assembly(self.space.size)
        for terms in self._in_triangles():
            local = sum(local_matrices(term.strain, term.moduli, term.dx) for term in terms)
            stiffness.add(np.asarray(local), terms[0].dofs)
        if self._bends:
            self._add(stiffness, self._between_triangles())
        self._stiffness = csc_matrix(stiffness.matrix() + self._springs)
        self.mass = mass_matrix(domain, self.space)

    def free(self, parity: tuple[int, ...]) -> NDArray[np.int64]:
        """Return the unknowns of deflections of a parity about the mirrors that nothing holds."""
        return free_deflections(self.space, parity, self._domain.model.clamp)

    def stiffness(self, parity: tuple[int, ...]) -> csc_matrix:
        """Return K (size, size) for deflections of the given parity about the mirrors.

        The parity decides which slopes are held.
        """
        if not self._bends:
            return self._stiffness
        edge = Assembly(self.space.size)
        self._add(edge, self._at_held_edges(parity))
        return csc_matrix(self._stiffness + edge.matrix())

    def quotients(self, shapes: Array, parity: tuple[tuple[int, ...], ...]) -> Array:
        """Return ω² (n,) of shapes (n, size) as Rayleigh's quotients of integrated energies.

        Entries of K go as D (degree²/size)⁴ and may exceed ω²M 1e14 times, so that wᵀKw keeps two
        digits of 16. Curvatures at points keep twice as many.
        """
        energies = np.einsum("ni,ni->n", shapes, (self._springs @ shapes.T).T)
        for terms in self._in_triangles():
            energies += sum(term.energies(shapes) for term in terms)
        if self._bends:
            for term in self._between_triangles():
                energies += term.energies(shapes)
            for each in set(parity):
                alike = [k for k, p in enumerate(parity) if p == each]
                for term in self._at_held_edges(each):
                    energies[alike] += term.energies(shapes[alike])
        return np.asarray(energies / np.einsum("ni,ni->n", shapes, (self.mass @ shapes.T).T))

    def _in_triangles(self) -> Iterator[list[Term]]:
        """The terms of tension and bending, chunk by chunk."""
        order = quadrature_order(self._domain.model, 2 * self.space.degree)
        for cell, tension in zip(
            cells(self.space, order, second=self._bends),
            relaxed_tension(self._prestress, order),
            strict=True,
        ):
            dofs = self.space.dofs[cell.triangles]
            terms = [Term(slope(cell.jet), as_matrix(tension), cell.dx, dofs)]
            if self._bends:
                moduli = self._bending(cell.triangles, cell.jet.point)
                terms.append(Term(curvature(cell.jet), moduli, cell.dx, dofs))
            yield terms

    def _between_triangles(self) -> Iterator[Term]:
        inside = np.flatnonzero(self._domain.mesh.f2t[1] >= 0)
        return self._slope_terms(inside)

    def _at_held_edges(self, parity: tuple[int, ...]) -> Iterator[Term]:
        """The terms of mirrors about which deflections are even, and of clamped edges."""
        facets = slope_held_facets(self.space, parity)
        clamped = np.isin(facets, self.space.boundary_facets("clamped"))
        yield from self._slope_terms(facets[~clamped])
        yield from self._slope_terms(facets[clamped], self._domain.model.clamp.rotation)

    def _slope_terms(self, facets: NDArray[np.int64], rotation: float = np.inf) -> Iterator[Term]:
        poisson = self._sheet.largest_poisson
        return slope_terms(self.space, facets, self._bending, poisson, rotation)

    @staticmethod
    def _add(assembly: Assembly, terms: Iterator[Term]) -> None:
        for term in terms:
            assembly.add(local_matrices(term.strain, term.moduli, term.dx), term.dofs)


def mass_matrix(domain: Domain, space: Space) -> csc_matrix:
    """Return M of ∫ ρh w v over the mesh, (size, size) [kg]."""
    mass = Assembly(space.size)
    sheet = Sheet(domain)
    for cell in cells(space, quadrature_order(domain.model, 2 * space.degree)):
        weight = sheet.inertia(cell.triangles, cell.jet.point) * cell.dx
        mass.add(
            local_matrices(deflection(cell.jet), np.eye(1), weight), space.dofs[cell.triangles]
        )
    return mass.matrix()
