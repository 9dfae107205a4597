"""The relaxed film stress, evaluated where integrals need it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.core.domain import Domain, Prestress
from femnl.core.operators import Units, weights
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import Cell, cells, in_plane_strain, vector_dofs
from femnl.mechanics.fem.sheet import Sheet

Array = NDArray[np.float64]


def relaxed_stress(prestress: Prestress, order: int) -> list[Array]:
    """Film stress σ₀ I + C ε(u) at the quadrature points of `cells(…, order)`, chunk by chunk.

    (e, q, 3) [Pa] as (xx, yy, xy).
    """
    sheet = Sheet(prestress.domain)
    strains = _strains(prestress.domain, prestress.degree, prestress.displacement[None], order)
    return [
        sheet.stress(cell.triangles)
        + (strain[0, ..., None, :] @ sheet.moduli(cell.triangles))[..., 0, :]
        for cell, strain in strains
    ]


def relaxed_tension(prestress: Prestress, order: int) -> list[Array]:
    """Return the tension N = Σ hᵢσᵢ I + A ε(u) of film and layers together, as above.

    (e, q, 3) [N/m] as (xx, yy, xy).
    """
    sheet = Sheet(prestress.domain)
    strains = _strains(prestress.domain, prestress.degree, prestress.displacement[None], order)
    found = []
    for cell, strain in strains:
        where = (cell.triangles, cell.jet.point)
        moved = (strain[0, ..., None, :] @ sheet.membrane(*where))[..., 0, :]
        found.append(sheet.tension(*where) + moved)
    return found


def unit_stress(domain: Domain, units: Units, order: int) -> Iterator[Array]:
    """What is left of a film stress of each of `WEIGHTS` times each of `DIRECTIONS`, as above.

    (6, 3, e, q, 3) [1], where xy stands for 1 in xy and in yx. Where layers lie, it is the tension
    that is left in film and layers together, by the thickness of the film.
    """
    sheet = Sheet(domain)
    shape = units.displacement.shape[:2]
    displacements = units.displacement.reshape(-1, units.displacement.shape[-1])
    for cell, strain in _strains(domain, units.degree, displacements, order):
        own = weights(np.moveaxis(cell.jet.point, -1, 0) / units.reach)[:, None, ..., None]
        where = (cell.triangles, cell.jet.point)
        moduli = sheet.membrane(*where) / sheet.thickness(*where)[..., None, None]
        moved = (strain[..., None, :] @ moduli)[..., 0, :]
        yield own * np.eye(shape[1])[:, None, None] + moved.reshape(*shape, *moved.shape[1:])


def _strains(
    domain: Domain, degree: int, displacements: Array, order: int
) -> Iterator[tuple[Cell, Array]]:
    """Strains of in-plane displacements (n, n_dofs) at the points of each chunk.

    (n, e, q, 3) as (xx, yy, 2xy).
    """
    space = Space(domain.mesh, degree)
    for cell in cells(space, order):
        local = displacements[:, vector_dofs(space, cell.triangles)]
        yield cell, np.einsum("eqcj,nej->neqc", in_plane_strain(cell.jet), local)
