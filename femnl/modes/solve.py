"""Prestressed modes of the film, solved symmetry sector by symmetry sector, normalised, paired and labelled."""

from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.errors import ParameterError
from femnl.fem.elements import Space, nodes, reference_basis
from femnl.fem.solvers import lowest_eigenpairs
from femnl.fem.supports import free_deflections
from femnl.modes.operators import Operators, mass_matrix
from femnl.modes.shapes import canonical_pairs, label_shapes, largest_value
from femnl.types.mechanics import Modes, Prestress

Array = NDArray[np.float64]

DEGENERATE = 1e-6  # relative splitting of ω² below which two modes of one sector count as a degenerate pair


def solve_modes(prestress: Prestress, count: int, degree: int) -> Modes:
    """Solve ∫ N:∇w⊗∇v + D[(1−ν)∇∇w:∇∇v + νΔwΔv] = ω² ∫ ρh wv for the lowest modes.

    Args: prestress: the relaxed film stress. count: how many modes, by rising frequency. degree: of the elements, 2 to 4.
    Returns: modes with max|ξ| = 1; a wedge is solved in each of its symmetry sectors, so that degenerate pairs of different
        symmetry come apart by themselves, and those of the same symmetry are turned to diagonalise the x–y anisotropy.
    Raises: ParameterError, ConvergenceError. Valid: wedges of an eighth or twelfth hold the one-dimensional symmetries only.
    Source: Kirchhoff plate in tension; validation cases `ideal_membranes`, `clamped_plate`.
    """
    if count < 1:
        raise ParameterError(f"count = {count}: expected at least one mode")
    operators = Operators(prestress, degree)
    values, shapes, parity = _solve_sectors(operators, prestress.domain.copies, count)
    shapes = canonical_pairs(prestress.domain, operators.space, shapes, _clusters(values, parity))[:count]
    return _finish(operators.space, operators.mass, prestress, values[:count], shapes, parity[:count])


def _finish(
    space: Space, mass: csc_matrix, prestress: Prestress, values: Array, shapes: Array, parity: tuple[tuple[int, ...], ...]
) -> Modes:
    """Modes of the given ω² and shapes, scaled to max|ξ| = 1 and labelled."""
    shapes = shapes / np.array([largest_value(space, s) for s in shapes])[:, None]
    effective = prestress.domain.copies * np.einsum("ni,ni->n", shapes, (mass @ shapes.T).T)
    label = label_shapes(prestress.domain, space, shapes, parity)
    return Modes(prestress, space.degree, np.sqrt(values) / (2 * np.pi), effective, shapes, parity, label)


def _solve_sectors(operators: Operators, copies: int, count: int) -> tuple[Array, Array, tuple[tuple[int, ...], ...]]:
    """ω², shapes and parities of at least the `count` lowest modes: sectors are asked for more until none can hide one."""
    sectors = list(product((1, -1), repeat=min(copies, 4) // 2))
    ask = dict.fromkeys(sectors, count if len(sectors) == 1 else min(count, count // len(sectors) + 4))
    found: dict[tuple[int, ...], tuple[Array, Array]] = {}
    while ask:
        for parity, n in ask.items():
            found[parity] = _solve_sector(operators, parity, n)
        ceiling = np.sort(np.concatenate([values for values, _ in found.values()]))[count - 1]
        ask = {p: min(count, 2 * len(v)) for p, (v, _) in found.items() if v[-1] < ceiling and len(v) < count}
    values = np.concatenate([v for v, _ in found.values()])
    shapes = np.concatenate([s for _, s in found.values()])
    parities = [p for p, (v, _) in found.items() for _ in v]
    order = np.argsort(values, kind="stable")
    return values[order], shapes[order], tuple(parities[k] for k in order)


def _solve_sector(operators: Operators, parity: tuple[int, ...], count: int) -> tuple[Array, Array]:
    free = free_deflections(operators.space, parity)
    stiffness = csc_matrix(operators.stiffness(parity)[free][:, free])
    values, vectors = lowest_eigenpairs(stiffness, csc_matrix(operators.mass[free][:, free]), count)
    shapes = np.zeros((count, operators.space.size))
    shapes[:, free] = vectors.T
    return values, shapes


def _clusters(values: Array, parity: tuple[tuple[int, ...], ...], gap: float = DEGENERATE) -> list[list[int]]:
    """Indices of modes that share symmetry and frequency."""
    clusters: list[list[int]] = []
    for sector in set(parity):
        members = [k for k, p in enumerate(parity) if p == sector]
        groups = [[members[0]]]
        for before, k in pairwise(members):
            if values[k] - values[before] < gap * values[k]:
                groups[-1].append(k)
            else:
                groups.append([k])
        clusters += [g for g in groups if len(g) > 1]
    return clusters


def align(coarse: Modes, fine: Modes) -> Modes:
    """Order and turn modes of a lower degree on the same mesh so that each is the counterpart of a finer mode.

    Near-degenerate modes mix differently at different accuracy; within such sets (ω² within 1 %) the coarse modes are turned
    by the orthogonal matrix nearest to their overlap with the fine ones, and frequencies follow as Rayleigh quotients.
    """
    domain = fine.domain
    space, fine_space = Space(domain.mesh, coarse.degree), Space(domain.mesh, fine.degree)
    weight = 1 / np.sqrt(coarse.effective_mass)
    shapes = coarse.shapes * weight[:, None]
    lifted = prolong(coarse, fine.degree) * weight[:, None]
    overlap = (fine.shapes / np.sqrt(fine.effective_mass)[:, None]) @ (mass_matrix(domain, fine_space) @ lifted.T) * domain.copies
    near = np.abs(coarse.frequency[None, :] / fine.frequency[:, None] - 1) < 0.005
    left, _, right = np.linalg.svd(np.where(near, overlap, 0.0))
    turn = left @ right
    square = np.einsum("ij,j,ij->i", turn, (2 * np.pi * coarse.frequency) ** 2, turn)
    return _finish(space, mass_matrix(domain, space), coarse.prestress, square, turn @ shapes, fine.parity)


def prolong(modes: Modes, degree: int) -> Array:
    """Shapes (n, size) of modes at the unknowns of a higher degree on the same mesh; exact, since the spaces are nested."""
    coarse, fine = Space(modes.domain.mesh, modes.degree), Space(modes.domain.mesh, degree)
    basis = reference_basis(modes.degree, nodes(degree))
    shapes = np.zeros((len(modes.shapes), fine.size))
    shapes[:, fine.dofs] = modes.shapes[:, coarse.dofs] @ basis.T
    return shapes
