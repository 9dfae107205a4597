"""A square film on its ledge of oxide and on the wafer, in three dimensions.

One quarter: wafer and oxide are solids, the film is a sheet without thickness that spans the gap
and lies on the oxide around it. Before the etch nothing moves; afterwards the oxide's pressure
and the tensions of the film on the ledge, of its margin and of its array of holes find their
balance. The film's change of stress gives the change of f22 − 2 f11 to first order:

    δλ/λ = ∫ δN : ∇ξ⊗∇ξ / ∫ N |∇ξ|²   with the sines ξ of the even film.

Limits: linear; an upright face and sharp corners of the oxide; isotropic silicon.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix
from skfem import (
    Basis,
    BilinearForm,
    ElementHex0,
    ElementHexS2,
    ElementQuad0,
    ElementQuadS2,
    ElementVector,
    Functional,
    LinearForm,
    MeshHex,
    MeshQuad,
)
from skfem.helpers import ddot, sym_grad, trace

from benchmarks.ledge import OXIDE, USUAL, Materials
from femnl.mechanics.fem.solvers import factorize

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sheet:
    """In-plane stiffness (c11, c12, c66) [N/m] of the film: array of holes, margin, on the ledge.

    tension [N/m] of the same three at zero strain; margin, its width [m].
    """

    stiffness: tuple[tuple[float, float, float], ...]
    tension: tuple[float, float, float]
    margin: float


@dataclass(frozen=True)
class Grid:
    """Elements: finest at the edge [m], growth, layers of oxide, how far [m] the wafer goes."""

    finest: float = 0.8e-6
    growth: float = 1.6
    layers: int = 3
    beyond: float = 800e-6
    wafer: float = 525e-6
    glued: bool = False


@dataclass(frozen=True)
class Moved:
    """What each load does: oxide [per Pa of pressure], ledge, margin, array [per N/m].

    places (n,) along the edge from its middle [m]; inwards, along (4, n) displacement of the edge;
    stress (4, 2): ∫ δN : ∇ξ⊗∇ξ / ∫ |∇ξ|² of the modes (1,1) and (2,2) [N/m per load].
    """

    places: Array
    inwards: Array
    along: Array
    stress: Array


def solve_solid(
    sheet: Sheet,
    side: float = 270e-6,
    oxide: float = OXIDE,
    materials: Materials = USUAL,
    grid: Grid = Grid(),
    rigid: bool = False,
) -> Moved:
    """Solve one quarter, x > 0 and y > 0, whose planes of symmetry are x = 0 and y = 0.

    rigid: hold the film at its edge, for the film's own part.
    """
    half = side / 2
    inner = half - _graded(half, grid.finest, grid.growth)
    outer = half + _graded(grid.beyond, grid.finest, grid.growth)
    lines = np.unique(np.round(np.concatenate([inner, outer, [half - sheet.margin]]), 12))
    film = MeshQuad.init_tensor(lines, lines)
    if rigid:
        film = film.restrict(np.flatnonzero(film.p[:, film.t].mean(axis=1).max(axis=0) < half))
    flat = Basis(film, ElementVector(ElementQuadS2()), intorder=4)
    matrix_film, loads_film = _film(flat, sheet, half)
    if rigid:
        matrix, loads = matrix_film, np.vstack([np.zeros(flat.N), loads_film])
        x = flat.doflocs
        direction = _direction(flat, 2)
        held = (x[direction, np.arange(flat.N)] < 1e-12) | (x.max(axis=0) > half - 1e-12)
    else:
        deep = -oxide - _graded(grid.wafer, oxide / grid.layers, grid.growth)
        z = np.concatenate([np.linspace(-oxide, 0, grid.layers + 1), deep])
        solid_mesh = MeshHex.init_tensor(lines, lines, np.unique(np.round(z, 12)))
        middle = solid_mesh.p[:, solid_mesh.t].mean(axis=1)
        gap = (middle[2] > -oxide) & (middle[:2].max(axis=0) < half)
        solid_mesh = solid_mesh.restrict(np.flatnonzero(~gap))
        solid = Basis(solid_mesh, ElementVector(ElementHexS2()), intorder=4)
        matrix_solid, push = _solid(solid, oxide, materials)
        index = _share(solid, flat)
        size = solid.N + int((index >= solid.N).sum())
        place = csc_matrix((np.ones(flat.N), (index, np.arange(flat.N))), shape=(size, flat.N))
        below = csc_matrix(
            (np.ones(solid.N), (np.arange(solid.N), np.arange(solid.N))), shape=(size, solid.N)
        )
        matrix = below @ matrix_solid @ below.T + place @ matrix_film @ place.T
        loads = np.vstack([below @ push, (place @ loads_film.T).T])
        x = np.full((3, size), 0.0)
        direction = np.zeros(size, dtype=int)
        x[:2, index] = flat.doflocs
        direction[index] = _direction(flat, 2)
        x[:, : solid.N] = solid.doflocs
        direction[: solid.N] = _direction(solid, 3)
        held = (direction < 2) & (x[direction, np.arange(size)] < 1e-12)
        held |= x[:2].max(axis=0) > lines[-1] - 1e-12
        if grid.glued:
            held |= x[2] < z.min() + 1e-12
    free = np.flatnonzero(~held)
    moved = np.zeros((len(held), 4))
    moved[free] = factorize(csc_matrix(matrix[free][:, free]))(
        np.ascontiguousarray(loads[:, free].T)
    )
    on_film = moved if rigid else place.T @ moved
    edge = np.abs(flat.doflocs[0] - half) < 1e-12
    edge &= flat.doflocs[1] < half + 1e-12
    is_x = _direction(flat, 2) == 0
    order = np.argsort(flat.doflocs[1][edge & is_x])
    other = np.argsort(flat.doflocs[1][edge & ~is_x])
    return Moved(
        flat.doflocs[1][edge & is_x][order],
        -on_film[edge & is_x][order].T,
        -on_film[edge & ~is_x][other].T,
        np.array([_mode_stress(flat, sheet, half, on_film[:, i]) for i in range(4)]),
    )


def _zones(flat: Basis, sheet: Sheet, half: float) -> NDArray[np.int64]:
    far = flat.mesh.p[:, flat.mesh.t].mean(axis=1).max(axis=0)
    return np.where(far < half - sheet.margin, 0, np.where(far < half, 1, 2))


def _stress(w, u):  # type: ignore[no-untyped-def]
    strain = sym_grad(u)
    return (
        w.c11 * strain[0, 0] + w.c12 * strain[1, 1],
        w.c12 * strain[0, 0] + w.c11 * strain[1, 1],
        2 * w.c66 * strain[0, 1],
    )


def _fields(flat: Basis, sheet: Sheet, half: float) -> dict[str, Array]:
    constant = flat.with_element(ElementQuad0())
    values = np.array(sheet.stiffness)[_zones(flat, sheet, half)]
    names = ("c11", "c12", "c66")
    return {name: constant.interpolate(values[:, i]) for i, name in enumerate(names)}


def _film(flat: Basis, sheet: Sheet, half: float) -> tuple[csc_matrix, Array]:
    """Stiffness, and the load of a unit of tension on the ledge, in the margin, in the array."""

    @BilinearForm
    def stiffness(u, v, w):  # type: ignore[no-untyped-def]
        xx, yy, xy = _stress(w, u)
        strain = sym_grad(v)
        return xx * strain[0, 0] + yy * strain[1, 1] + 2 * xy * strain[0, 1]

    tension = LinearForm(lambda v, w: -w.within * trace(sym_grad(v)))
    constant = flat.with_element(ElementQuad0())
    zones = _zones(flat, sheet, half)
    loads = [
        tension.assemble(flat, within=constant.interpolate((zones == zone).astype(float)))
        for zone in (2, 1, 0)
    ]
    return stiffness.assemble(flat, **_fields(flat, sheet, half)), np.array(loads)


def _solid(solid: Basis, oxide: float, materials: Materials) -> tuple[csc_matrix, Array]:
    """Stiffness of oxide and silicon, and the load of a unit of pressure in the oxide's plane."""
    constant = solid.with_element(ElementHex0())
    middle = solid.mesh.p[:, solid.mesh.t].mean(axis=1)
    material = np.where(middle[2] > -oxide, 1, 2)
    young = np.array(materials.young)[material]
    poisson = np.array(materials.poisson)[material]
    lame = constant.interpolate(young * poisson / (1 + poisson) / (1 - 2 * poisson))
    shear = constant.interpolate(young / 2 / (1 + poisson))

    @BilinearForm
    def stiffness(u, v, w):  # type: ignore[no-untyped-def]
        volume = w.lame * trace(sym_grad(u)) * trace(sym_grad(v))
        return volume + 2 * w.shear * ddot(sym_grad(u), sym_grad(v))

    within = constant.interpolate((material == 1).astype(float))
    push = LinearForm(lambda v, w: w.oxide * (sym_grad(v)[0, 0] + sym_grad(v)[1, 1]))
    return stiffness.assemble(solid, lame=lame, shear=shear), push.assemble(solid, oxide=within)


