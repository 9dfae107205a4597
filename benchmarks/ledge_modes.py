"""f22 − 2 f11 of a perforated square film whose edge moves in its plane, by place.

The film is that of `femnl.mechanics.lattice`: array of holes and margin as even films, with
bending and with the tension that the motion of the edge leaves. Stiff springs carry the edge.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.device import Clamp, Model
from femnl.core.domain import Domain, Prestress
from femnl.core.outline import Holes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import (
    Assembly,
    cells,
    in_plane_strain,
    local_matrices,
    local_vectors,
    vector_dofs,
)
from femnl.mechanics.fem.interior_penalty import edges_by_local_number, side_of_edge
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.fem.supports import in_plane_springs, in_plane_supports
from femnl.mechanics.lattice.cell import solve_cell
from femnl.mechanics.lattice.film import DEGREE, QUARTER, _array, _Film, _mesh, _Operators
from femnl.mechanics.modes import solve_pencil

Array = NDArray[np.float64]
Motion = Callable[[Array], tuple[Array, Array]]

F11 = 1.466060e6  # measured, arXiv:2502.19191
STIFF = Clamp(normal=1e13, shear=1e13)  # moves the edge by 0.02 nm under the film's tension


def detuning(model: Model, motion: Motion) -> float:
    """f22 − 2 f11 [Hz] at the measured f11, of a square with a square array of holes.

    Args: motion, from distances along a side from its middle (≥ 0) [m] to displacements inwards
    and along the edge towards its middle [m]; zero is the rigid edge.
    """
    model = replace(model, clamp=STIFF)
    pitch, reach = _array(model)
    film = _Film(model, solve_cell(model, pitch), reach)
    bare = replace(model, holes=Holes(np.empty((0, 2)), 0.0))
    domain = Domain(bare, _mesh(model, reach), QUARTER)
    space = Space(domain.mesh, DEGREE)
    load = _carried(space, motion)
    matrix = Assembly(2 * space.size)
    for cell in cells(space, 2 * DEGREE):
        basis = in_plane_strain(cell.jet)
        dofs = vector_dofs(space, cell.triangles)
        np.add.at(load, dofs, -local_vectors(basis, film.tension(cell.jet.point), cell.dx))
        matrix.add(local_matrices(basis, film.membrane(cell.jet.point), cell.dx), dofs)
    supports = in_plane_supports(space, domain.wedge, "clamped", (True, True), STIFF)
    whole = matrix.matrix() + in_plane_springs(space, STIFF)
    solve = factorize(csc_matrix(supports.T @ whole @ supports))
    prestress = Prestress(domain, DEGREE, supports @ solve(supports.T @ load))
    modes = solve_pencil(_Operators(film, prestress), prestress, 4)
    return float((modes.ratio[3] - 2) * F11)


def _carried(space: Space, motion: Motion) -> Array:
    """∫ (k u)·v along the edge (2·size,) [N]: the pull of springs that are at rest at u."""
    load = np.zeros(2 * space.size)
    for edges in edges_by_local_number(space, space.boundary_facets("clamped")):
        triangles = edges.triangles[0]
        jet, normal, ds = side_of_edge(space, triangles, edges.local[0], 2 * space.degree)
        along = np.abs(normal[..., ::-1])  # of the first quarter, away from the middle of the side
        inwards, towards = motion(np.einsum("eqc,eqc->eq", jet.point, along))
        rest = -inwards[..., None] * normal - towards[..., None] * along
        pull = STIFF.normal * ds[..., None] * rest
        rows = np.concatenate([pull[..., :1] * jet.value, pull[..., 1:] * jet.value], axis=-1)
        np.add.at(load, vector_dofs(space, triangles), rows.sum(axis=1))
    return load
