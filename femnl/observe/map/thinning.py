"""Every so many rows and columns of a map."""

import numpy as np
from numpy.typing import NDArray

from femnl.observe.map.spots import Grid

FEW = 1000
"""Places of a map that are few; of up to four times as many, none are left out either."""


def step_of(n_points: int) -> int:
    """Return of how many rows and columns one is enough."""
    return max(int(np.sqrt(n_points / FEW)), 1)


def every(grid: Grid, step: int) -> tuple[NDArray[np.int64], Grid]:
    """Return the points on every so many rows and columns, and their grid."""
    part = np.flatnonzero((grid.row % step == 0) & (grid.column % step == 0))
    rows, columns = grid.sizes
    sizes = -(-rows // step), -(-columns // step)
    coarse = Grid(
        grid.x[part], grid.y[part], grid.row[part] // step, grid.column[part] // step, sizes
    )
    return part, coarse
