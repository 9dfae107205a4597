"""The relaxed film stress, evaluated where integrals need it."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.core.mechanics import Domain, Prestress
from femnl.core.operators import Units
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells, in_plane_strain, vector_dofs
from femnl.mechanics.fem.sheet import Sheet

Array = NDArray[np.float64]


def relaxed_stress(prestress: Prestress, order: int) -> list[Array]:
    """Film stress σ₀ I + C ε(u) at the quadrature points of `cells(…, order)`, chunk by chunk.

    (e, q, 3) [Pa] as (xx, yy, xy).
    """
    sheet = Sheet(prestress.domain)
    strains = _strains(prestress.domain, prestress.degree, prestress.displacement[None], order)
    return [
        sheet.stress(part) + (strain[0, ..., None, :] @ sheet.moduli(part))[..., 0, :]
        for part, strain in strains
    ]


def unit_stress(domain: Domain, units: Units, order: int) -> list[Array]:
    """What is left of a film stress of 1 in each of `DIRECTIONS` (xy: in xy and in yx), as above.

    (3, e, q, 3) [1].
    """
    sheet = Sheet(domain)
    own = np.eye(3)[:, None, None]
    strains = _strains(domain, units.degree, units.displacement, order)
    return [
        own + (strain[..., None, :] @ sheet.moduli(part))[..., 0, :] for part, strain in strains
    ]


def _strains(
    domain: Domain, degree: int, displacements: Array, order: int
) -> Iterator[tuple[slice, Array]]:
    """Strains of in-plane displacements (n, n_dofs) at the points of each chunk.

    (n, e, q, 3) as (xx, yy, 2xy).
    """
    space = Space(domain.mesh, degree)
    for cell in cells(space, order):
        local = displacements[:, vector_dofs(space, cell.triangles)]
        yield cell.triangles, np.einsum("eqcj,nej->neqc", in_plane_strain(cell.jet), local)