def _share(solid: Basis, flat: Basis) -> NDArray[np.int64]:
    """Number of each degree of freedom of the film: the solid's own on the oxide, new elsewhere."""
    way = _direction(solid, 3)
    top = np.flatnonzero((np.abs(solid.doflocs[2]) < 1e-12) & (way < 2))

    def keys(places: Array, ways: NDArray[np.int64]) -> list[tuple[int, int, int]]:
        whole = np.round(places[:2] * 1e11).astype(np.int64)
        return list(zip(whole[0].tolist(), whole[1].tolist(), ways.tolist(), strict=True))

    known = dict(zip(keys(solid.doflocs[:, top], way[top]), top.tolist(), strict=True))
    index = np.empty(flat.N, dtype=np.int64)
    following = solid.N
    for number, key in enumerate(keys(flat.doflocs, _direction(flat, 2))):
        if key in known:
            index[number] = known[key]
        else:
            index[number] = following
            following += 1
    return index


def _direction(basis: Basis, count: int) -> NDArray[np.int64]:
    """Axis of each degree of freedom."""
    found = np.zeros(basis.N, dtype=np.int64)
    for axis, indices in enumerate(basis.split_indices()[:count]):
        found[indices] = axis
    return found


def _mode_stress(flat: Basis, sheet: Sheet, half: float, moved: Array) -> Array:
    """∫ δN : ∇ξ⊗∇ξ / ∫ |∇ξ|² [N/m] of (1,1) and (2,2)."""
    found = []
    for number in (1, 2):
        k = np.pi * number / 2 / half

        def integrand(w, k=k):  # type: ignore[no-untyped-def]
            inside = (w.x[0] < half) & (w.x[1] < half)
            x, y = k * (w.x[0] + half), k * (w.x[1] + half)
            gx = k * np.cos(x) * np.sin(y)
            gy = k * np.sin(x) * np.cos(y)
            xx, yy, xy = _stress(w, w.u)
            return inside * (xx * gx**2 + 2 * xy * gx * gy + yy * gy**2)

        whole = Functional(integrand).assemble(
            flat, u=flat.interpolate(moved), **_fields(flat, sheet, half)
        )
        found.append(float(whole) / (2 * k**2 * half**2 / 4))
    return np.array(found)


def _graded(length: float, step: float, growth: float) -> Array:
    """Places from 0 to a length, `step` apart at 0 and ever further."""
    places = np.concatenate([[0.0], np.cumsum(step * growth ** np.arange(100))])
    places = places[: np.searchsorted(places, length) + 1]
    return np.asarray(places * length / places[-1])
