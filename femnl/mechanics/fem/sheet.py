"""What the film is made of, triangle by triangle.

The suspended film, the layers on it, and the overhang of its frame where there is one.
"""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Lamina
from femnl.core.domain import Domain
from femnl.mechanics.fem.forms import Index, plane_stress, thickness

Array = NDArray[np.float64]


class Sheet:
    """The film's constants in the triangles of a mesh.

    Constants that vary within a triangle are given at points (e, q, 2) [m].

    Args: domain: its mesh has the subdomain `overhang` where the device has one, and `layer-k`
    where its k-th layer lies. poisson: takes the
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
        self._poisson = poisson
        self._laminae = domain.model.layers
        self._covered = np.zeros((len(self._laminae), domain.mesh.nelements))
        for k, on in enumerate(self._covered):
            on[(domain.mesh.subdomains or {})[f"layer-{k}"]] = 1.0
        self.largest_poisson = max(
            [f.poisson for f in films] + [lamina.poisson for lamina in self._laminae]
        )
        self._thickness = np.array([f.thickness for f in films])
        self._density = np.array([f.density for f in films])
        self._stress = np.array([f.stress for f in films])
        self._moduli = np.stack(
            [plane_stress(f.young, f.poisson if poisson is None else poisson) for f in films]
        )

    def _films(self, triangles: Index | slice) -> Index:
        """Return which film (e,) the triangles are of; (1,) where all are of one."""
        return self._which[triangles] if len(self._which) > 1 else self._which

    def thickness(self, triangles: Index | slice, point: Array) -> Array:
        """Return the thickness h (e, q) [m]."""
        film = self._films(triangles)
        h = thickness(self._model, point)
        return np.where(film[:, None] > 0, self._thickness[film][:, None], h)

    def density(self, triangles: Index | slice) -> Array:
        """Return the density ρ (e, 1) [kg/m³]."""
        return np.asarray(self._density[self._films(triangles)][:, None])

    def stress(self, triangles: Index | slice) -> Array:
        """Return the film stress before release as (xx, yy, xy), (e, 1, 3) [Pa]."""
        return np.asarray(
            self._stress[self._films(triangles)][:, None, None] * np.array([1.0, 1.0, 0.0])
        )

    def moduli(self, triangles: Index | slice) -> Array:
        """Return C of σ = C ε in plane stress, (e, 1, 3, 3) [Pa]."""
        return np.asarray(self._moduli[self._films(triangles)][:, None])

    def tension(self, triangles: Index | slice, point: Array) -> Array:
        """Return Σ hᵢσᵢ before release, (e, q, 3) [N/m] as (xx, yy, xy)."""
        h = self.thickness(triangles, point)
        total = h[..., None] * self.stress(triangles)
        for lamina, size in self._layers(triangles):
            total = total + size[..., None] * lamina.stress * np.array([1.0, 1.0, 0.0])
        return np.asarray(total)

    def inertia(self, triangles: Index | slice, point: Array) -> Array:
        """Return the mass by area Σ ρᵢhᵢ, (e, q) [kg/m²]."""
        total = self.density(triangles) * self.thickness(triangles, point)
        for lamina, size in self._layers(triangles):
            total = total + lamina.density * size
        return np.asarray(total)

    def total_thickness(self, triangles: Index | slice, point: Array) -> Array:
        """Return the thickness of film and layers together, (e, q) [m]."""
        total = self.thickness(triangles, point)
        for _, size in self._layers(triangles):
            total = total + size
        return total

    def membrane(self, triangles: Index | slice, point: Array) -> Array:
        """Return the stiffness A = Σ hᵢCᵢ (e, q, 3, 3) [N/m] of strains (xx, yy, 2xy)."""
        h = self.thickness(triangles, point)
        total = h[..., None, None] * self.moduli(triangles)
        for lamina, size in self._layers(triangles):
            total = total + size[..., None, None] * self._laminate_moduli(lamina)
        return np.asarray(total)

    def bending(self, triangles: Index | slice, point: Array) -> Array:
        """Return the stiffness D − B A⁻¹ B (e, q, 3, 3) [N m] of curvatures (xx, yy, 2xy).

        A, B, D = Σ ∫ Cᵢ (1, z, z²) dz, z from the film's middle. This is bending about the neutral
        plane where no in-plane force goes with it: exact for an even laminate of one Poisson's
        ratio, and otherwise a lower bound, as D about the film's middle is an upper one.
        Source: Jones, Mechanics of Composite Materials (1999), section 4.2.
        """
        h = self.thickness(triangles, point)
        if not self._laminae:
            return np.asarray(h[..., None, None] ** 3 / 12 * self.moduli(triangles))
        return np.asarray(np.sum(self.bending_parts(triangles, point), axis=0))

    def bending_about_middle(self, triangles: Index | slice, point: Array) -> Array:
        """Return D = Σ ∫ Cᵢ z² dz (e, q, 3, 3) [N m], z from the film's middle."""
        return self._integrated(triangles, point, lambda h, z: h * z**2 + h**3 / 12)

    def couple(self, triangles: Index | slice, point: Array) -> Array:
        """Return B = Σ ∫ Cᵢ z dz (e, q, 3, 3) [N], z from the film's middle."""
        return self._integrated(triangles, point, lambda h, z: h * z)

    def moment(self, triangles: Index | slice, point: Array) -> Array:
        """Return M₀ = Σ σᵢhᵢzᵢ of the layers' stresses before release, (e, q) [N]."""
        stresses = [0.0, *(lamina.stress for lamina in self._laminae)]  # the film's middle is z = 0
        plies = self._plies(triangles, point)
        parts = [s * size * z for s, (size, z, _) in zip(stresses, plies, strict=True)]
        return np.asarray(np.sum(parts, axis=0))

    def _integrated(
        self,
        triangles: Index | slice,
        point: Array,
        weight: Callable[[Array, Array], Array],
    ) -> Array:
        """Return Σ Cᵢ w(hᵢ, zᵢ) (e, q, 3, 3), of thickness and height of film and layers."""
        plies = self._plies(triangles, point)
        parts = [weight(size, z)[..., None, None] * moduli for size, z, moduli in plies]
        return np.asarray(np.sum(parts, axis=0))

    def bending_parts(self, triangles: Index | slice, point: Array) -> Array:
        """What film and layers (in their order) each give to `bending`, (1 + n, e, q, 3, 3) [N m].

        A layer at height z is strained by (z − X) κ with X = A⁻¹B where no in-plane force goes with
        the curvature κ; its part is ∫ (z − X)ᵀ C (z − X) dz.
        """
        plies = list(self._plies(triangles, point))
        membrane = np.sum([size[..., None, None] * moduli for size, _, moduli in plies], axis=0)
        couple = np.sum(
            [(size * height)[..., None, None] * moduli for size, height, moduli in plies], axis=0
        )
        shift = np.linalg.solve(membrane, couple)
        found = []
        for size, height, moduli in plies:
            own = (size * height**2 + size**3 / 12)[..., None, None] * moduli
            cross = (size * height)[..., None, None] * (moduli @ shift)
            moved = np.swapaxes(shift, -1, -2) @ moduli @ shift
            both = cross + np.swapaxes(cross, -1, -2)
            found.append(own - both + size[..., None, None] * moved)
        return np.stack(found)

    def _plies(
        self, triangles: Index | slice, point: Array
    ) -> Iterator[tuple[Array, Array, Array]]:
        """Film and layers: thickness and height of the middle (e, q) [m], and C (…, 3, 3) [Pa]."""
        h = self.thickness(triangles, point)
        yield h, np.zeros_like(h), self.moduli(triangles)
        ends = {"top": h / 2, "bottom": h / 2}
        for lamina, size in self._layers(triangles):
            away = ends[lamina.side] + size / 2
            ends[lamina.side] = ends[lamina.side] + size
            height = away if lamina.side == "top" else -away
            whole = np.broadcast_to(size, h.shape)
            yield whole, height, self._laminate_moduli(lamina)

    def _layers(self, triangles: Index | slice) -> Iterator[tuple[Lamina, Array]]:
        """Each layer, and its thickness (e, 1) [m], 0 where it is not."""
        for lamina, covered in zip(self._laminae, self._covered, strict=True):
            yield lamina, lamina.thickness * covered[triangles][:, None]

    def _laminate_moduli(self, lamina: Lamina) -> Array:
        poisson = lamina.poisson if self._poisson is None else self._poisson
        return plane_stress(lamina.young, poisson)
