"""A square film on its ledge of oxide and on the wafer, in three dimensions.

One quarter. Wafer and oxide are solids; the film is a sheet that spans the gap and lies on the
oxide around it. Before the etch nothing moves. Afterwards the oxide's pressure and the tensions of
the film on the ledge, of its margin and of its array of holes find their balance.

Limits: linear; isotropic silicon; a film without thickness; rounded corners of the oxide as square
ones of the same area. Against the cross-section, whose film is 240 nm thick, the push agrees within
3 % and the pull within 9 % (`tests/physics/test_ledge.py`). Elements of half the size change
f22 − 2 f11 of J10 by 1 Hz, and a wafer held twice as far by 2 Hz.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from skfem import (
    Basis,
    BilinearForm,
    ElementHex0,
    ElementHexS2,
    ElementVector,
    LinearForm,
    MeshHex,
)
from skfem.assembly.form.form import FormExtraParams
from skfem.element import DiscreteField
from skfem.helpers import ddot, sym_grad, trace

from benchmarks.ledge_film import Sheet, directions, film_basis, film_system, mode_stress
from benchmarks.ledge_section import FOOT, OXIDE, USUAL, Materials, graded
from femnl.mechanics.fem.solvers import factorize

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wafer:
    """Oxide and silicon: thicknesses [m], and how far from the edge the chip is held [m].

    foot [m]: how far the oxide reaches into the gap at the silicon; glued: the back does not move.
    """

    oxide: float = OXIDE
    silicon: float = 525e-6
    beyond: float = 800e-6
    foot: float = FOOT
    glued: bool = False
    materials: Materials = USUAL


@dataclass(frozen=True)
class Grid:
    """Elements: finest at the edge [m], how much each gains on the last, layers of the oxide."""

    finest: float = 3e-6
    growth: float = 2.2
    layers: int = 2


USUAL_WAFER = Wafer()
USUAL_GRID = Grid()


@dataclass(frozen=True)
class Moved:
    """What each load does: oxide [per Pa of pressure], ledge, margin, array [per N/m].

    places (n,) along the edge from its middle [m]; inwards, along (4, n): how the edge moves, along
    towards its middle; stress (4, 2): `mode_stress` of each.
    """

    places: Array
    inwards: Array
    along: Array
    stress: Array


def solve_solid(sheet: Sheet, wafer: Wafer = USUAL_WAFER, grid: Grid = USUAL_GRID) -> Moved:
    """Solve the quarter x > 0, y > 0; the planes x = 0 and y = 0 are planes of symmetry."""
    lines = sheet.lines(grid.finest, grid.growth, wafer.beyond)
    flat = film_basis(lines)
    solid = Basis(_mesh(sheet, wafer, grid, lines), ElementVector(ElementHexS2()), intorder=4)
    index = _share(solid, flat)
    size = int(index.max()) + 1
    size = max(size, solid.N)
    from_film = csc_matrix((np.ones(flat.N), (index, np.arange(flat.N))), shape=(size, flat.N))
    own = np.arange(solid.N)
    from_solid = csc_matrix((np.ones(solid.N), (own, own)), shape=(size, solid.N))
    sheet_matrix, tensions = film_system(flat, sheet)
    solid_matrix, push = _system(solid, wafer)
    matrix = from_solid @ solid_matrix @ from_solid.T + from_film @ sheet_matrix @ from_film.T
    loads = np.column_stack([from_solid @ push, from_film @ tensions.T])
    place = np.zeros((3, size))
    way = np.zeros(size, dtype=np.int64)
    place[:2, index] = flat.doflocs
    way[index] = directions(flat)
    place[:, own] = solid.doflocs
    way[own] = directions(solid)
    held = (way < 2) & (place[way, np.arange(size)] < 1e-12)
    held |= place[:2].max(axis=0) > lines[-1] * (1 - 1e-9)
    if wafer.glued:
        held |= place[2] < place[2].min() + 1e-12
    free = np.flatnonzero(~held)
    moved = np.zeros((size, 4))
    right = np.ascontiguousarray(loads[free])
    moved[free] = factorize(csc_matrix(matrix[free][:, free]))(right)
    on_film = from_film.T @ moved
    places, inwards, along = _edge(flat, sheet, on_film)
    stress = np.array([mode_stress(flat, sheet, one) for one in on_film.T])
    return Moved(places, inwards, along, stress)


def _mesh(sheet: Sheet, wafer: Wafer, grid: Grid, lines: Array) -> MeshHex:
    """Oxide around the gap, and silicon below; the oxide's face leans over its foot."""
    step = wafer.oxide / grid.layers
    deep = -wafer.oxide - graded(wafer.silicon, step, grid.growth)
    heights = np.concatenate([np.linspace(-wafer.oxide, 0, grid.layers + 1), deep])
    mesh = MeshHex.init_tensor(lines, lines, np.unique(np.round(heights, 12)))
    x, y, z = mesh.p[:, mesh.t].mean(axis=1)
    mesh = mesh.restrict(np.flatnonzero((z < -wafer.oxide) | sheet.on_ledge(x, y)))
    depth = np.clip(-mesh.p[2] / wafer.oxide, 0, 1)
    # what lies below and beside the foot goes along, as far as the oxide is thick
    lean = wafer.foot * depth * np.exp(np.minimum(mesh.p[2] + wafer.oxide, 0) / wafer.oxide)
    away = np.abs(mesh.p[:2] - sheet.half)
    near = np.maximum(0.0, 1 - away / (sheet.half / 4))
    moved = mesh.p.copy()
    moved[:2] -= lean * near**8
    return MeshHex(moved, mesh.t)


