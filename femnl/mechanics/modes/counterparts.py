"""Modes with their counterparts at lower degrees, from which their errors are known."""

import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.core.domain import Domain
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.modes import Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import quadrature_order
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.modes.shapes import largest_departure, walk
from femnl.mechanics.modes.solve import finish

Array = NDArray[np.float64]
# Relative difference of frequencies up to which modes one or two degrees apart may be the same
CONFUSED = {1: 0.005, 2: 0.05}
COUNTERPART = 0.9  # overlap of mass-normalised shapes from which they are the same mode
FINER = 1.4
"""Factor on the resolution where some modes have no counterpart."""
REFINEMENTS = 2
"""How often it is raised, before modes are refused."""


def certified(model: Model, solve: Callable[[float], Modes], resolution: float) -> Modes:
    """Solve modes, and again at a higher resolution until the error of each is known.

    Args: solve: the modes at a resolution.
    Raises: ConvergenceError where that takes too fine a mesh, with the number of modes whose errors
    are known.
    """
    why = ""
    found = solve(resolution)
    for step in range(1, REFINEMENTS + 1):
        if np.isfinite(found.frequency_error).all():
            return found
        try:
            found = solve(resolution * FINER**step)
        except ParameterError as error:
            why = f" (a finer mesh is out of reach, because {error})"
            break
    unknown = np.flatnonzero(~np.isfinite(found.frequency_error))
    if len(unknown) == 0:
        return found
    remedy = "ask for a finer resolution" if why == "" else "ask for fewer modes"
    if found.first == 1 and unknown[0] > 0:
        remedy = f"the first {unknown[0]} modes are certified: ask for at most {unknown[0]}"
        remedy += "" if why else ", or for a finer resolution"
    raise ConvergenceError(
        f"{model.name}: {len(found.frequency)} modes: mode {found.number[unknown[0]]} has no "
        f"counterpart at a lower degree, so that its error is not known; {remedy}{why}"
    )


def with_counterparts(
    model: Model,
    at_degree: Callable[[int, int], Modes],
    count: int,
    spare: int,
    degree: int,
    threads: int = 1,
) -> Modes:
    """Solve modes, and their counterparts of one and two degrees less for their errors.

    Args: at_degree: solves so many modes at a degree. spare: coarse modes beyond those asked for.
        threads: how many degrees are solved at once.
    """
    best, less, least = (count, degree), (count + spare, degree - 1), (count + spare, degree - 2)
    with _begun(at_degree, (best, less, least), threads) as solved:
        fine = solved(*best)
        middle = align(solved(*less), fine)
        try:
            coarse = align(solved(*least), fine)
        except ConvergenceError:
            # Two degrees less may be too crude for the stress at a free edge, where it must not
            # push. Without them nothing shows that the degrees converge, and the error bars are as
            # wide as where they do not.
            logging.getLogger("femnl").warning(
                "%s: degree %d is too crude for this mesh; error bars are wide, raise the "
                "resolution to narrow them",
                model.name,
                degree - 2,
            )
            return replace(fine, coarse=middle)
    return replace(fine, coarse=replace(middle, coarse=coarse))


@contextmanager
def _begun(
    at_degree: Callable[[int, int], Modes], jobs: Sequence[tuple[int, int]], threads: int
) -> Iterator[Callable[[int, int], Modes]]:
    """Yield at_degree; with several threads, one that waits for jobs which they have begun."""
    if threads == 1:
        yield at_degree
        return
    pool = ThreadPoolExecutor(threads)
    begun = {job: pool.submit(at_degree, *job) for job in jobs}
    try:
        yield lambda number, degree: begun[number, degree].result()
    finally:
        pool.shutdown(cancel_futures=True)


def align(coarse: Modes, fine: Modes) -> Modes:
    """Order and turn modes of a lower degree on the same mesh to be counterparts of finer modes.

    Near-degenerate modes mix differently at different accuracy; within such sets (one symmetry,
    frequencies that the lower degree may confuse) the coarse modes are turned by the orthogonal
    matrix nearest to their overlap with the fine ones, and frequencies follow as Rayleigh
    quotients.

    Args: coarse: at least as many modes as `fine`; a few more make sure that the highest find their
    counterparts.
    Returns: as many modes as `fine`, with `departure` and `coupling`; NaN in the place of modes
    without a counterpart.
    """
    domain = fine.domain
    space = Space(domain.mesh, coarse.degree)
    fine_space = Space(domain.mesh, fine.degree)
    shapes = coarse.shapes / np.sqrt(coarse.effective_mass)[:, None]
    target = fine.shapes / np.sqrt(fine.effective_mass)[:, None]
    carried = space.prolong(shapes, fine_space)
    overlap = _overlap(domain, fine_space, target, carried) * domain.copies
    near = (
        np.abs(coarse.frequency[None, :] / fine.frequency[:, None] - 1)
        < CONFUSED[fine.degree - coarse.degree]
    )
    alike = np.array([[p == q for q in coarse.parity] for p in fine.parity])
    left, _, right = np.linalg.svd(np.where(near & alike, overlap, 0.0), full_matrices=False)
    turn = left @ right
    square = turn @ ((2 * np.pi * coarse.frequency[:, None]) ** 2 * turn.T)
    lost = np.einsum("ij,ij->i", turn, overlap) < COUNTERPART
    found = finish(
        space, coarse.prestress, np.diagonal(square), turn @ shapes, 1 / domain.copies, fine.parity
    )
    together = (near.astype(int) @ near.T > 0) & np.array(
        [[p == q for q in fine.parity] for p in fine.parity]
    )
    # Opposite extrema may be equally large
    sign = np.sign(np.einsum("ni,ni->n", found.shapes, turn @ shapes))
    away = [
        largest_departure(fine_space, *pair) for pair in zip(target, turn @ carried, strict=True)
    ]
    blank = np.where(lost, np.nan, 1.0)
    coupling = square / (8 * np.pi**2 * np.sqrt(np.outer(fine.frequency, fine.frequency)))
    return replace(
        found,
        frequency=found.frequency * blank,
        effective_mass=found.effective_mass * blank,
        shapes=found.shapes * sign[:, None],
        label=fine.label,
        departure=np.asarray(away) * blank,
        coupling=np.where(together & ~np.eye(len(target), dtype=bool), coupling, np.nan)
        * blank
        * blank[:, None],
    )


def _overlap(domain: Domain, space: Space, first: Array, second: Array) -> Array:
    """Return ∫ ρh a b over the mesh, (n, m), of shapes a (n, size) and b (m, size)."""
    sheet = Sheet(domain)
    total = np.zeros((len(first), len(second)))
    order = quadrature_order(domain.model, 2 * space.degree)
    for triangles, point, dx, values in walk(space, np.concatenate([first, second]), order):
        weighted = values * (sheet.inertia(triangles, point) * dx)
        total += (
            weighted[: len(first)].reshape(len(first), -1)
            @ values[len(first) :].reshape(len(second), -1).T
        )
    return total
