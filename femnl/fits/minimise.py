"""The minimum of χ² within bounds, from one start."""

from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from femnl.core.readout import Array
from femnl.fits.tangents import jacobian_at, steps_for, tangents
from femnl.observe.extended import ExtendedModel

INSIDE = 1e-9
"""Distance from its bounds, in parts of the range, that a start keeps."""
ROUGH = 10
"""Evaluations up to which a fit only ranks starts, so that it need not end at bounds."""
LAST = 10
"""Evaluations for the way to bounds, which the reflective method shies away from."""
CREEPING = 10
LITTLE = ((25.0, 0.01), (2.0, 5e-4))
"""Iterations in which χ² must fall by a part, or a fit ends that leaves more than so much of it per
datum: so slow a valley is left to fits from elsewhere.
"""
NEARLY = 1e-6
NEAR_BOUND = 1e-3
"""Distances from its bound, in parts of the range, from which on a parameter is put there: in any
case, and where that lowers χ².
"""
FTOL = 1e-7
XTOL = 1e-9
"""Relative changes of χ² and of the parameters at which a fit ends."""


def minimise(
    model: ExtendedModel, start: Array, keep: NDArray[np.bool_] | None, most: int, first: Array
) -> tuple[Array, Array]:
    """Return the minimum and the steps at which tangents are taken there.

    Raises: FloatingPointError where it would begin at numbers that are not finite.
    """
    low, high = model.bounds
    width = high - low
    chosen = slice(None) if keep is None else keep

    # In parts of the ranges: the optimiser adds up steps of all parameters, and metres would count
    # for nothing beside volts.
    def place(part: Array) -> Array:
        return np.asarray(np.clip(low + width * part, low, high))

    start_part = np.clip((start - low) / width, INSIDE, 1 - INSIDE)
    if not np.all(np.isfinite(start_part)):  # which the optimiser would call outside of the bounds
        raise FloatingPointError("a fit would begin where parameters are no finite numbers")
    vector = place(start_part)
    at = model.residuals(vector)
    steps, slopes = tangents(model, vector, at, first)
    # The optimiser asks for the tangents where it has just asked for the residuals, and for both
    # where it starts.
    latest = {vector.tobytes(): at}
    latest_slopes = {vector.tobytes(): slopes}

    def known(v: Array) -> Array:
        if v.tobytes() not in latest:
            latest.clear()
            latest[v.tobytes()] = model.residuals(v)
        return latest[v.tobytes()]

    def residuals(part: Array) -> Array:
        return known(place(part))[chosen]

    def jacobian(part: Array) -> Array:
        v = place(part)
        if v.tobytes() not in latest_slopes:
            latest_slopes.clear()
            latest_slopes[v.tobytes()] = jacobian_at(model, v, known(v), steps)
        return latest_slopes[v.tobytes()][chosen] * width

    solve = partial(
        least_squares,
        residuals,
        jac=jacobian,
        bounds=(0, 1),
        x_scale="jac",
        xtol=XTOL,
        ftol=FTOL,
        gtol=1e-10,
    )
    found = solve(start_part, method="trf", max_nfev=most, callback=_Creeping(len(at[chosen])))
    part = model.part_of_range(place(found.x))
    pushed = _pushed(found, part)
    if most > ROUGH and pushed.any():
        on_bounds = np.where(pushed, np.rint(part), found.x)
        ended = solve(on_bounds, method="dogbox", max_nfev=LAST)
        found = ended if ended.cost <= (1 + FTOL) * found.cost else found
    end = place(found.x)
    size = np.linalg.norm(np.asarray(found.jac), axis=0) / width
    return end, steps_for(model, size, steps)


class _Creeping:
    """Ends a fit that is far from all data and hardly gains any more, though its steps go on."""

    def __init__(self, count: int) -> None:
        self._limits = [(far * count / 2, 1 - part) for far, part in LITTLE]
        self._costs: list[float] = []

    def __call__(self, intermediate_result: OptimizeResult) -> None:
        """Take the cost, half of χ², of one more iteration."""
        cost = float(intermediate_result.cost)
        self._costs.append(cost)
        long_ago = self._costs[-CREEPING - 1 : -CREEPING]
        for before in long_ago:
            if any(cost > max(far, left * before) for far, left in self._limits):
                raise StopIteration


def _pushed(found: OptimizeResult, part: Array) -> NDArray[np.bool_]:
    """Return which parameters (p,) are near a bound with χ² falling towards it, or at one.

    Args: part (p,): where each is in its range.
    """
    gradient = found.jac.T @ found.fun
    low = (part < NEAR_BOUND) & (gradient > 0)
    high = (part > 1 - NEAR_BOUND) & (gradient < 0)
    at_bound = np.minimum(part, 1 - part) < NEARLY
    return np.asarray(low | high | at_bound)
