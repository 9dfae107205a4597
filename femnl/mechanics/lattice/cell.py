"""One cell of a square lattice of holes.

The constants of the even film that waves much longer than the pitch see.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.device import Model
from femnl.core.domain import Domain
from femnl.core.errors import ParameterError
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import (
    Assembly,
    cells,
    in_plane_strain,
    local_matrices,
    local_vectors,
    plane_stress,
    quadrature_order,
    thickness,
    vector_dofs,
)
from femnl.mechanics.fem.solvers import factorize, lowest_eigenpairs
from femnl.mechanics.fem.stress import relaxed_stress
from femnl.mechanics.fem.supports import in_plane_supports
from femnl.mechanics.modes.operators import Operators
from femnl.mechanics.prestress import solve_prestress

Array = NDArray[np.float64]

DEGREE = 4
RESOLUTION = 1.5
LONG = 4  # cells per wavelength from which the dispersion is read
BOTH = (1, 1)


@dataclass(frozen=True)
class Cell:
    """What a film with a square lattice of holes amounts to for long waves.

    Means are over whole cells, holes counted as empty.

    pitch [m]; mass [kg/m²]; tension [N/m] at zero mean strain; c11, c12, c66 [N/m]: in-plane
    stiffness of mean strain; d_axis, d_mixed [N m]: of ρω² = Tk² + d_axis (k_x⁴ + k_y⁴) + 2 d_mixed
    k_x² k_y², bending and dispersion together.
    """

    pitch: float
    mass: float
    tension: float
    c11: float
    c12: float
    c66: float
    d_axis: float
    d_mixed: float

    @property
    def stiffness(self) -> Array:
        """In-plane stiffness of strains (xx, yy, 2xy), (3, 3) [N/m]."""
        return np.array([[self.c11, self.c12, 0], [self.c12, self.c11, 0], [0, 0, self.c66]])


def solve_cell(model: Model, pitch: float) -> Cell:
    """Solve the cell problems of a square lattice of the device's holes in its film.

    The sides of a cell are mirror lines. T = ⟨σ⟩h is exact for the tension of long waves, as div σ
    = 0 and holes without traction leave a linear w without corrector; the k⁴ terms come from
    standing waves of `LONG` cells, along x and in both.

    Args: model: film, taper and the holes' radius are used. pitch: of the lattice [m].
    Raises: ParameterError where holes of that pitch overlap or there are none.
    Valid: waves much longer than the pitch. Source: validation case `unit_cell`; Bensoussan, Lions
    & Papanicolaou, Asymptotic Analysis for Periodic Structures (1978), chapter 1 and, for standing
    waves, chapter 4.
    """
    if len(model.holes.centres) == 0 or not 2 * model.holes.radius < pitch:
        raise ParameterError(
            f"pitch = {pitch:g} m: expected more than the diameter {2 * model.holes.radius:g} m "
            "of holes that are there"
        )
    domain = _cells(model, pitch, 1, 1)
    prestress = solve_prestress(domain, DEGREE)
    space = Space(domain.mesh, DEGREE)
    order = quadrature_order(model, 2 * DEGREE)
    area = (pitch / 2) ** 2
    mass = 0.0
    tension = 0.0
    for cell, stress in zip(cells(space, order), relaxed_stress(prestress, order), strict=True):
        h = thickness(domain.model, cell.jet.point)
        mass += float(np.sum(model.film.density * h * cell.dx)) / area
        tension += float(np.sum(stress[..., :2].mean(axis=-1) * h * cell.dx)) / area
    wide, narrow, shear = (
        _stretched(domain, space, np.array(s)) / area
        for s in ([1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0])
    )
    k = 2 * np.pi / (LONG * pitch)
    axis = (mass * _standing(model, pitch, 1, k) - tension * k**2) / k**4
    diagonal = (mass * _standing(model, pitch, LONG, k) - 2 * tension * k**2) / k**4
    return Cell(
        pitch,
        mass,
        tension,
        (wide + narrow) / 4,
        (wide - narrow) / 4,
        shear,
        axis,
        diagonal / 2 - axis,
    )


def _cells(model: Model, pitch: float, n_x: int, n_y: int) -> Domain:
    """Return a quarter of n_x × n_y cells, all of whose straight sides are mirrors."""
    x = n_x * pitch / 2
    y = n_y * pitch / 2
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    sides = tuple(Segment(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True))
    rows = [pitch * (np.arange(n) - (n - 1) / 2) for n in (n_x, n_y)]
    holes = Holes(np.stack(np.meshgrid(*rows), -1).reshape(-1, 2), model.holes.radius)
    device = replace(model, outline=Outline("rectangle", sides, None, 2 * x), holes=holes)
    device = replace(device, openings=())
    domain = mesh(replace(device, bending=False), "quarter", RESOLUTION)
    bounds = dict(domain.mesh.boundaries or {})
    outer = np.asarray(bounds.pop("clamped"))
    level = np.ptp(domain.mesh.p[1][domain.mesh.facets[:, outer]], axis=0) < 1e-6 * pitch
    bounds |= {
        "mirror-0": np.union1d(bounds["mirror-0"], outer[level]),
        "mirror-1": np.union1d(bounds["mirror-1"], outer[~level]),
    }
    bounded = replace(domain.mesh, _boundaries=bounds)
    return Domain(device, bounded, domain.wedge)


def _stretched(domain: Domain, space: Space, strain: Array) -> float:
    """Return ∫ h C (ε + ε(u)) : (ε + ε(u)) over the quarter cell, u periodic.

    The mean strain is ε (xx, yy, 2xy).
    """
    film = domain.model.film
    moduli = plane_stress(film.young, film.poisson)
    energy = 0.0
    load = np.zeros(2 * space.size)
    matrix = Assembly(2 * space.size)
    for cell in cells(space, quadrature_order(domain.model, 2 * space.degree)):
        basis = in_plane_strain(cell.jet)
        dofs = vector_dofs(space, cell.triangles)
        weight = thickness(domain.model, cell.jet.point) * cell.dx
        energy += float(np.sum(weight) * strain @ moduli @ strain)
        np.add.at(
            load,
            dofs,
            local_vectors(basis, np.broadcast_to(moduli @ strain, (*weight.shape, 3)), weight),
        )
        matrix.add(local_matrices(basis, moduli, weight), dofs)
    supports = in_plane_supports(space, domain.wedge, "clamped", (strain[2] == 0,) * 2)
    right = supports.T @ load
    return energy - float(
        right @ factorize(csc_matrix(supports.T @ matrix.matrix() @ supports))(right)
    )


def _standing(model: Model, pitch: float, rows: int, k: float) -> float:
    """Return ω² of the lowest standing wave that is even about the middle of `LONG` × `rows` cells.

    Cos kx, or cos kx cos ky.

    The uniform motion has no stiffness at all: a spring of k² times the film's mass lifts every ω²
    by as much.
    """
    domain = _cells(model, pitch, LONG, rows)
    operators = Operators(solve_prestress(domain, DEGREE), DEGREE)
    lift = k**2 * model.film.stress / model.film.density
    stiffness = csc_matrix(operators.stiffness(BOTH) + lift * operators.mass)
    values, shapes = lowest_eigenpairs(stiffness, operators.mass, 6)
    x, y = operators.space.location.T
    wave = np.cos(k * x) * (np.cos(k * y) if rows > 1 else 1.0)
    share = (shapes.T @ (operators.mass @ wave)) ** 2 / (wave @ (operators.mass @ wave))
    return float(values[np.argmax(share)] - lift)
