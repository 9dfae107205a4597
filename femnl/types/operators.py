"""Modes as a small dense problem: projections of the film's operators onto the lowest base modes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates, spline_filter

from femnl.types.arrays import freeze

Array = NDArray[np.float64]

WEIGHTS = ("1", "x", "y", "x²", "xy", "y²")
"""Weights φ of the integrals below, with x and y in units of `reach`."""
DIRECTIONS = ("xx", "yy", "xy")


@dataclass(frozen=True)
class Projection:
    """Integrals of the base modes ξᵢ over the whole film, from which effects make small changes of K and M.

    slopes (6, 3, n, n) [m]: ∫ h φ ½(∂ₐξᵢ∂_bξⱼ + ∂_bξᵢ∂ₐξⱼ) with the weights φ of `WEIGHTS` and ab of `DIRECTIONS`, so that
    a stress [Pa] times it is a stiffness; masses (6, n, n) [kg]: ∫ ρhφξᵢξⱼ; reach [m]: the unit of x and y;
    axis (m,) [m] and shapes (n, m, m) as [mode, y, x]: ξ on a square grid over the film.
    """

    slopes: Array
    masses: Array
    reach: float
    axis: Array
    shapes: Array

    def __post_init__(self) -> None:
        freeze(self)

    def at(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return ξ of every mode at points x, y [m] of one shape, (n, *shape), by cubic interpolation in the table."""
        step = self.axis[1] - self.axis[0]
        here = np.broadcast_arrays(np.atleast_1d(np.asarray(y, float)), np.atleast_1d(np.asarray(x, float)))
        place = (np.stack(here) - self.axis[0]) / step
        found = np.stack([map_coordinates(table, place, order=3, mode="nearest", prefilter=False) for table in self._splines])
        return found.reshape(len(found), *np.broadcast_shapes(np.shape(x), np.shape(y)))

    @cached_property
    def _splines(self) -> Array:
        return np.stack([spline_filter(table, order=3, mode="nearest") for table in self.shapes])
