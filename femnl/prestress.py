"""The film stress after release: it relaxes in plane until holes and free edges carry no traction."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.fem.elements import Space
from femnl.fem.forms import Assembly, cells, in_plane_strain, local_matrices, local_vectors, plane_stress, thickness, vector_dofs
from femnl.fem.solvers import factorize
from femnl.fem.supports import in_plane_supports
from femnl.types.device import Edge
from femnl.types.mechanics import Domain, Prestress

Array = NDArray[np.float64]


def solve_prestress(domain: Domain, degree: int, edge: Edge = "clamped") -> Prestress:
    """Relax the film stress: find u with ∫ h (σ₀ I + C ε(u)) : ε(v) = 0 for all v, u held on the outline.

    Args: domain: the meshed film. degree: polynomial degree of u, 1 to 4. edge: `clamped` u = 0 on the clamped part of the outline,
        or `sliding` u·n = 0 and no shear there, as on the mirror lines between the cells of a lattice.
    Returns: u [m] at the unknowns of (u_x, u_y); zero where an even film is clamped all around.
    Raises: ConvergenceError where the film is not supported.
    Source: plane stress with the film stress as initial stress; checked by `validation/unit_cell.py`.
    """
    space = Space(domain.mesh, degree)
    film = domain.model.film
    moduli = plane_stress(film.young, film.poisson)
    load = np.zeros(2 * space.size)
    assembly = Assembly(2 * space.size)
    for cell in cells(space, 2 * degree):
        strain, h = in_plane_strain(cell.jet), thickness(domain.model, cell.jet.point)
        dofs = vector_dofs(space, cell.triangles)
        initial = film.stress * h[..., None] * np.array([1.0, 1.0, 0.0])
        np.add.at(load, dofs, -local_vectors(strain, initial, cell.dx))
        assembly.add(local_matrices(strain, moduli, h * cell.dx), dofs)
    supports = in_plane_supports(space, domain.wedge, edge, even=(True, True))
    return Prestress(domain, degree, supports @ factorize(csc_matrix(supports.T @ assembly.matrix() @ supports))(supports.T @ load))
