"""Where the film is under compression after release, before any mode is solved."""

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.domain import Domain
from femnl.core.modes import Modes
from femnl.core.processes import one_blas_thread
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.stress import relaxed_tension
from femnl.mechanics.prestress import solve_prestress

Array = NDArray[np.float64]

DEGREE = 3
NOISE = 5e-3
"""Of the film stress: less compression than this is what the elements leave at a free edge."""


@dataclass(frozen=True)
class ReleasedStress:
    """The stress after release in the triangles of the whole film.

    Means over triangles: at a sharp inner corner the stress at points is infinite, and of any sign.
    Where layers lie on the film, means over their thickness too.
    corners (n, 3, 2) [m]; least (n,) [Pa]: the smaller principal stress, area (n,) [m²]; film [Pa]:
    the stress before release.
    """

    corners: Array
    least: Array
    area: Array
    film: float

    def __post_init__(self) -> None:
        freeze(self)

    @property
    def compressed(self) -> NDArray[np.bool_]:
        """Which triangles (n,) are under compression."""
        return np.asarray(self.least < -NOISE * self.film)

    @property
    def share(self) -> float:
        """The part of the film's area under compression, 0 to 1."""
        return float(self.area[self.compressed].sum() / self.area.sum())

    @property
    def worst(self) -> tuple[float, Array]:
        """The least principal stress [Pa] and the point (2,) [m] where it is."""
        where = int(np.argmin(self.least))
        return float(self.least[where]), self.corners[where].mean(axis=0)


def released_stress(domain: Domain) -> ReleasedStress:
    """Relax the film stress, and return the smaller principal stress by triangle.

    (σ_xx + σ_yy)/2 − √((σ_xx − σ_yy)²/4 + σ_xy²) of the mean stress of each triangle. A film
    without bending has no modes where it is negative; a plate may buckle there.

    Args:
        domain: the whole film, or a half or a quarter of it between mirrors.

    Raises:
        ConvergenceError: the film is not supported.
    """
    prestress = solve_prestress(domain, DEGREE)
    order = 2 * DEGREE
    sheet = Sheet(domain)
    stresses = []
    areas = []
    space = Space(domain.mesh, DEGREE)
    for cell, tension in zip(cells(space, order), relaxed_tension(prestress, order), strict=True):
        size = sheet.total_thickness(cell.triangles, cell.jet.point)
        stress = tension / size[..., None]
        area = cell.dx.sum(axis=1)
        stresses.append(np.einsum("eqc,eq->ec", stress, cell.dx) / area[:, None])
        areas.append(area)
    xx, yy, xy = np.concatenate(stresses).T
    least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
    corners = domain.mesh.p.T[domain.mesh.t.T]
    middle = np.array(domain.middle)
    images = [middle + (corners - middle) * signs for signs in _signs(domain)]
    number = len(images)
    return ReleasedStress(
        np.concatenate(images),
        np.tile(least, number),
        np.tile(np.concatenate(areas), number),
        domain.model.film.stress,
    )


def _signs(domain: Domain) -> list[Array]:
    """Return what the mirrors make of x and y."""
    x = (1.0, -1.0) if domain.copies == 4 else (1.0,)
    y = (1.0, -1.0) if domain.copies > 1 else (1.0,)
    return [np.array([a, b]) for a in x for b in y]


def say_what_is_compressed(modes: Modes) -> None:
    """Say where a film without bending is under compression after release.

    It has no modes then: a coarse mesh does not see the folds that a finer one finds, nor do its
    error bars.
    """
    model = modes.domain.model
    ends_free = not all(segment.clamped for segment in model.outline.segments)
    if model.bending or not (model.openings or ends_free):
        return
    with one_blas_thread():
        stress = released_stress(modes.domain)
    if stress.compressed.any():
        least, (x, y) = stress.worst
        logging.getLogger("femnl").warning(
            "%s: after release the film is under compression, by %.2g of its stress at "
            "(%.4g, %.4g) um; without bending it folds there, finer meshes find ever more modes, "
            "and error bars do not hold; set bending = true",
            model.name,
            -least / stress.film,
            x * 1e6,
            y * 1e6,
        )
