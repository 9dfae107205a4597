"""The relaxed film stress, evaluated where integrals need it."""

import numpy as np
from numpy.typing import NDArray

from femnl.fem.elements import Space
from femnl.fem.forms import cells, in_plane_strain, vector_dofs
from femnl.fem.sheet import Sheet
from femnl.types.mechanics import Prestress

Array = NDArray[np.float64]


def relaxed_stress(prestress: Prestress, order: int) -> list[Array]:
    """Film stress σ₀ I + C ε(u) at the quadrature points of `cells(…, order)`, chunk by chunk: (e, q, 3) [Pa] as (xx, yy, xy)."""
    domain = prestress.domain
    space, sheet = Space(domain.mesh, prestress.degree), Sheet(domain)
    result = []
    for cell in cells(space, order):
        local = prestress.displacement[vector_dofs(space, cell.triangles)]
        strain = np.einsum("eqcj,ej->eqc", in_plane_strain(cell.jet), local)
        result.append(sheet.stress(cell.triangles) + (strain[..., None, :] @ sheet.moduli(cell.triangles))[..., 0, :])
    return result
