"""Prestressed modes by symmetry sector, normalised, paired and labelled."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.spatial import cKDTree

from femnl.core.domain import Domain, Prestress
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.memory import need_memory
from femnl.core.modes import Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.solvers import lowest_eigenpairs
from femnl.mechanics.modes.operators import Operators
from femnl.mechanics.modes.shapes import (
    canonical_turn,
    label_shapes,
    largest_values,
)

Array = NDArray[np.float64]
# Ω² (n,), mass-normalised shapes (n, size), parities
Sectors = tuple[Array, Array, tuple[tuple[int, ...], ...]]
Quotients = Callable[[Array, tuple[tuple[int, ...], ...]], Array]

# parities about the x axis (mirror 0) and the y axis (mirror 1)
ODD_IN_Y = (-1, 1)
ODD_IN_X = (1, -1)
# Of memory a triangle and mode, times the square of the degree: half as many unknowns, 5 copies in
# the iteration
MODE_BYTES = 20
DEGENERATE = 1e-6  # relative splitting of ω² up to which modes count as sharing a frequency


def solve_modes(prestress: Prestress, count: int, degree: int) -> Modes:
    """Solve ∫ N:∇w⊗∇v + D[(1−ν)∇∇w:∇∇v + νΔwΔv] = ω² ∫ ρh wv for the lowest modes.

    Args: prestress: the relaxed film stress. count: how many modes, by rising frequency. degree: of
    the elements, 2 to 6.
    Returns: modes with max|ξ| = 1, solved in each symmetry sector of a wedge; those that share a
        frequency are turned and ordered as `canonical_turn` says, so that a square gives (2,1)
        before (1,2) whatever the mesh.
    Raises: ParameterError, ConvergenceError. Valid: wedges of an eighth or twelfth hold the
        one-dimensional symmetries only; in the mesh of a whole film pairs count as degenerate only
        where the discretisation splits ω² by less than 1e-6.
    Source: Kirchhoff plate in tension; validation cases `ideal_square`, `ideal_hexagon`,
    `ideal_l_shape`, `clamped_plate`.
    """
    need_memory(
        MODE_BYTES * degree**2 * prestress.domain.mesh.nelements * count,
        f"{count} modes",
        "ask for fewer modes or lower the resolution",
    )
    operators = Operators(prestress, degree)
    quotients = operators.quotients if prestress.domain.model.bending else None
    return solve_sectors(_Assembled(operators), prestress, count, quotients)


class Pencil(Protocol):
    """K and M of deflections; K depends on the parity about mirrors, which hold slopes."""

    space: Space
    mass: csc_matrix

    def stiffness(self, parity: tuple[int, ...]) -> csc_matrix:
        """Return K (size, size)."""
        ...

    def free(self, parity: tuple[int, ...]) -> NDArray[np.int64]:
        """Return unknowns that nothing holds."""
        ...


class Source(Protocol):
    """Where the modes of each parity come from."""

    @property
    def space(self) -> Space:
        """Of the shapes."""
        ...

    def lowest(self, parity: tuple[int, ...], count: int) -> tuple[Array, Array]:
        """Return ω² (count,) rising and shapes (count, size) of the lowest modes of a parity.

        ∫ρhw² = 1 over the mesh.
        """
        ...


@dataclass(frozen=True)
class _Assembled:
    """Modes of assembled K and M."""

    operators: Pencil

    @property
    def space(self) -> Space:
        return self.operators.space

    def lowest(self, parity: tuple[int, ...], count: int) -> tuple[Array, Array]:
        free = self.operators.free(parity)
        stiffness = csc_matrix(self.operators.stiffness(parity)[free][:, free])
        values, vectors = lowest_eigenpairs(
            stiffness, csc_matrix(self.operators.mass[free][:, free]), count
        )
        shapes = np.zeros((count, self.space.size))
        shapes[:, free] = vectors.T
        return values, shapes


def without_modes(prestress: Prestress) -> Modes:
    """Return a film after release of which no mode was solved."""
    none = np.empty(0)
    size = Space(prestress.domain.mesh, prestress.degree).size
    return Modes(prestress, prestress.degree, none, none, np.empty((0, size)), (), ())


def solve_pencil(operators: Pencil, prestress: Prestress, count: int) -> Modes:
    """Solve K w = ω² M w for the lowest modes; see `solve_modes`."""
    return solve_sectors(_Assembled(operators), prestress, count)


def solve_sectors(
    source: Source, prestress: Prestress, count: int, quotients: Quotients | None = None
) -> Modes:
    """Return the lowest modes of all parities together; see `solve_modes`.

    Args: quotients: ω² of shapes by their parities, where that of the source has rounding errors.
    """
    if count < 1:
        raise ParameterError(f"count = {count}: expected at least one mode")
    sectors = _solve_sectors(source, prestress.domain, count)
    if quotients is not None:
        sectors = with_quotients(sectors, quotients)
    values, shapes, parity = settle_degenerate(source.space, prestress.domain, sectors)
    found = finish(source.space, prestress, values[:count], shapes[:count], 1.0, parity[:count])
    return replace(
        found, label=label_shapes(prestress.domain, source.space, found.shapes, found.parity)
    )


def finish(
    space: Space,
    prestress: Prestress,
    values: Array,
    shapes: Array,
    norm: float,
    parity: tuple[tuple[int, ...], ...],
) -> Modes:
    """Return modes of the given ω² and shapes, scaled to max|ξ| = 1, without labels.

    `norm`: their ∫ρhw² over the mesh.
    """
    largest = largest_values(space, shapes)
    label = (None,) * len(shapes)
    effective = prestress.domain.copies * norm / largest**2
    return Modes(
        prestress,
        space.degree,
        np.sqrt(values) / (2 * np.pi),
        effective,
        shapes / largest[:, None],
        parity,
        label,
    )


def _solve_sectors(source: Source, domain: Domain, count: int) -> Sectors:
    """Return ω², shapes and parities of at least the `count` lowest modes.

    All modes that share a frequency with them are returned, too.

    Sectors are asked for more until none can hide one.
    """
    sectors = list(product((1, -1), repeat=min(domain.copies, 4) // 2))
    ask = dict.fromkeys(sectors, min(count + 1, count // len(sectors) + 3))
    found: dict[tuple[int, ...], tuple[Array, Array]] = {}
    while ask:
        for parity, n in ask.items():
            if not (domain.diagonal and parity == ODD_IN_X):
                found[parity] = source.lowest(parity, n)
        if domain.diagonal:
            odd, shapes = found[ODD_IN_Y]
            found[ODD_IN_X] = odd, shapes[:, exchange(source.space, domain)]
        highest = np.sort(np.concatenate([values for values, _ in found.values()]))[count - 1]
        ask = {p: 2 * len(v) for p, (v, _) in found.items() if v[-1] <= highest * (1 + DEGENERATE)}
    values = np.concatenate([v for v, _ in found.values()])
    shapes = np.concatenate([s for _, s in found.values()])
    parities = [p for p, (v, _) in found.items() for _ in v]
    order = np.argsort(values, kind="stable")
    return values[order], shapes[order], tuple(parities[k] for k in order)


def with_quotients(sectors: Sectors, quotients: Quotients) -> Sectors:
    """Return modes by rising ω² that is evaluated anew from their shapes."""
    _, shapes, parity = sectors
    values = quotients(shapes, parity)
    order = np.argsort(values, kind="stable")
    return values[order], shapes[order], tuple(parity[k] for k in order)


def exchange(space: Space, domain: Domain) -> NDArray[np.int64]:
    """Return the unknown at (y, x) for each unknown at (x, y), from the middle of the film."""
    place = space.location - domain.middle
    distance, image = cKDTree(place).query(place[:, ::-1])
    if np.max(distance) > 1e-9 * np.abs(place).max():
        raise ConvergenceError(
            "the mesh is not its own image in the diagonal; mesh the film with symmetry full"
        )
    return np.asarray(image)


def settle_degenerate(space: Space, domain: Domain, sectors: Sectors) -> Sectors:
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
