"""The simulated film that all measurements of a file share.

Its modes, their projection, and how frequencies follow ℓ.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.core.operators import Projection
from femnl.core.processes import one_blas_thread
from femnl.core.readout import Array
from femnl.device.mesh import WEDGES, covers, film_middle, has_symmetry
from femnl.io.results.projection import cached_projection
from femnl.mechanics.airload import airload
from femnl.mechanics.fem.laminate import (
    as_in_spectra,
    keeps_layers,
    one_material,
    told_of_layers,
)
from femnl.mechanics.modes.dilution import bending_share
from femnl.mechanics.modes.effective import effective_stiffness
from femnl.mechanics.modes.projection import project
from femnl.mechanics.modes.quality import load_of_layers
from femnl.mechanics.prestress import solve_units
from femnl.mechanics.tension import effort_of, solve_tension
from femnl.pipeline import solve_modes, solve_nonlinearity

BENDING = (0.0, 1.0, 2.0, 4.0)
"""Bending lengths, in units of the geometry's own, at which the modes are solved; between them k²
is a cubic in ℓ.
"""

BENDING_OF_LAYERS = (0.0, 0.5, 1.0, 1.5, 2.5, 4.0)
"""The same where a layer ends on the film: its rim bends the film too, and a cubic misses 2e-5 of a
frequency a fifth away.
"""
THICKER = (-0.5, -0.4, -0.15, 0.15, 0.4, 0.5)
"""Relative changes of the thickness of layers at which the film is solved."""
GRID = 96
"""Points along each side of the film's box at which integrals over its surface are summed."""
STIFFNESS = 0.1
"""Part of the geometry's ℓ below which a film's loss keeps its pattern: at ℓ = 0 none is left."""
UNITS = 3
"""Degree of the elements in which changes of the film stress relax in the plane."""


