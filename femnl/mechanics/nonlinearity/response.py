"""The displacement in plane by which the film gives way to a deflected mode's stretching."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.device import Edge
from femnl.core.modes import Modes
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.nonlinearity.stretching import film_membrane, stretching


def in_plane_response(modes: Modes, index: int, edge: Edge) -> NDArray[np.float64]:
    """Return the in-plane displacement of the film over q², where it is deflected by q·ξ.

    u relaxes the stretching: ∫ h C (ε(u) + ½ ∇ξ⊗∇ξ) : ε(v) = 0 for all v; k₃ = 2 ∫ h C E : E with E
    the strain in the bracket.

    Args: index: 0 for the fundamental mode. edge: in-plane condition of the outline.
    Returns: unknowns (2·size,) [1/m] of elements of the modes' degree on the wedge: those of u_x,
    then those of u_y.
    Valid: as `solve_nonlinearity`.
    """
    film = stretching(modes, [(index, index)], film_membrane(modes, edge))
    ((_, supports),) = film.sectors(modes.domain.wedge, edge)
    solve = factorize(csc_matrix(supports.T @ film.stiffness @ supports))
    return np.asarray(supports @ solve(supports.T @ film.loads[:, 0]))
