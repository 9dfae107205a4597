"""Prestressed modes near a frequency, without those below them."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.domain import Domain, Prestress
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.memory import SYSTEM, allowed_memory, need_memory
from femnl.core.modes import Modes
from femnl.mechanics.fem.solvers import FACTOR_BYTES, INDEFINITE, factorize, nearest_eigenpairs
from femnl.mechanics.modes.operators import Operators
from femnl.mechanics.modes.shapes import label_shapes
from femnl.mechanics.modes.solve import (
    DEGENERATE,
    MODE_BYTES,
    ODD_IN_X,
    ODD_IN_Y,
    exchange,
    finish,
    settle_degenerate,
    with_quotients,
)

Array = NDArray[np.float64]
Parity = tuple[int, ...]


def solve_modes_near(
    prestress: Prestress, frequency: float, count: int, degree: int, stable: bool = False
) -> Modes:
    """Solve for the modes nearest to a frequency; the equation is that of `solve_modes`.

    Args: prestress: the relaxed film stress. frequency: the target [Hz]. count: how many modes, on
    both sides of it. degree: of the elements, 2 to 6. stable: whether it is known that the film
    does not buckle, which is looked for otherwise.
    Returns: modes by rising frequency, as `solve_modes` returns them; `first` is the number of the
        lowest among all modes of the film, counted by inertia (see `nearest_eigenpairs`).
    Raises: ParameterError, ConvergenceError.
    Source: shift and invert, Ericsson & Ruhe, Math. Comp. 35, 1251 (1980); held against
        `solve_modes` and closed forms by tests/physics/test_modes_near.py.
    """
    if count < 1:
        raise ParameterError(f"count = {count}: expected at least one mode")
    if not frequency > 0:
        raise ParameterError(f"frequency = {frequency:g} Hz: expected a target above 0")
    need_memory(
        MODE_BYTES * degree**2 * prestress.domain.mesh.nelements * count,
        f"{count} modes",
        "ask for fewer modes or lower the resolution",
    )
    domain = prestress.domain
    sectors = _Sectors(Operators(prestress, degree), domain, (2 * np.pi * frequency) ** 2, stable)
    nearest = sectors.nearest(count)
    if domain.model.bending:
        nearest = with_quotients(nearest, sectors.operators.quotients)
    values, shapes, parity = settle_degenerate(sectors.operators.space, domain, nearest)
    kept = np.sort(np.argsort(np.abs(values - sectors.target), kind="stable")[:count])
    found = finish(
        sectors.operators.space,
        prestress,
        values[kept],
        shapes[kept],
        1.0,
        tuple(parity[k] for k in kept),
    )
    first = sectors.below - int(np.sum(values[kept] < sectors.target)) + 1
    label = label_shapes(domain, sectors.operators.space, found.shapes, found.parity, first)
    return replace(found, label=label, first=first)


class _Sectors:
    """The symmetry sectors of a film, each with its modes nearest to a target ω² and those below.

    Attributes: operators; target [rad²/s²]; below: how many modes of all sectors lie below it,
    known once `nearest` has run.
    """

    def __init__(self, operators: Operators, domain: Domain, target: float, stable: bool) -> None:
        self.operators = operators
        self.target = target
        self.below = 0
        self._domain = domain
        self._stable = stable

    def nearest(self, count: int) -> tuple[Array, Array, tuple[Parity, ...]]:
        """Return ω², shapes and parities of `count` or more modes nearest to the target, rising.

        All modes that share a frequency with them are returned, too. More modes of each sector are
        sought until none can hide one.
        """
        sectors = list(product((1, -1), repeat=min(self._domain.copies, 4) // 2))
        threads = _threads(self.operators.space.size)
        ask = dict.fromkeys(sectors, min(count + 1, count // len(sectors) + 3))
        found: dict[Parity, tuple[Array, Array]] = {}
        below: dict[Parity, int] = {}
        while ask:
            todo = [p for p in ask if not (self._domain.diagonal and p == ODD_IN_X)]
            with ThreadPoolExecutor(threads) as pool:
                solved = pool.map(self._solve, todo, [ask[parity] for parity in todo])
                for parity, (values, shapes, number) in zip(todo, solved, strict=True):
                    found[parity] = values, shapes
                    below[parity] = number
            if self._domain.diagonal:
                odd, shapes = found[ODD_IN_Y]
                found[ODD_IN_X] = odd, shapes[:, exchange(self.operators.space, self._domain)]
                below[ODD_IN_X] = below[ODD_IN_Y]
            away = np.concatenate([np.abs(v - self.target) for v, _ in found.values()])
            farthest = np.sort(away)[count - 1] + DEGENERATE * self.target
            ask = {
                parity: 2 * len(v)
                for parity, (v, _) in found.items()
                if np.abs(v - self.target).max() <= farthest
            }
        self.below = sum(below.values())
        values = np.concatenate([v for v, _ in found.values()])
        shapes = np.concatenate([s for _, s in found.values()])
        parities = [p for p, (v, _) in found.items() for _ in v]
        order = np.argsort(values, kind="stable")
        return values[order], shapes[order], tuple(parities[k] for k in order)

    def _solve(self, parity: Parity, count: int) -> tuple[Array, Array, int]:
        free = self.operators.free(parity)
        stiffness = csc_matrix(self.operators.stiffness(parity)[free][:, free])
        mass = csc_matrix(self.operators.mass[free][:, free])
        if not self._stable:
            factorize(stiffness)  # which refuses a film that buckles: its lowest ω² is negative
        values, vectors, below = nearest_eigenpairs(stiffness, mass, count, self.target)
        if values[0] <= 0:
            raise ConvergenceError(INDEFINITE)
        shapes = np.zeros((count, self.operators.space.size))
        shapes[:, free] = vectors.T
        return values, shapes, below


def side_by_side(unknowns: int, memory: float, cores: int) -> int:
    """Return how many sectors are solved at once: their factors take half of the memory at most.

    memory: that the process may take [bytes].
    """
    room = memory / 2 / (FACTOR_BYTES * unknowns)
    return int(np.clip(room, 1, cores))


def degrees_at_once(domain: Domain, degree: int) -> int:
    """Return how many degrees up to a highest are solved at once: two, if two sectors of it are.

    One core would idle while the other assembles a degree. The factors of one degree less fit into
    the other half of the memory.
    """
    return min(_threads(domain.mesh.nelements * degree**2 // 2), 2)


def _threads(unknowns: int) -> int:
    return side_by_side(unknowns, allowed_memory(SYSTEM), len(os.sched_getaffinity(0)))
