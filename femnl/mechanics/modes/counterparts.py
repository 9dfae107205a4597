"""Modes with their counterparts at lower degrees, from which their errors are known."""

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from femnl.core.device import Model
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.modes import Modes
from femnl.mechanics.modes.solve import align

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
    model: Model, at_degree: Callable[[int, int], Modes], count: int, spare: int, degree: int
) -> Modes:
    """Solve modes, and their counterparts of one and two degrees less for their errors.

    Args: at_degree: solves so many modes at a degree. spare: coarse modes beyond those asked for.
    """
    fine = at_degree(count, degree)
    middle = align(at_degree(count + spare, degree - 1), fine)
    try:
        coarse = align(at_degree(count + spare, degree - 2), fine)
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
