"""Modes as a small dense problem: projections of the film's operators onto the lowest base modes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RectBivariateSpline

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
    grid_x, grid_y (m,) [m], dense at both ends, and shapes (n, m, m) as [mode, y, x]: ξ on a grid over the box of the film.
    """

    slopes: Array
    masses: Array
    reach: float
    grid_x: Array
    grid_y: Array
    shapes: Array

    def __post_init__(self) -> None:
        freeze(self)

    def at(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return ξ of every mode at points x, y [m] of one shape, (n, *shape), 0 outside the box.

        Cubic interpolation in the table, which is exact to 1e-6 where the film fills its box.
        """
        here_x, here_y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        inside = (np.abs(here_x) <= self.grid_x[-1]) & (np.abs(here_y) <= self.grid_y[-1])
        found = [inside * spline.ev(here_y, here_x) for spline in self._splines]
        return np.stack(found)

    def on_grid(self, x: Array, y: Array) -> Array:
        """Return ξ of every mode on the grid of rising axes x (n_x,), y (n_y,) [m], (n, n_y, n_x); as `at`, but much faster."""
        inside = np.outer(np.abs(y) <= self.grid_y[-1], np.abs(x) <= self.grid_x[-1])
        return np.stack([inside * spline(y, x) for spline in self._splines])

    @cached_property
    def _splines(self) -> list[RectBivariateSpline]:
        return [RectBivariateSpline(self.grid_y, self.grid_x, table) for table in self.shapes]
