"""Modes as a small dense problem: the film's operators on the lowest base modes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, NdBSpline, make_interp_spline

from femnl.core.arrays import freeze
from femnl.core.tension import TensionChanges

Array = NDArray[np.float64]

WEIGHTS = ("1", "x", "y", "x²", "xy", "y²")
"""Weights φ of the integrals below, with x and y in units of `reach`."""
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""The powers of x and of y in each weight."""
DIRECTIONS = ("xx", "yy", "xy")
CUBIC = 3


def weights(point: Array) -> Array:
    """Return each weight at points (2, …) in units of `reach`, (6, …)."""
    x, y = point
    return np.stack([x**a * y**b for a, b in POWERS])


@dataclass(frozen=True)
class Units:
    """How a film relaxes in its plane under each of `WEIGHTS` times each of `DIRECTIONS`.

    A film stress that is not in equilibrium, φ s with ∇·(φ s) ≠ 0 or at a hole, moves the film.

    reach [m]: the unit of x and y in the weights. displacement (6, 3, n_dofs) [m/Pa] at the dofs of
    the vector element of the given polynomial degree on the mesh of the modes.
    """

    degree: int
    reach: float
    displacement: Array

    def __post_init__(self) -> None:
        freeze(self)


@dataclass(frozen=True)
class Projection:
    """Integrals of the base modes ξᵢ over the whole film, for small changes of K and M by effects.

    slopes (6, 3, n, n) [m]: ∫ h S : ½(∇ξᵢ∇ξⱼ + ∇ξⱼ∇ξᵢ), S what is left in equilibrium of a film
    stress φ s, φ of `WEIGHTS` and s of 1 in one of `DIRECTIONS` (xy: ½ in xy and in yx), so that a
    stress [Pa] times it is a stiffness, and h is that of the film, also where layers lie on it;
    masses (6, n, n) [kg]: ∫ μφξᵢξⱼ, μ = Σρh of film and layers; reach [m]: the unit of x and y;
    grid_x, grid_y (m,) [m], dense at both ends, and shapes (n, m, m) as [mode, y, x]: ξ on a grid
    over the box of the film, going on smoothly over holes; tension: what changes of the film's
    tension add to K.
    """

    slopes: Array
    masses: Array
    reach: float
    grid_x: Array
    grid_y: Array
    shapes: Array
    tension: TensionChanges | None = None

    def __post_init__(self) -> None:
        freeze(self)

    def at(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Return ξ of every mode at points x, y [m] of one shape, (n, *shape), 0 outside the box.

        Cubic interpolation in the table, which is exact to 1e-6 where the film fills its box.
        """
        here_x, here_y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        inside = (np.abs(here_x) <= self.grid_x[-1]) & (np.abs(here_y) <= self.grid_y[-1])
        return np.asarray(inside * np.moveaxis(self._spline(np.stack([here_y, here_x], -1)), -1, 0))

    def on_grid(self, x: Array, y: Array) -> Array:
        """Return ξ of every mode on the grid of rising axes x (n_x,), y (n_y,) [m], (n, n_y, n_x).

        It does what `at` does, but faster.
        """
        inside = np.outer(np.abs(y) <= self.grid_y[-1], np.abs(x) <= self.grid_x[-1])
        (along_y, along_x) = self._spline.t
        table = self._spline.c
        rows = BSpline(along_y, table, CUBIC)(y)
        return np.asarray(
            inside * BSpline(along_x, rows.swapaxes(0, 1), CUBIC)(x).transpose(2, 1, 0)
        )

    @cached_property
    def _spline(self) -> NdBSpline:
        """One spline of (y, x) for all modes together, which is much faster than one for each."""
        up = make_interp_spline(self.grid_y, np.moveaxis(self.shapes, 0, -1), CUBIC)
        across = make_interp_spline(self.grid_x, up.c.swapaxes(0, 1), CUBIC)
        return NdBSpline((up.t, across.t), np.ascontiguousarray(across.c.swapaxes(0, 1)), CUBIC)
