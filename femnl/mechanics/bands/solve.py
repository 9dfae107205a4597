"""Frequencies of waves in a film with a lattice of holes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_matrix

from femnl.core.arrays import freeze
from femnl.core.device import Model
from femnl.core.discretisation_error import remainder
from femnl.core.domain import Prestress
from femnl.core.errors import ParameterError
from femnl.core.modes import STEADY
from femnl.mechanics.bands.cell import Periodic, cell_domain, periodic
from femnl.mechanics.bands.find import find_cell, given_cell
from femnl.mechanics.bands.lattice import Lattice
from femnl.mechanics.bands.spectrum import lowest_eigenvalues
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells, quadrature_order
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.stress import relaxed_tension
from femnl.mechanics.prestress import solve_prestress

Array = NDArray[np.float64]

DEGREES = (4, 3, 2)
LONGEST = 0.05  # of π/pitch: the wave number that lifts stiffnesses of longer waves
ALIKE = 1e-5
"""Of the speed of long waves, a difference that is that of the mesh."""
STILL = 1e-6  # of the lift, below which ω² is that of the film that moves as a whole


@dataclass(frozen=True)
class Bands:
    """Frequencies of waves w = φ(r) e^{ik·r}, φ periodic, by rising frequency at each wave vector.

    wave (n, 2) [rad/m]; frequency (n, n_bands) [Hz] and its discretisation error, an upper
    estimate; corners: names and places of the wave vectors at which a path turns, none where the
    wave vectors were given. tension (2, 2) [N/m], mass [kg/m²]: of waves that are long. inside,
    inside_error (m, n_bands) [Hz]: the same as of `frequency` within the irreducible part, none
    where wave vectors were given.
    """

    lattice: Lattice
    wave: Array
    frequency: Array
    frequency_error: Array
    corners: tuple[tuple[str, int], ...]
    tension: Array
    mass: float
    inside: Array
    inside_error: Array

    def __post_init__(self) -> None:
        freeze(self)

    def speed_along(self, direction: ArrayLike) -> Array:
        """Return √(e·T·e/μ) of long waves along directions (..., 2) of any length [m/s].

        The relaxed tension N has no divergence, so that its mean over the cell is T exactly.
        """
        e = np.asarray(direction, dtype=float)
        pull = np.einsum("...i,ij,...j->...", e, self.tension, e) / np.sum(e**2, axis=-1)
        return np.asarray(np.sqrt(pull / self.mass))

    @property
    def axes(self) -> Array:
        """Directions (2, 2) of the slowest and of the fastest long waves, in rows.

        x and y where all are as fast.
        """
        (low, high), directions = np.linalg.eigh(self.tension)
        return np.eye(2) if high - low < 2 * ALIKE * high else np.asarray(directions.T)

    @property
    def speed(self) -> Array:
        """The speeds (2,) [m/s] of long waves along `axes`."""
        return self.speed_along(self.axes)

    @property
    def gaps(self) -> tuple[tuple[float, float], ...]:
        """Ranges of frequency [Hz] between bands without a wave, less their errors.

        Complete ones where the wave vectors run around the irreducible part.
        """
        frequency = np.concatenate([self.frequency, self.inside])
        error = np.concatenate([self.frequency_error, self.inside_error])
        low = (frequency + error).max(axis=0)[:-1]
        high = (frequency - error).min(axis=0)[1:]
        return tuple((float(a), float(b)) for a, b in zip(low, high, strict=True) if b > a)


def solve_bands(
    model: Model,
    count: int = 6,
    wave: Array | None = None,
    steps: int = 12,
    lattice: Lattice | None = None,
    resolution: float = 1.0,
) -> Bands:
    """Solve the bands of flexural waves in a film, as if its lattice of holes had no edge.

    One cell, stretched until its holes carry no traction and its mean strain is zero, with
    ∫ N : ∇w⊗∇v* + D[(1−ν)∇∇w:∇∇v* + ν Δw Δv*] = ω² ∫ ρh w v*, w(r + R) = e^{ik·R} w(r) for every
    step R of the lattice.

    Args: count: how many bands. wave: wave vectors (n, 2) [rad/m], a row of the lattice along x; by
        default a path around the irreducible part, Γ–X–M–Γ or Γ–M–K–Γ, with `steps` of them on its
        first side. lattice: the device's holes' by default; has to be given for a film with no
        holes or with one. resolution: of the mesh.
    Returns: Bands.
    Raises: ParameterError, GeometryError, ConvergenceError.
    Valid: far from the edge; gradients of the thickness, overhangs and elastic edges are left out.
        A layer covers the same part of every cell; where the lattice is given, one that lies in the
        cell about the hole, or about the middle of the film, lies in every cell.
    Source: Bloch's theorem; Brillouin, Wave Propagation in Periodic Structures (1946). Held against
        folded plane waves, standing waves of many cells and the constants of the even film by
        tests/physics/test_bands.py, and with layers against transfer matrices, plane waves and
        hinged films by tests/physics/test_bands_of_layers.py.
    """
    if count < 1 or steps < 1:
        raise ParameterError(f"count = {count}, steps = {steps}: expected at least one of each")
    cell = find_cell(model) if lattice is None else given_cell(model, lattice)
    lattice = cell.lattice
    places, corners = (
        lattice.path(steps, cell.points) if wave is None else (np.asarray(wave, dtype=float), ())
    )
    if places.ndim != 2 or places.shape[1] != 2 or not np.all(np.isfinite(places)):
        raise ParameterError(
            "wave: expected finite wave vectors (n, 2) in rad/m, found an array of shape "
            f"{places.shape}"
        )
    inside = cell.inside if wave is None else np.empty((0, 2))
    every = np.concatenate([places, inside])
    domain = cell_domain(cell, model, resolution)
    tension = np.zeros((2, 2))
    mass = 0.0
    found = []
    for degree in DEGREES:
        prestress = solve_prestress(domain, degree, "sliding")
        if degree == DEGREES[0]:
            tension, mass = _means(prestress, lattice)
        waves = periodic(domain, lattice, prestress, degree)
        square = float(np.trace(tension)) / 2 / mass
        found.append(np.array([_frequencies(waves, k, count, lattice, square) for k in every]))
    scale = np.where(found[0] > 0, found[0], 1.0)
    error = remainder(found, scale, STEADY)
    n = len(places)
    return Bands(
        lattice,
        places,
        found[0][:n],
        error[:n],
        corners,
        tension,
        mass,
        found[0][n:],
        error[n:],
    )


def _frequencies(cell: Periodic, wave: Array, count: int, lattice: Lattice, square: float) -> Array:
    """Return the frequencies (count,) [Hz] of the lowest waves at one wave vector.

    Args: square: c² [m²/s²] of long waves, the mean of both axes. A spring of c² times a wave
    number squared is added to K, which is singular for a film that moves as a whole, and is taken
    off its eigenvalues again.
    """
    lift = square * max(float(wave @ wave), (LONGEST * np.pi / lattice.pitch) ** 2)
    stiffness, mass = cell.at(wave)
    values = lowest_eigenvalues(csc_matrix(stiffness + lift * mass), mass, count) - lift
    # A film that moves as a whole has ω = 0, up to the rounding of K, which small elements make
    # stiff.
    rounding = np.finfo(float).eps * abs(stiffness).max() / abs(mass).max()
    still = max(STILL * lift, rounding)
    return np.asarray(np.sqrt(np.where(values > still, values, 0.0)) / (2 * np.pi))


def _means(prestress: Prestress, lattice: Lattice) -> tuple[Array, float]:
    """Return the mean tension (2, 2) [N/m] and mass [kg/m²] of the cell, holes counted as empty.

    They are those of waves that are long.
    """
    domain = prestress.domain
    order = quadrature_order(prestress.domain.model, 2 * prestress.degree)
    space = Space(domain.mesh, prestress.degree)
    sheet = Sheet(domain)
    pulls = np.zeros(3)
    mass = 0.0
    for cell, pull in zip(cells(space, order), relaxed_tension(prestress, order), strict=True):
        mass += float(np.sum(sheet.inertia(cell.triangles, cell.jet.point) * cell.dx))
        pulls += np.sum(pull * cell.dx[..., None], axis=(0, 1))
    corners = lattice.corners
    area = (
        float(
            np.sum(
                corners[:, 0] * np.roll(corners[:, 1], -1)
                - corners[:, 1] * np.roll(corners[:, 0], -1)
            )
        )
        / 2
    )
    xx, yy, xy = pulls / area
    return np.array([[xx, xy], [xy, yy]]), mass / area
