"""A meshed device, and its film stress after release."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from femnl.core.arrays import freeze
from femnl.core.device import Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Domain:
    """The meshed film, whole or the wedge that mirror lines through its middle leave of it.

    mesh: quadratic (curved) triangles, coordinates in m; named boundaries `clamped`, `free` (film
    ends or holes) and, for a wedge, `mirror-0` along x and `mirror-1` on the line at the angle
    `wedge` [rad]. wedge = 2π is the whole film, π the upper half, π/2 a quarter, π/4 an
    eighth, π/6 a twelfth. diagonal: the mesh of a quarter is its own image under x ↔ y, so that
    modes odd in y are those odd in x, exchanged. tiles: where the mesh is made of the tiles of
    `mechanics.lattice`, the resolution of theirs; 0 elsewhere. misfit: how far elliptical edges of
    the mesh, which are arcs of circles, lie from their ellipses, over the shorter half axis.
    middle [m]: of the film, where its mirrors cross.
    """

    model: Model
    mesh: MeshTri2
    wedge: float
    diagonal: bool = False
    tiles: float = 0.0
    misfit: float = 0.0
    middle: tuple[float, float] = (0.0, 0.0)

    def __repr__(self) -> str:
        """Device and number of triangles."""
        return (
            f"<Domain of {self.model.name}: {self.mesh.nelements} triangles, {self.copies} of "
            "which make the film>"
        )

    @property
    def copies(self) -> int:
        """How many copies of the mesh make up the whole film."""
        return round(2 * np.pi / self.wedge)


@dataclass(frozen=True)
class Prestress:
    """The film stress after holes and free edges have relaxed: N(x) = h (σ₀ I + C ε(u)), in N/m.

    displacement: in-plane displacement [m] at the dofs of the vector element of the given
    polynomial degree on `domain.mesh`.
    """

    domain: Domain
    degree: int
    displacement: Array

    def __post_init__(self) -> None:
        freeze(self)
