"""One cell of a lattice whose opposite sides are one.

K and M of waves w = e^{ik·r} φ with φ periodic.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, diags_array
from scipy.spatial import cKDTree

from femnl.core.device import Model
from femnl.core.domain import Domain, Prestress
from femnl.core.errors import ParameterError
from femnl.core.memory import need_memory
from femnl.device.mesh import covered, from_patches, mesh
from femnl.mechanics.bands.lattice import Cell, Lattice
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import Assembly
from femnl.mechanics.fem.interior_penalty import slope_continuity
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.modes.operators import Operators
from femnl.mechanics.modes.projection import film_images

Array = NDArray[np.float64]
Index = NDArray[np.int64]

JOIN = 1e-7  # of the pitch, up to which points are the same
DEGREE = 4  # of the elements that the mesh is meant for
BYTES = 90_000  # of memory a triangle, as of the modes of a film


def cell_domain(cell: Cell, model: Model, resolution: float) -> Domain:
    """Return the whole cell with its holes, put together from the part between two mirror lines.

    Its sides are `clamped`. As every part is an image of one, opposite sides have nodes that match.

    Args: cell: what repeats. model: the device whose film it is of.
    Raises: ParameterError, GeometryError.
    """
    if not 0.3 <= resolution <= 10:
        raise ParameterError(f"resolution = {resolution:g}: expected a number from 0.3 to 10")
    lattice = cell.lattice
    device = cell.of(model)
    # Without bending no side asks for the small elements of a clamped edge
    part = mesh(replace(device, bending=False), cell.symmetry, resolution, DEGREE)
    patches = np.asarray(part.mesh.doflocs).T[Space(part.mesh, 2).dofs]
    need_memory(BYTES * len(patches) * part.copies, "waves in one cell", "lower the resolution")
    images = [turn for turn, _ in film_images(part, ((1, 1),))]
    whole = from_patches(np.concatenate([patches @ turn.T for turn in images]))
    outer = np.flatnonzero(whole.f2t[1] < 0)
    middle = whole.p[:, whole.facets[:, outer]].mean(axis=1).T
    on_side = np.abs(middle @ lattice.steps.T).max(axis=1) / lattice.pitch**2 > 0.5 - JOIN
    return Domain(
        device,
        replace(
            whole,
            _boundaries={"clamped": outer[on_side], "free": outer[~on_side]},
            _subdomains=covered(device, whole),
        ),
        2 * np.pi,
    )


def inner(domain: Domain) -> Domain:
    """Return the same cell, whose sides hold nothing."""
    return replace(
        domain,
        mesh=replace(domain.mesh, _boundaries={"free": (domain.mesh.boundaries or {})["free"]}),
    )


@dataclass(frozen=True)
class Periodic:
    """K and M of the cell as functions of the wave vector.

    stiffness, mass (n, n): of the cell alone; place (n, 2) [m] of its unknowns, and which class of
    unknowns that are one by a step of the lattice each is of; seams: slope continuity across the
    sides, on unknowns of their own at places of classes.
    turned: U of real numbers: φ = U a makes φ(−r) the conjugate of φ(r), as every wave can be
    chosen in a cell that half a turn leaves as it is, and K and M real.
    """

    stiffness: csc_matrix
    mass: csc_matrix
    place: Array
    classes: Index
    seams: tuple[tuple[csc_matrix, Array, Index], ...]
    turned: csc_matrix

    def at(self, wave: Array) -> tuple[csc_matrix, csc_matrix]:
        """Return K and M (n_classes, n_classes) for a wave vector (2,) [rad/m]."""

        def real(matrix: csc_matrix, place: Array, classes: Index) -> csc_matrix:
            shift = diags_array(np.exp(1j * (place @ wave))) @ self.turned[classes]
            return csc_matrix(
                shift.real.T @ matrix @ shift.real + shift.imag.T @ matrix @ shift.imag
            )

        stiffness = real(self.stiffness, self.place, self.classes)
        for seam in self.seams:
            stiffness = csc_matrix(stiffness + real(*seam))
        return stiffness, real(self.mass, self.place, self.classes)


def periodic(domain: Domain, lattice: Lattice, prestress: Prestress, degree: int) -> Periodic:
    """Put the operators of a cell together for waves. Args: domain, prestress: of `cell_domain`."""
    operators = Operators(replace(prestress, domain=inner(domain)), degree)
    place = operators.space.location
    find = _finder(operators.space.location, lattice.pitch)
    whole = np.concatenate([lattice.steps, -lattice.steps])
    if lattice.turns == 4:
        whole = np.concatenate(
            [whole, [a + b for a in (whole[0], whole[2]) for b in (whole[1], whole[3])]]
        )
    images = np.stack([find(place + step) for step in whole] + [np.arange(len(place))])
    first = np.where(images >= 0, images, len(place)).min(axis=0)
    kept, classes = np.unique(first, return_inverse=True)
    opposite = classes[find(-place[kept])]
    seams = []
    if domain.model.bending:
        for step in lattice.steps:
            strip, facets = _strip(domain, step)
            sheet = Sheet(strip)
            space = Space(strip.mesh, degree)
            seam = Assembly(space.size)
            for local, dofs in slope_continuity(
                space, facets, sheet.bending, sheet.largest_poisson
            ):
                seam.add(local, dofs)
            here = find(space.location)
            there = find(space.location - step)
            seams.append((seam.matrix(), space.location, classes[np.where(here >= 0, here, there)]))
    return Periodic(
        operators.stiffness(()), operators.mass, place, classes, tuple(seams), _conjugate(opposite)
    )


def _finder(place: Array, pitch: float) -> Callable[[Array], Index]:
    """Return a function that returns which of the places points are, −1 for none."""
    tree = cKDTree(place)

    def find(points: Array) -> Index:
        distance, index = tree.query(points)
        return np.where(np.asarray(distance) < JOIN * pitch, index, -1)

    return find


def _strip(domain: Domain, step: Array) -> tuple[Domain, Index]:
    """Return triangles on both sides of the side that a step of the lattice crosses, and facets.

    Layers cover the triangles of the neighbour as they cover their images in the cell.
    """
    grid = domain.mesh
    pitch = float(np.linalg.norm(step))
    sides = np.asarray((grid.boundaries or {})["clamped"])
    across = grid.p[:, grid.facets[:, sides]].mean(axis=1).T @ step / pitch**2
    patches = np.asarray(grid.doflocs).T[Space(grid, 2).dofs]
    here, there = (grid.f2t[0, sides[np.abs(across - place) < JOIN]] for place in (0.5, -0.5))
    strip = from_patches(np.concatenate([patches[here], patches[there] + step]))
    images = np.concatenate([here, there])
    covers = {
        name: np.flatnonzero(np.isin(images, triangles))
        for name, triangles in (grid.subdomains or {}).items()
    }
    return replace(domain, mesh=replace(strip, _subdomains=covers)), np.flatnonzero(
        (strip.f2t[1] >= 0)
        & (np.abs(strip.p[:, strip.facets].mean(axis=1).T @ step / pitch**2 - 0.5) < JOIN)
    )


def _conjugate(opposite: Index) -> csc_matrix:
    """Return U of `Periodic`, from the class at −r of each class."""
    n = len(opposite)
    own = np.arange(n)
    rows = [own[opposite == own]]
    columns = [own[opposite == own]]
    values = [np.ones(np.sum(opposite == own), dtype=complex)]
    low = own[own < opposite]
    high = opposite[low]
    half = np.full(len(low), np.sqrt(0.5), dtype=complex)
    for row, column, value in (
        (low, low, half),
        (low, high, 1j * half),
        (high, low, half),
        (high, high, -1j * half),
    ):
        rows.append(row)
        columns.append(column)
        values.append(value)
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csc_matrix(entries, shape=(n, n))
