"""Prestressed modes of the film, solved symmetry sector by symmetry sector, normalised, paired and labelled."""

from dataclasses import replace
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.spatial import cKDTree

from femnl.errors import ConvergenceError, ParameterError
from femnl.fem.elements import Space
from femnl.fem.memory import need_memory
from femnl.fem.solvers import lowest_eigenpairs
from femnl.fem.supports import free_deflections
from femnl.modes.operators import Operators, mass_matrix
from femnl.modes.shapes import canonical_turn, label_shapes, largest_departure, largest_value
from femnl.types.mechanics import Domain, Modes, Prestress

Array = NDArray[np.float64]
Sectors = tuple[Array, Array, tuple[tuple[int, ...], ...]]  # ω² (n,), mass-normalised shapes (n, size), parities

ODD_IN_Y, ODD_IN_X = (-1, 1), (1, -1)  # parities about the x axis (mirror 0) and the y axis (mirror 1)
MODE_BYTES = 320  # of memory a triangle and mode: 8 unknowns, 5 copies in the iteration
CONFUSED = {1: 0.005, 2: 0.05}  # relative difference of frequencies up to which modes one or two degrees apart may be the same
COUNTERPART = 0.9  # overlap of mass-normalised shapes from which they are the same mode
DEGENERATE = 1e-6  # relative splitting of ω² up to which modes count as sharing a frequency


def solve_modes(prestress: Prestress, count: int, degree: int) -> Modes:
    """Solve ∫ N:∇w⊗∇v + D[(1−ν)∇∇w:∇∇v + νΔwΔv] = ω² ∫ ρh wv for the lowest modes.

    Args: prestress: the relaxed film stress. count: how many modes, by rising frequency. degree: of the elements, 2 to 6.
    Returns: modes with max|ξ| = 1, solved in each symmetry sector of a wedge; those that share a frequency are turned and
        ordered as `canonical_turn` says, so that a square gives (2,1) before (1,2) whatever the mesh.
    Raises: ParameterError, ConvergenceError. Valid: wedges of an eighth or twelfth hold the one-dimensional symmetries only; in
        the mesh of a whole film pairs count as degenerate only where the discretisation splits ω² by less than 1e-6.
    Source: Kirchhoff plate in tension; validation cases `ideal_square`, `ideal_hexagon`, `ideal_l_shape`, `clamped_plate`.
    """
    if count < 1:
        raise ParameterError(f"count = {count}: expected at least one mode")
    need_memory(MODE_BYTES * prestress.domain.mesh.nelements * count, f"{count} modes", "ask for fewer modes or lower the resolution")
    return solve_pencil(Operators(prestress, degree), prestress, count)


class Pencil(Protocol):
    """K and M of deflections; K depends on the parity about the mirrors, because slopes that these hold do."""

    space: Space
    mass: csc_matrix

    def stiffness(self, parity: tuple[int, ...]) -> csc_matrix:
        """K (size, size)."""
        ...


def solve_pencil(operators: Pencil, prestress: Prestress, count: int) -> Modes:
    """Solve K w = ω² M w for the lowest modes; see `solve_modes`."""
    sectors = _solve_sectors(operators, prestress.domain, count)
    values, shapes, parity = _settle_degenerate(operators.space, prestress.domain, sectors)
    return _finish(operators.space, operators.mass, prestress, values[:count], shapes[:count], parity[:count])


def _finish(
    space: Space, mass: csc_matrix, prestress: Prestress, values: Array, shapes: Array, parity: tuple[tuple[int, ...], ...]
) -> Modes:
    """Modes of the given ω² and shapes, scaled to max|ξ| = 1 and labelled."""
    shapes = shapes / np.array([largest_value(space, s) for s in shapes])[:, None]
    effective = prestress.domain.copies * np.einsum("ni,ni->n", shapes, (mass @ shapes.T).T)
    label = label_shapes(prestress.domain, space, shapes, parity)
    return Modes(prestress, space.degree, np.sqrt(values) / (2 * np.pi), effective, shapes, parity, label)


