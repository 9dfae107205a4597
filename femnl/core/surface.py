"""The whole film as what pictures and other programs draw."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """The whole film as quadratic triangles with nodal fields, for pictures and other programs.

    points (n, 2) [m]; triangles (m, 6) in VTK's order; shapes (n_modes, n); thickness (n,) [m];
    stress (n, 3) [Pa] as (xx, yy, xy): the relaxed film stress; in_plane (n, 2) [m]: the
    displacement that relaxed it.
    """

    points: Array
    triangles: NDArray[np.int64]
    shapes: Array
    thickness: Array
    stress: Array
    in_plane: Array

    def __post_init__(self) -> None:
        freeze(self)
