"""What the film is made of, triangle by triangle.

The suspended film, and the overhang of its frame where there is one.
"""

import numpy as np
from numpy.typing import NDArray

from femnl.core.mechanics import Domain
from femnl.mechanics.fem.forms import Index, plane_stress, thickness

Array = NDArray[np.float64]


class Sheet:
    """The film's constants in the triangles of a mesh.

    At points (e, q, 2) [m] where they vary within a triangle.

    Args: domain: its mesh has the subdomain `overhang` where the device has one. poisson: takes the
    place of Poisson's ratio.
    Attributes: largest_poisson: of what the film is made of.
    """

    def __init__(self, domain: Domain, poisson: float | None = None) -> None:
        self._model = domain.model
        films = [domain.model.film]
        self._which = np.zeros(1, dtype=np.int64)
        if domain.model.overhang is not None:
            films.append(domain.model.overhang.film)
            self._which = np.zeros(domain.mesh.nelements, dtype=np.int64)
            self._which[(domain.mesh.subdomains or {})["overhang"]] = 1
        self.largest_poisson = max(f.poisson for f in films)
        self._thickness = np.array([f.thickness for f in films])
        self._density = np.array([f.density for f in films])
        self._stress = np.array([f.stress for f in films])
        self._moduli = np.stack(
            [plane_stress(f.young, f.poisson if poisson is None else poisson) for f in films]
        )

    def _films(self, triangles: Index | slice) -> Index:
        """Which film (e,) the triangles are of; (1,) where all are of one."""
        return self._which[triangles] if len(self._which) > 1 else self._which

    def thickness(self, triangles: Index | slice, point: Array) -> Array:
        """Thickness h (e, q) [m]."""
        film = self._films(triangles)
        h = thickness(self._model, point)
        return np.where(film[:, None] > 0, self._thickness[film][:, None], h)

    def density(self, triangles: Index | slice) -> Array:
        """Density ρ (e, 1) [kg/m³]."""
        return np.asarray(self._density[self._films(triangles)][:, None])

    def stress(self, triangles: Index | slice) -> Array:
        """The film stress before release as (xx, yy, xy), (e, 1, 3) [Pa]."""
        return np.asarray(
            self._stress[self._films(triangles)][:, None, None] * np.array([1.0, 1.0, 0.0])
        )

    def moduli(self, triangles: Index | slice) -> Array:
        """C of σ = C ε in plane stress, (e, 1, 3, 3) [Pa]."""
        return np.asarray(self._moduli[self._films(triangles)][:, None])

    def membrane(self, triangles: Index | slice, point: Array) -> Array:
        """Stiffness h C (e, q, 3, 3) [N/m] of strains (xx, yy, 2xy)."""
        return np.asarray(
            self.thickness(triangles, point)[..., None, None] * self.moduli(triangles)
        )

    def bending(self, triangles: Index | slice, point: Array) -> Array:
        """Stiffness h³/12 C (e, q, 3, 3) [N m] of curvatures (xx, yy, 2xy)."""
        return np.asarray(
            self.thickness(triangles, point)[..., None, None] ** 3 / 12 * self.moduli(triangles)
        )