def _system(solid: Basis, wafer: Wafer) -> tuple[csc_matrix, Array]:
    """Stiffness, and the load of a unit of pressure of the oxide in its plane."""
    constant = solid.with_element(ElementHex0())
    middle = solid.mesh.p[:, solid.mesh.t].mean(axis=1)
    material = np.where(middle[2] > -wafer.oxide, 1, 2)
    young = np.array(wafer.materials.young)[material]
    poisson = np.array(wafer.materials.poisson)[material]
    lame = constant.interpolate(young * poisson / (1 + poisson) / (1 - 2 * poisson))
    shear = constant.interpolate(young / 2 / (1 + poisson))

    @BilinearForm
    def stiffness(u: DiscreteField, v: DiscreteField, w: FormExtraParams) -> Array:
        volume = w.lame * trace(sym_grad(u)) * trace(sym_grad(v))
        return np.asarray(volume + 2 * w.shear * ddot(sym_grad(u), sym_grad(v)))

    within = constant.interpolate((material == 1).astype(float))
    push = LinearForm(lambda v, w: w.oxide * (sym_grad(v)[0, 0] + sym_grad(v)[1, 1]))
    return stiffness.assemble(solid, lame=lame, shear=shear), push.assemble(solid, oxide=within)


def _share(solid: Basis, flat: Basis) -> NDArray[np.int64]:
    """Number of each degree of freedom of the film: the solid's own on the oxide, new elsewhere."""
    way = directions(solid)
    top = np.flatnonzero((np.abs(solid.doflocs[2]) < 1e-12) & (way < 2))
    own = _keys(solid.doflocs[:, top], way[top])
    known = dict(zip(own, top.tolist(), strict=True))
    index = np.empty(flat.N, dtype=np.int64)
    following = solid.N
    for number, key in enumerate(_keys(flat.doflocs, directions(flat))):
        if key in known:
            index[number] = known[key]
        else:
            index[number] = following
            following += 1
    return index


def _keys(places: Array, way: NDArray[np.int64]) -> list[tuple[int, int, int]]:
    """Places in units of 0.01 nm and axes, to compare them."""
    whole = np.round(places[:2] * 1e11).astype(np.int64)
    return list(zip(whole[0].tolist(), whole[1].tolist(), way.tolist(), strict=True))


def _edge(flat: Basis, sheet: Sheet, moved: Array) -> tuple[Array, Array, Array]:
    """Places along the right-hand side, and how each load moves it there."""
    x, y = flat.doflocs
    way = directions(flat)
    edge = (np.abs(x - sheet.half) < 1e-12) & (y < sheet.half + 1e-12)
    found = []
    for axis in (0, 1):
        own = np.flatnonzero(edge & (way == axis))
        own = own[np.argsort(y[own])]
        found.append(-moved[own].T)
    return y[own], found[0], found[1]