def _solve_sectors(operators: Pencil, domain: Domain, count: int) -> Sectors:
    """ω², shapes and parities of at least the `count` lowest modes and of all that share a frequency with them.

    Sectors are asked for more until none can hide one.
    """
    sectors = list(product((1, -1), repeat=min(domain.copies, 4) // 2))
    ask = dict.fromkeys(sectors, min(count + 1, count // len(sectors) + 3))
    found: dict[tuple[int, ...], tuple[Array, Array]] = {}
    while ask:
        for parity, n in ask.items():
            if not (domain.diagonal and parity == ODD_IN_X):
                found[parity] = _solve_sector(operators, parity, n)
        if domain.diagonal:
            odd, shapes = found[ODD_IN_Y]
            found[ODD_IN_X] = odd, shapes[:, _exchange(operators.space)]
        highest = np.sort(np.concatenate([values for values, _ in found.values()]))[count - 1]
        ask = {p: 2 * len(v) for p, (v, _) in found.items() if v[-1] <= highest * (1 + DEGENERATE)}
    values = np.concatenate([v for v, _ in found.values()])
    shapes = np.concatenate([s for _, s in found.values()])
    parities = [p for p, (v, _) in found.items() for _ in v]
    order = np.argsort(values, kind="stable")
    return values[order], shapes[order], tuple(parities[k] for k in order)


def _exchange(space: Space) -> NDArray[np.int64]:
    """The unknown at (y, x) for each unknown at (x, y)."""
    distance, image = cKDTree(space.location).query(space.location[:, ::-1])
    if np.max(distance) > 1e-9 * np.abs(space.location).max():
        raise ConvergenceError("the mesh is not its own image in the diagonal; mesh the film with symmetry full")
    return np.asarray(image)


def _solve_sector(operators: Pencil, parity: tuple[int, ...], count: int) -> tuple[Array, Array]:
    free = free_deflections(operators.space, parity)
    stiffness = csc_matrix(operators.stiffness(parity)[free][:, free])
    values, vectors = lowest_eigenpairs(stiffness, csc_matrix(operators.mass[free][:, free]), count)
    shapes = np.zeros((count, operators.space.size))
    shapes[:, free] = vectors.T
    return values, shapes


def _settle_degenerate(space: Space, domain: Domain, sectors: Sectors) -> Sectors:
    """Turn and order modes that share a frequency as `canonical_turn` says."""
    values, shapes, parity = sectors
    breaks = np.flatnonzero(np.diff(values) > DEGENERATE * values[1:]) + 1
    for members in np.split(np.arange(len(values)), breaks):
        if len(members) > 1:
            turn = canonical_turn(domain, space, shapes[members], tuple(parity[k] for k in members))
            shapes[members] = turn @ shapes[members]
            values[members] = turn**2 @ values[members]
            sources = members[np.argmax(np.abs(turn), axis=1)]
            settled = dict(zip(members, (parity[k] for k in sources), strict=True))
            parity = tuple(settled.get(k, p) for k, p in enumerate(parity))
    return values, shapes, parity


def align(coarse: Modes, fine: Modes) -> Modes:
    """Order and turn modes of a lower degree on the same mesh so that each is the counterpart of a finer mode.

    Near-degenerate modes mix differently at different accuracy; within such sets (one symmetry, frequencies that the lower
    degree may confuse) the coarse modes are turned by the orthogonal matrix nearest to their overlap with the fine ones, and
    frequencies follow as Rayleigh quotients.

    Args: coarse: at least as many modes as `fine`; a few more make sure that the highest find their counterparts.
    Returns: as many modes as `fine`, with `departure`; NaN in the place of modes without a counterpart.
    """
    domain = fine.domain
    space, fine_space = Space(domain.mesh, coarse.degree), Space(domain.mesh, fine.degree)
    shapes = coarse.shapes / np.sqrt(coarse.effective_mass)[:, None]
    target = fine.shapes / np.sqrt(fine.effective_mass)[:, None]
    carried = space.prolong(shapes, fine_space)
    overlap = target @ (mass_matrix(domain, fine_space) @ carried.T) * domain.copies
    near = np.abs(coarse.frequency[None, :] / fine.frequency[:, None] - 1) < CONFUSED[fine.degree - coarse.degree]
    alike = np.array([[p == q for q in coarse.parity] for p in fine.parity])
    left, _, right = np.linalg.svd(np.where(near & alike, overlap, 0.0), full_matrices=False)
    turn = left @ right
    square = np.einsum("ij,j,ij->i", turn, (2 * np.pi * coarse.frequency) ** 2, turn)
    lost = np.einsum("ij,ij->i", turn, overlap) < COUNTERPART
    found = _finish(space, mass_matrix(domain, space), coarse.prestress, square, turn @ shapes, fine.parity)
    sign = np.sign(np.einsum("ni,ni->n", found.shapes, turn @ shapes))  # opposite extrema may be equally large
    away = [largest_departure(fine_space, *pair) for pair in zip(target, turn @ carried, strict=True)]
    blank = np.where(lost, np.nan, 1.0)
    return replace(
        found,
        frequency=found.frequency * blank,
        effective_mass=found.effective_mass * blank,
        shapes=found.shapes * sign[:, None],
        departure=np.asarray(away) * blank,
    )
