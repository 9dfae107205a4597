"""Second-order strains of pairs of modes, and the film that relaxes them in its plane."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csc_matrix

from femnl.core.device import Clamp, Edge
from femnl.core.modes import Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import (
    Assembly,
    Cell,
    cells,
    deflection,
    in_plane_strain,
    local_matrices,
    quadrature_order,
    slope,
    stretch,
    vector_dofs,
)
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.supports import in_plane_springs, in_plane_supports

Array = NDArray[np.float64]
Membrane = Callable[[Cell], Array]
"""Stiffness h C (..., 3, 3) [N/m] at the points of a cell."""


def film_membrane(modes: Modes, edge: Edge) -> Membrane:
    """Return the stiffness h C [N/m] of the film at the points of a cell.

    For the edge `paper` it has no Poisson's ratio.
    """
    sheet = Sheet(modes.domain, 0.0 if edge == "paper" else None)
    return lambda cell: sheet.membrane(cell.triangles, cell.jet.point)


@dataclass(frozen=True)
class Stretching:
    """Integrals over the wedge of second-order strains of pairs P of modes.

    m_P = ½ sym(∇ξᵢ⊗∇ξⱼ), and u is the film's displacement in plane.

    energies (n_pairs, n_pairs) ∫ h C m_P : m_Q; loads (2·size, n_pairs) −∫ h C m_P : ε(v);
    stiffness ∫ h C ε(u) : ε(v) with the springs of the edge [N/m]; parities: of each pair under the
    wedge's mirrors. clamp: of the edge.
    """

    space: Space
    energies: Array
    loads: Array
    stiffness: csc_matrix
    parities: list[tuple[int, ...]]
    clamp: Clamp

    def sectors(self, wedge: float, edge: Edge) -> Iterator[tuple[list[int], csc_matrix]]:
        """Pairs of one parity, and in-plane displacements that edge and mirrors leave to them."""
        for parity in sorted(set(self.parities)):
            members = [k for k, p in enumerate(self.parities) if p == parity]
            yield (
                members,
                in_plane_supports(
                    self.space, wedge, edge, tuple(p > 0 for p in parity), self.clamp
                ),
            )


def stretching(modes: Modes, pairs: list[tuple[int, int]], membrane: Membrane) -> Stretching:
    """Integrate the second-order strains of pairs of modes.

    Args: membrane: h C (..., 3, 3) [N/m] at the points of a cell.
    """
    space = Space(modes.domain.mesh, modes.degree)
    first, second = np.array(pairs).T
    energies = np.zeros((len(pairs), len(pairs)))
    loads = np.zeros((2 * space.size, len(pairs)))
    stiffness = Assembly(2 * space.size)
    # The same points for all integrals: where h varies, G stays the energy of one discrete film.
    for cell in cells(space, quadrature_order(modes.domain.model, 4 * modes.degree - 4)):
        slopes = np.einsum(
            "eqxj,nej->neqx",
            slope(cell.jet),
            modes.shapes[:, space.dofs[cell.triangles]],
            optimize=True,
        )
        moduli = membrane(cell)
        strain = stretch(slopes[first], slopes[second])
        stress = (strain[..., None, :] @ moduli)[..., 0, :] * cell.dx[..., None]
        energies += strain.reshape(len(pairs), -1) @ stress.reshape(len(pairs), -1).T
        basis = in_plane_strain(cell.jet)
        dofs = vector_dofs(space, cell.triangles)
        np.add.at(loads, dofs, -np.einsum("eqcj,neqc->ejn", basis, stress, optimize=True))
        stiffness.add(local_matrices(basis, moduli, cell.dx), dofs)
    parities = [
        tuple(a * b for a, b in zip(modes.parity[i], modes.parity[j], strict=True))
        for i, j in pairs
    ]
    clamp = modes.domain.model.clamp
    return Stretching(
        space,
        energies,
        loads,
        csc_matrix(stiffness.matrix() + in_plane_springs(space, clamp)),
        parities,
        clamp,
    )


def same_parity_only(energies: Array, parities: list[tuple[int, ...]]) -> Array:
    """Integrals over the wedge of odd products vanish over the whole film."""
    same = np.array([[p == q for q in parities] for p in parities])
    return np.where(same, energies, 0.0)


def in_plane_mass(modes: Modes, space: Space) -> csc_matrix:
    """Return the mass ∫ ρh u·v over the wedge, (2·size, 2·size) [kg]."""
    sheet = Sheet(modes.domain)
    mass = Assembly(space.size)
    for cell in cells(space, quadrature_order(modes.domain.model, 2 * space.degree)):
        weight = sheet.inertia(cell.triangles, cell.jet.point) * cell.dx
        mass.add(
            local_matrices(deflection(cell.jet), np.eye(1), weight), space.dofs[cell.triangles]
        )
    return csc_matrix(block_diag([mass.matrix()] * 2))
