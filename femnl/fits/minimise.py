"""The minimum of χ² within bounds, from one start."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from femnl.core.readout import Array
from femnl.fits.secant import Place, carried_on
from femnl.fits.tangents import jacobian_at, steps_for, tangents
from femnl.fits.triangle import Triangle
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
SHORT = 5
GAIN = 8.0
"""Iterations in which χ² must fall by so much, or a fit ends that is not worth more."""
NEARLY = 1e-6
NEAR_BOUND = 1e-3
"""Distances from its bound, in parts of the range, from which on a parameter is put there: in any
case, and where that lowers χ².
"""
LEAST = 1e-3
"""Part of its start to which the factor of a known product may fall before the other one stays."""
FTOL = 1e-7
XTOL = 1e-9
"""Relative changes of χ² and of the parameters at which a fit ends."""


def minimise(
    model: ExtendedModel,
    start: Array,
    keep: NDArray[np.bool_] | None,
    most: int,
    first: Array,
    *,
    worth: float = np.inf,
    known: Array | None = None,
) -> tuple[Array, Array]:
    """Return the minimum and the steps at which tangents are taken there.

    On the way derivatives are carried on from place to place. Where it ends with such ones, and χ²
    is below `worth`, it goes on from derivatives by differences until these lower χ² no further.

    Args: as `recalled`.

    Raises: FloatingPointError where it would begin at numbers that are not finite.
    """
    low, high = model.bounds
    width = high - low
    start_part = np.clip((start - low) / width, INSIDE, 1 - INSIDE)
    if not np.all(np.isfinite(start_part)):  # which the optimiser would call outside of the bounds
        raise FloatingPointError("a fit would begin where parameters are no finite numbers")
    data = _Data(model, slice(None) if keep is None else keep, start)
    vector = data.place(start_part)
    at = model.residuals(vector)
    steps, slopes = (first, known) if known is not None else tangents(model, vector, at, first)
    data.know(vector, at, slopes)

    def solve(part: Array, **options: Any) -> OptimizeResult:
        triangle = Triangle(data.residuals, partial(data.slopes, steps=steps))
        return least_squares(
            triangle.residuals,
            part,
            jac=triangle.slopes,
            bounds=(0, 1),
            x_scale="jac",
            xtol=XTOL,
            ftol=FTOL,
            gtol=1e-10,
            **options,
        )

    def descended(part: Array, most: int) -> OptimizeResult:
        creeping = _Creeping(len(at[data.chosen]), worth)
        return solve(part, method="trf", max_nfev=most, callback=creeping)

    found = descended(start_part, most)
    left = most - found.nfev
    gains = most > ROUGH
    while gains and left > 0 and 2 * found.cost < worth and data.renew(found.x, steps):
        again = descended(found.x, left)
        left -= again.nfev
        gains = again.cost < (1 - FTOL) * found.cost
        found = again
    part = model.part_of_range(data.straight(found.x))
    pushed = _pushed(found, part)
    if most > ROUGH and pushed.any():
        on_bounds = np.where(pushed, np.rint(part), found.x)
        ended = solve(on_bounds, method="dogbox", max_nfev=LAST)
        found = ended if ended.cost <= (1 + FTOL) * found.cost else found
    end = data.place(found.x)
    size = np.linalg.norm(data.curved(np.asarray(found.jac) / width, end), axis=0)
    return end, steps_for(model, size, steps)


class _Data:
    """The residuals that are fitted, by parameters in parts of their ranges.

    The optimiser adds up steps of all parameters, and metres would count for nothing beside volts.
    Where the data know one of them times a factor of others, and hardly more, it is what it would
    be were that factor as at the start: the valley of a product is bent, and a fit creeps along it
    in a hundred steps.
    """

    def __init__(self, model: ExtendedModel, chosen: slice | NDArray[np.bool_], start: Array):
        self.chosen = chosen
        self._model = model
        self._low, self._high = model.bounds
        self._width = self._high - self._low
        self._product = model.known_product(start)
        self._first = 1.0 if self._product is None else self._product.factor(start)[0]
        # Of the latest place: slopes are asked for where residuals have just been
        self._residuals: dict[bytes, Array] = {}
        self._slopes: dict[bytes, Array] = {}
        self._last: Place | None = None
        self._by_differences = False

    def place(self, part: Array) -> Array:
        """Return the parameters (p,) at parts of their ranges."""
        vector = self.straight(part)
        if self._product is not None:
            vector[self._product.place] *= self._stretch(vector)[0]
        return np.asarray(np.clip(vector, self._low, self._high))

    def straight(self, part: Array) -> Array:
        """Return the same, were the factor of a known product as at the start."""
        return np.asarray(np.clip(self._low + self._width * part, self._low, self._high))

    def curved(self, slopes: Array, vector: Array) -> Array:
        """Return derivatives (n, p) by the parameters from those by the straight ones."""
        if self._product is None:
            return slopes
        stretch, by_others = self._stretch(vector)
        place = self._product.place
        found = slopes.copy()
        found[:, place] /= stretch
        found += np.outer(vector[place] * found[:, place], by_others)
        return found

    def _straightened(self, slopes: Array, vector: Array) -> Array:
        """Return derivatives (n, p) by the straight parameters."""
        if self._product is None:
            return slopes
        stretch, by_others = self._stretch(vector)
        place = self._product.place
        found = slopes.copy(order="K")
        found -= np.outer(vector[place] * found[:, place], by_others)
        found[:, place] *= stretch
        return found

    def _stretch(self, vector: Array) -> tuple[float, Array]:
        """Return by what the straight parameter grows, and the slopes of the factor's logarithm."""
        assert self._product is not None
        factor, slopes = self._product.factor(vector)
        left = factor / self._first
        return float(1 / np.copysign(max(abs(left), LEAST), left)), slopes

    def know(self, vector: Array, residuals: Array, slopes: Array) -> None:
        """Keep all residuals of the latest place, and their derivatives by the parameters.

        The derivatives must have been taken by differences.
        """
        self._residuals = {vector.tobytes(): residuals}
        self._keep(Place(vector, residuals, slopes), by_differences=True)

    def renew(self, part: Array, steps: Array) -> bool:
        """Take derivatives by differences at a place; return False if they were so already."""
        if self._by_differences:
            return False
        vector = self.place(part)
        at = self._known(vector)
        self.know(vector, at, jacobian_at(self._model, vector, at, steps))
        return True

    def _keep(self, place: Place, by_differences: bool) -> None:
        self._slopes = {place.vector.tobytes(): place.slopes}
        self._last = place
        self._by_differences = by_differences

    def residuals(self, part: Array) -> Array:
        """Return the residuals (n,) that are fitted."""
        return self._known(self.place(part))[self.chosen]

    def slopes(self, part: Array, steps: Array) -> Array:
        """Return their derivatives (n, p) by the parts."""
        vector = self.place(part)
        key = vector.tobytes()
        if key not in self._slopes:
            at = self._known(vector)
            found = None if self._last is None else carried_on(self._last, vector, at, self.chosen)
            slopes = jacobian_at(self._model, vector, at, steps) if found is None else found
            self._keep(Place(vector, at, slopes), by_differences=found is None)
        return self._straightened(self._slopes[key], vector)[self.chosen] * self._width

    def _known(self, vector: Array) -> Array:
        key = vector.tobytes()
        if key not in self._residuals:
            self._residuals = {key: self._model.residuals(vector)}
        return self._residuals[key]


class _Creeping:
    """Ends a fit that is far from all data and hardly gains any more, though its steps go on."""

    def __init__(self, count: int, worth: float) -> None:
        """Take how many data there are, and the χ² from which on little is gained by any fit."""
        self._limits = [(far * count / 2, 1 - part) for far, part in LITTLE]
        self._worth = worth
        self._costs: list[float] = []

    def __call__(self, intermediate_result: OptimizeResult) -> None:
        """Take the cost, half of χ², of one more iteration."""
        cost = float(intermediate_result.cost)
        self._costs.append(cost)
        long_ago = self._costs[-CREEPING - 1 : -CREEPING]
        for before in long_ago:
            if any(cost > max(far, left * before) for far, left in self._limits):
                raise StopIteration
        lately = self._costs[-SHORT - 1 : -SHORT]
        if 2 * cost > self._worth and any(2 * (before - cost) < GAIN for before in lately):
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