@dataclass(frozen=True)
class SimulatedFilm:
    """A device and its lowest modes, solved when first asked for and kept on disk.

    notes: what a diagnosis by it has to tell. layered: whether it keeps its layers, as where they
    have a shape; then the film is that without them, and moduli and densities of layers go with its
    own where c and ℓ change.
    """

    model: Model
    count: int
    notes: tuple[str, ...] = ()
    layered: bool = False

    @classmethod
    def of_one_material(cls, model: Model, count: int) -> Self:
        """Return a device whose layers are taken together with its film; see `one_material`.

        Raises:
            ParameterError: layers that no film of one material stands for.
        """
        if not model.layers:
            return cls(model, count)
        alike = one_material(model)
        film = alike.film
        told = (
            f"{model.name}: film and layers are taken for one film, which moves as they do, of "
            f"{film.thickness * 1e9:.4g} nm with E = {film.young / 1e9:.4g} GPa, "
            f"ρ = {film.density:.4g} kg/m³ and σ = {film.stress / 1e6:.4g} MPa"
        )
        return cls(alike, count, (told,))

    @classmethod
    def for_spectra(cls, model: Model, count: int) -> Self:
        """Return a device whose layers stay as they are where one of them has a shape.

        Others are taken together with the film, as `of_one_material` does.

        Raises:
            ParameterError: layers of a film that may bend at rest from its edges.
        """
        if not keeps_layers(model):
            return cls.of_one_material(model, count)
        return cls(as_in_spectra(model), count, (told_of_layers(model),), layered=True)

    @cached_property
    def modes(self) -> Modes:
        """The lowest modes of the device as its geometry says.

        Raises:
            ParameterError: a film with layers that it does not keep, as all causes but those of
                spectra change one even material.
        """
        if self.model.layers and not self.layered:
            raise ParameterError(
                f"{self.model.name}: [layers]: causes act on a film of one material, and those of "
                "spectra alone are modelled with layers; leave them out, or take the geometry of "
                "an equivalent film"
            )
        # How far layers bend the film is among the notes
        return solve_modes(self.model, self.count, self._symmetry, tell=not self.layered)

    @property
    def _symmetry(self) -> str:
        """Which part of the film is solved: what mirrors through the origin leave of it.

        Causes are laws of x and y from there.
        """
        x, y = film_middle(self.model)
        if x == 0 and y == 0:
            return "auto"
        return "half" if y == 0 and has_symmetry(self.model, WEDGES["half"]) else "full"

    @cached_property
    def projection(self) -> Projection:
        """Integrals of those modes, and what changes of the tension do to them."""

        def solve() -> Projection:
            modes = self.modes
            units = solve_units(modes.domain, UNITS)
            with one_blas_thread():
                tension = solve_tension(modes, units, effort_of(modes))
                return replace(project(modes, units), tension=tension)

        return cached_projection(self.model, ("projection", self.count), solve)

    @cached_property
    def alpha(self) -> Array:
        """Simulated α of each mode, in m⁻²."""
        return solve_nonlinearity(self.modes).alpha

    @property
    def bending_length(self) -> float:
        """ℓ = √(D/T) of the film, in m, without layers; T is its tension before release."""
        film = self.model.film
        return float(
            film.thickness * np.sqrt(film.young / (12 * (1 - film.poisson**2) * film.stress))
        )

    @property
    def speed(self) -> float:
        """C = √(σ/ρ) of the film, in m/s, without layers."""
        return float(np.sqrt(self.model.film.stress / self.model.film.density))

    @property
    def gap(self) -> float:
        """Distance of the wafer below the film [m], infinite where the geometry has no stack."""
        stack = self.model.stack
        return np.inf if stack is None else stack.layers[stack.gap].thickness

    @cached_property
    def bending_share(self) -> Array:
        """Part of each mode's energy that is stored in bending, (n,); 1 without bending."""
        return bending_share(self.modes) if self.model.bending else np.ones(self.count)

    def bending_share_at(self, bending_length: float) -> Array:
        """Return the same at another ℓ [m] under the same tension, (n,).

        ∂ ln ω²/∂ ln ℓ², as the energy of bending is ∝ ℓ²: of the cubic k²(ℓ), times what it misses
        at the geometry's own ℓ. Right to 1e-4 of the film solved anew from a half to 1.5 of that.
        """
        if not self.model.bending:
            return self.bending_share
        length = max(bending_length, STIFFNESS * self.bending_length)
        known = self._share(self.bending_length)
        return np.asarray(self._share(length) * self.bending_share / known)

    def _share(self, length: float) -> Array:
        power = np.arange(len(self.layer))
        k2 = length**power @ self.layer
        rise = power * length**power @ self.layer  # ∂k²/∂ ln ℓ
        square = k2 + length**2 * k2**2
        change = rise + 2 * length**2 * k2 * (k2 + rise)
        return np.asarray(change / (2 * square))

    @cached_property
    def airload(self) -> Array:
        """∫∫ξᵢξⱼ′/(2πr) [m³], (n, n): see `femnl.mechanics.airload`; a rigid baffle around it."""
        step, _, _, shapes = self._sampled
        return airload(shapes, step)

    @cached_property
    def rigid(self) -> Array:
        """Return ∫μφξ/√∫μφ² of each mode, (3, n) [√kg], for φ = 1, x and y, μ the mass by area.

        It is right to 1e-3 where film and layers are even; holes count as film.
        """
        step, x, y, shapes = self._sampled
        inside = np.any(shapes != 0, axis=0)
        mass = self._mass_by_area(x, y) * inside * step[0] * step[1]
        motions = [np.ones_like(inside, float), *np.meshgrid(x, y)]
        rows = [
            np.tensordot(shapes, phi * mass, 2) / np.sqrt(np.sum(phi**2 * mass)) for phi in motions
        ]
        return np.array(rows)

    def _mass_by_area(self, x: Array, y: Array) -> Array:
        """Return Σρh of film and layers on a grid (n_y, n_x) [kg/m²]."""
        film = self.model.film
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        mass = np.full(len(points), film.density * film.thickness)
        for lamina in self.model.layers:
            mass += lamina.density * lamina.thickness * covers(lamina, points)
        return mass.reshape(len(y), len(x))

    @cached_property
    def area(self) -> Array:
        """∫ξ² of each mode, (n,) [m²], where layers are kept; else empty, as then it is m/ρh."""
        if not self.layered:
            return np.empty(0)
        film = self.model.film
        return self.modes.effective_mass / (
            load_of_layers(self.modes) * film.density * film.thickness
        )

    @cached_property
    def _sampled(self) -> tuple[tuple[float, float], Array, Array, Array]:
        """Steps [m], axes and ξ (n, GRID, GRID) at the middles of even cells over the box."""
        middle = (np.arange(GRID) + 0.5) / GRID * 2 - 1
        x = self.projection.grid_x[-1] * middle
        y = self.projection.grid_y[-1] * middle
        steps = float(x[1] - x[0]), float(y[1] - y[0])
        return steps, x, y, self.projection.on_grid(x, y)

    @cached_property
    def layer(self) -> Array:
        """Coefficients of each mode's k² as a polynomial in ℓ [m], (p, n), lowest power first.

        It moves through the clamped edge and the rims of layers alone. The polynomial is a cubic
        where no layers are kept.
        """
        factors = BENDING_OF_LAYERS if self.layered else BENDING
        lengths = np.array(factors) * self.bending_length
        rows = [self.modes.frequency if factor == 1 else self._solved(factor) for factor in factors]
        square = (2 * np.pi * np.array(rows) / self.speed) ** 2
        # Of k² + ℓ²k⁴ = (ω/c)²
        k2 = 2 * square / (1 + np.sqrt(1 + 4 * lengths[:, None] ** 2 * square))
        powers = np.arange(len(factors))
        return np.asarray(
            np.linalg.solve(np.array(factors)[:, None] ** powers, k2)
            / self.bending_length ** powers[:, None]
        )

    @cached_property
    def thicker(self) -> Array:
        """What layers of thickness h(1 + t) add to K [N/m], by powers of t from 1, (p, n, n).

        A polynomial through the film solved at `THICKER`; none where no layers are kept.
        """
        if not self.layered:
            return np.empty((0, 1, 1))
        own = np.diag(self.modes.stiffness)
        rows = []
        for part in THICKER:
            layers = [
                replace(one, thickness=(1 + part) * one.thickness) for one in self.model.layers
            ]
            changed = replace(self.model, layers=tuple(layers))
            modes = solve_modes(changed, self.count, self._symmetry, tell=False)
            rows.append((effective_stiffness(self.modes, modes) - own).ravel())
        powers = np.array(THICKER)[:, None] ** np.arange(1, len(THICKER) + 1)
        return np.linalg.solve(powers, np.array(rows)).reshape(-1, self.count, self.count)

    def _solved(self, factor: float) -> Array:
        """Return the frequencies [Hz] of a film as stiff in bending as ℓ times a factor makes it.

        All moduli change alike, which leaves the stress after release as it is.
        """
        stiffer = replace(self.model, bending=factor > 0)
        if factor > 0:
            film = replace(stiffer.film, young=stiffer.film.young * factor**2)
            layers = [replace(one, young=one.young * factor**2) for one in stiffer.layers]
            stiffer = replace(stiffer, film=film, layers=tuple(layers))
        modes = solve_modes(stiffer, self.count, self._symmetry, tell=False)
        names = dict(zip(modes.label, modes.frequency, strict=True))
        known = [name for name in self.modes.label if name is not None]
        if len(set(known)) == self.count and set(known) == set(names):
            return np.array([names[name] for name in self.modes.label])
        return modes.frequency

    def frequency(self, speed: float, bending_length: float) -> Array:
        """Return the frequency of every mode [Hz] at another c [m/s] and ℓ [m]."""
        k2 = bending_length ** np.arange(len(self.layer)) @ self.layer
        return np.asarray(speed / (2 * np.pi) * np.sqrt(k2 + bending_length**2 * k2**2))
