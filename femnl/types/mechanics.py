"""What the mechanical stages hand on: mesh, relaxed stress, modes and geometric nonlinearity."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from femnl.types.arrays import freeze
from femnl.types.device import Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Domain:
    """The meshed film, whole or the wedge that mirror lines through the origin leave of it.

    mesh: quadratic (curved) triangles, coordinates in m; named boundaries `clamped`, `free` (film ends or holes) and,
    for a wedge, `mirror-0` on the x axis and `mirror-1` on the line at the angle `wedge` [rad]. wedge = 2π is the whole film,
    π the upper half, π/2 a quarter, π/4 an eighth, π/6 a twelfth. diagonal: the mesh of a quarter is its own image under
    x ↔ y, so that modes odd in y are those odd in x, exchanged.
    """

    model: Model
    mesh: MeshTri2
    wedge: float
    diagonal: bool = False

    @property
    def copies(self) -> int:
        """How many copies of the mesh make up the whole film."""
        return round(2 * np.pi / self.wedge)


@dataclass(frozen=True)
class Prestress:
    """The film stress after holes and free edges have relaxed: N(x) = h (σ₀ I + C ε(u)), in N/m.

    displacement: in-plane displacement [m] at the dofs of the vector element of the given polynomial degree on `domain.mesh`.
    """

    domain: Domain
    degree: int
    displacement: Array

    def __post_init__(self) -> None:
        freeze(self)


@dataclass(frozen=True)
class Modes:
    """Prestressed modes by rising frequency; shapes have max|ξ| = 1, positive at that point.

    frequency [Hz], effective_mass [kg] (∫ρhξ² over the whole film), shapes (n_modes, n_dofs) at the dofs of the scalar
    element of the given degree on the wedge's mesh; parity[i] holds the signs of mode i under the wedge's mirrors
    (+1 even, −1 odd; empty for the whole film). label "(m,n)" by overlap with ideal shapes, None where it has none.
    coarse: the same modes at one degree less on the same mesh, in the same order, for estimates of the discretisation error.
    """

    prestress: Prestress
    degree: int
    frequency: Array
    effective_mass: Array
    shapes: Array
    parity: tuple[tuple[int, ...], ...]
    label: tuple[str | None, ...]
    coarse: "Modes | None" = None

    def __post_init__(self) -> None:
        freeze(self)

    @property
    def domain(self) -> Domain:
        """The meshed film that the modes were solved on."""
        return self.prestress.domain

    @property
    def ratio(self) -> Array:
        """f/f₁."""
        return np.asarray(self.frequency / self.frequency[0])

    @property
    def ratio_error(self) -> Array:
        """Discretisation error of f/f₁: its difference to one degree less, which bounds the error; infinite without `coarse`."""
        return np.full(len(self.frequency), np.inf) if self.coarse is None else np.abs(self.ratio - self.coarse.ratio)

    @property
    def frequency_error(self) -> Array:
        """Discretisation error of f [Hz], in the same way."""
        return np.full(len(self.frequency), np.inf) if self.coarse is None else np.abs(self.frequency - self.coarse.frequency)

    @property
    def stiffness(self) -> Array:
        """Modal stiffness k = m_eff ω², in N/m."""
        return np.asarray(self.effective_mass * (2 * np.pi * self.frequency) ** 2)


@dataclass(frozen=True)
class Nonlinearity:
    """Geometric cubic coefficients in the coordinate q = displacement [m] of the point where |ξ| = 1.

    k3 [N/m³] and alpha = k3/k [m⁻²] of each mode, so that m q̈ = −k q − k₃ q³. alpha_error: discretisation error, the difference
    to one degree less, infinite where the modes carry no coarse counterpart. tensor (n, n, n, n) [N/m³], where asked for: the
    force on mode i is −Σ tensor[i,j,k,l] q_j q_k q_l; fully symmetric.
    """

    edge: str
    k3: Array
    alpha: Array
    alpha_error: Array
    tensor: Array | None = None

    def __post_init__(self) -> None:
        freeze(self)


@dataclass(frozen=True)
class Surface:
    """The whole film as quadratic triangles with fields at their nodes, for pictures and other programs.

    points (n, 2) [m]; triangles (m, 6) in VTK's order; shapes (n_modes, n); thickness (n,) [m]; stress (n, 3) [Pa] as
    (xx, yy, xy): the relaxed film stress; in_plane (n, 2) [m]: the displacement that relaxed it.
    """

    points: Array
    triangles: NDArray[np.int64]
    shapes: Array
    thickness: Array
    stress: Array
    in_plane: Array

    def __post_init__(self) -> None:
        freeze(self)
