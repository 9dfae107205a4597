"""What an edge that yields in the plane of the film does to its modes."""

import numpy as np
from numpy.typing import NDArray

from femnl.core.mechanics import Modes, Prestress
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import as_matrix, cells, quadrature_order
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.stress import relaxed_stress
from femnl.mechanics.modes.projection import film_images
from femnl.mechanics.modes.solve import solve_modes
from femnl.mechanics.prestress import solve_yielding

Array = NDArray[np.float64]

DEGREE = 4
"""Of the elements of u: at a corner that yields the stress is uneven."""


def yielded(modes: Modes, compliance: float) -> Array:
    """Return what an edge adds to the stiffness of the base modes over the film stress.

    A film without holes is solved anew: uneven stress at the corners takes more modes than these to
    converge. The matrix (n, n) [m] then has the solved frequencies, and the solved shapes as far as
    base modes span them. Holes make that too long, and the matrix is the integral of the stress.

    Args: compliance: λ of `solve_yielding`, in m.
    """
    edge = solve_yielding(modes.domain, DEGREE, compliance)
    change = _work(modes, edge)
    if len(modes.domain.model.holes.centres):
        return change
    solved = solve_modes(edge, len(modes.frequency), modes.degree)
    stress = modes.domain.model.film.stress
    overlap = _overlap(modes, solved)
    for parity in set(modes.parity):
        mine = np.flatnonzero([own == parity for own in modes.parity])
        theirs = np.flatnonzero([own == parity for own in solved.parity])[: len(mine)]
        block = np.ix_(mine, mine)
        root = np.sqrt(modes.effective_mass[mine])
        before = np.diag((2 * np.pi * modes.frequency[mine]) ** 2)
        # Orthogonal vectors nearest to the solved shapes; where fewer are solved than there are
        # base modes, the rest keeps the integrals
        left, _, right = np.linalg.svd(overlap[np.ix_(mine, theirs)], full_matrices=False)
        turned = left @ right
        rest = np.eye(len(mine)) - turned @ turned.T
        after = (turned * (2 * np.pi * solved.frequency[theirs]) ** 2) @ turned.T
        after += rest @ (before + stress * change[block] / np.outer(root, root)) @ rest
        change[block] = np.outer(root, root) * (after - before) / stress
    return change


def _overlap(modes: Modes, solved: Modes) -> Array:
    """∫ ρh ξᵢ ψⱼ over the film, both normalised by their mass, (n, n)."""
    domain = modes.domain
    space = Space(domain.mesh, modes.degree)
    sheet = Sheet(domain)
    order = quadrature_order(domain.model, 2 * modes.degree)
    found = np.zeros((len(modes.frequency), len(solved.frequency)))
    for cell in cells(space, order):
        weight = sheet.density(cell.triangles) * sheet.thickness(cell.triangles, cell.jet.point)
        area = (weight * cell.dx).ravel()
        mine, theirs = (
            (cell.jet.value @ one.shapes[:, space.dofs[cell.triangles]].transpose(1, 2, 0)).reshape(
                len(area), -1
            )
            for one in (modes, solved)
        )
        found += mine.T @ (area[:, None] * theirs)
    return np.asarray(
        domain.copies * found / np.sqrt(np.outer(modes.effective_mass, solved.effective_mass))
    )


def _work(modes: Modes, edge: Prestress) -> Array:
    """∫ h ΔS : ∇ξᵢ∇ξⱼ / σ₀ over the whole film, (n, n) [m].

    ΔS is the stress on that edge less the one that the modes were solved with.
    """
    domain = modes.domain
    space = Space(domain.mesh, modes.degree)
    sheet = Sheet(domain)
    order = quadrature_order(domain.model, 2 * modes.degree - 2)
    n = len(modes.frequency)
    slopes = np.zeros((n, n))
    fields = zip(relaxed_stress(edge, order), relaxed_stress(modes.prestress, order), strict=True)
    for cell, (after, before) in zip(cells(space, order), fields, strict=True):
        local = modes.shapes[:, space.dofs[cell.triangles]].transpose(1, 2, 0)
        slope = cell.jet.gradient @ local[:, None]
        volume = sheet.thickness(cell.triangles, cell.jet.point) * cell.dx
        pulled = (volume[..., None, None] * as_matrix(after - before)) @ slope
        slopes += slope.reshape(-1, n).T @ pulled.reshape(-1, n)
    signs = sum(np.outer(sign, sign) for _, sign in film_images(domain, modes.parity))
    return np.asarray(signs * slopes / domain.model.film.stress)
