"""The film stress after release: it relaxes in plane until holes and free edges carry no traction."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.fem.elements import Space
from femnl.fem.forms import Assembly, cells, in_plane_strain, local_matrices, local_vectors, vector_dofs
from femnl.fem.sheet import Sheet
from femnl.fem.solvers import factorize
from femnl.fem.supports import in_plane_draw, in_plane_springs, in_plane_supports
from femnl.types.device import Edge
from femnl.types.mechanics import Domain, Prestress

Array = NDArray[np.float64]


def solve_prestress(domain: Domain, degree: int, edge: Edge = "clamped") -> Prestress:
    """Relax the film stress: find u with ∫ h (σ₀ I + C ε(u)) : ε(v) + ∮ k (u − u₀)·v ds = 0 for all v, u held where the edge is rigid.

    Springs of an elastic edge are at rest at u₀ = 0, the edge of the film as deposited, or `draw` inwards of it: the film's whole pull
    displaces them.

    Args: domain: the meshed film. degree: polynomial degree of u, 1 to 4. edge: `clamped` u = 0 on the clamped part of the outline,
        or `sliding` u·n = 0 and no shear there, as on the mirror lines between the cells of a lattice.
    Returns: u [m] at the unknowns of (u_x, u_y); zero where an even film is clamped all around.
    Raises: ConvergenceError where the film is not supported.
    Source: plane stress with the film stress as initial stress; checked by `validation/unit_cell.py`.
    """
    space = Space(domain.mesh, degree)
    sheet, clamp = Sheet(domain), domain.model.clamp
    load = in_plane_draw(space, clamp)
    assembly = Assembly(2 * space.size)
    for cell in cells(space, 2 * degree):
        strain, h = in_plane_strain(cell.jet), sheet.thickness(cell.triangles, cell.jet.point)
        dofs = vector_dofs(space, cell.triangles)
        np.add.at(load, dofs, -local_vectors(strain, h[..., None] * sheet.stress(cell.triangles), cell.dx))
        assembly.add(local_matrices(strain, sheet.moduli(cell.triangles), h * cell.dx), dofs)
    matrix = assembly.matrix() + in_plane_springs(space, clamp)
    supports = in_plane_supports(space, domain.wedge, edge, (True, True), clamp)
    return Prestress(domain, degree, supports @ factorize(csc_matrix(supports.T @ matrix @ supports))(supports.T @ load))
