"""Spectra of a square film with a lattice of holes.

Quadratic quadrilaterals around each hole, in the plane and out of it.

The film relaxes in its plane under each component of the stress that it had before; its modes,
slopes and bending follow from that.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh, splu
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad2,
    ElementVector,
    FacetBasis,
    LinearForm,
    MeshQuad,
    MeshQuad2,
    asm,
)
from skfem.helpers import ddot, sym_grad, trace
from skfem.models.poisson import mass

from femnl.io.results.atomic import write_whole
from tests.blind.lab import spectrum
from tests.blind.lab.bench import Array, Cause
from tests.blind.lab.film import Membrane
from tests.blind.lab.inplane import GRADED
from tests.blind.lab.spectrum import SpectrumBench

SIDE = 250e-6
PITCH = 40e-6
COUNT = 6
RADIUS = 5e-6
POISSON = 0.23
"""Those of `perforated.toml`."""
KEPT = Path(__file__).parents[3] / "build"
"""Where what the film's equations give is kept; without it, or where this file has changed, it is
computed again.
"""
AROUND = 64
OUTWARDS = 16
MODES = 60
Load = float | Callable[[Array, Array], Array]
LOADS: tuple[tuple[Load, Load, Load], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Stress before the release: xx, yy, xy."""
EVEN = ((1.0, 1.0, 0.0), *LOADS[:2])
"""Those that make up equal stresses."""


def solved() -> dict[str, Array]:
    """Integrals over the film and its modes, lengths in units of its side, of ∫φᵢφⱼ = δᵢⱼ × area.

    loads (3, n, n): ∫ T:∇φᵢ∇φⱼ / area for the relaxed film of each load, graded (3, n, n): that of
    equal stresses x, y and x² + y²; edge (n,): ∮ √T_nn (∂φ/∂n)² / area of equal stresses;
    bending (n,): ∫ (1 − ν) |∇∇φ|² + ν (Δφ)² / area; area; shapes (n_nodes, n) at nodes (2,
    n_nodes).
    """
    return kept("film", solve)


def kept(name: str, solve: Callable[[], dict[str, Array]]) -> dict[str, Array]:
    """Return what is kept under a name, or solve it."""
    path = KEPT / f"blind-perforated-{name}-{zlib.crc32(Path(__file__).read_bytes()):08x}.npz"
    if not path.is_file():
        found = solve()
        path.parent.mkdir(exist_ok=True)
        write_whole(path, lambda path: np.savez(path, allow_pickle=False, **found))
    with np.load(path) as file:
        return dict(file)


def rings(outwards: int) -> Array:
    """Return where nodes lie between hole and side of the cell, as shares, (outwards + 1,)."""
    return np.asarray(np.linspace(0, 1, outwards + 1) ** 1.3)


def cell(column: int, row: int, around: int, outwards: int, side: float) -> Array:
    """Corners of the quadrilaterals of one cell, (2, outwards + 1, around), in units of the side.

    The outer cells take in the margin.
    """
    radius = RADIUS / side
    pitch = PITCH / side
    t = np.linspace(-1, 1, around // 4 + 1)[:-1]
    one = np.ones_like(t)
    square = np.concatenate([[one, t], [-t, one], [-one, -t], [t, -one]], axis=1)
    s = rings(outwards)[:, None]
    margin = (1 - COUNT * pitch) / pitch
    ends = [(1 + margin * (n == 0), 1 + margin * (n == COUNT - 1)) for n in (column, row)]
    outer = np.stack(
        [
            np.where(part < 0, part * low, part * high)
            for part, (low, high) in zip(square, ends, strict=True)
        ]
    )
    turn = np.arctan2(outer[1], outer[0])
    place = (np.array([column, row]) - (COUNT - 1) / 2) * pitch
    found = [
        (1 - s) * radius * f(turn) + s * pitch / 2 * part
        for f, part in zip((np.cos, np.sin), outer, strict=True)
    ]
    return np.stack(found) + place[:, None, None]


def mesh(around: int, outwards: int, side: float = SIDE) -> MeshQuad2:
    """Return quadrilaterals between each hole and its cell; those at the hole follow its arc."""
    radius = RADIUS / side
    pitch = PITCH / side
    cells = [
        cell(column, row, around, outwards, side).reshape(2, -1)
        for column in range(COUNT)
        for row in range(COUNT)
    ]
    i, k = np.meshgrid(np.arange(around), np.arange(outwards))
    corners = [(k + a) * around + (i + b) % around for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    first = np.stack([corner.ravel() for corner in corners])
    centres = (np.arange(COUNT) - (COUNT - 1) / 2) * pitch
    points = np.concatenate(cells, axis=1)
    quads = np.concatenate([first + n * cells[0].shape[1] for n in range(len(cells))], axis=1)
    _, kept, where = np.unique(np.round(points, 9), axis=1, return_index=True, return_inverse=True)
    plain = MeshQuad2.from_mesh(
        MeshQuad(np.ascontiguousarray(points[:, kept]), np.ascontiguousarray(where.ravel()[quads]))
    )
    nodes = plain.doflocs.copy()
    rest = nodes - centres[np.abs(nodes[:, :, None] - centres).argmin(axis=2)]
    distance = np.hypot(*rest)
    arc = distance < radius * (1 + 1e-9)
    nodes[:, arc] += rest[:, arc] * (radius / distance[arc] - 1)
    return MeshQuad2(np.ascontiguousarray(nodes), plain.t)


@dataclass(frozen=True)
class Relaxed:
    """A film on its mesh with its tension.

    The tension (2, 2, n_cells, n_points) that each load leaves, and that at the edge under all
    loads.
    """

    flat: Basis
    rim: FacetBasis
    outer: NDArray[np.int64]
    tensions: list[Array]
    at_rim: Array

    def modes(self, stiffness: Any, count: int) -> tuple[Array, Array]:
        """k² of the lowest modes and their values (N, count) at the nodes."""
        flat = self.flat
        inner = flat.complement_dofs(flat.get_dofs(self.outer))
        heavy = asm(mass, flat)
        square, vectors = eigsh(
            stiffness[inner][:, inner].tocsc(), count, heavy[inner][:, inner].tocsc(), sigma=0.0
        )
        shapes = np.zeros((flat.N, count))
        shapes[inner] = vectors * np.sqrt(float(flat.dx.sum()))
        return square, shapes


def relaxed(cells: MeshQuad2, loads: Sequence[tuple[Load, Load, Load]]) -> Relaxed:
    """Let the film go in its plane under each stress that it may have had before."""
    outer = cells.facets_satisfying(
        lambda x: np.isclose(np.abs(x).max(axis=0), 0.5, atol=1e-9), boundaries_only=True
    )
    flat = Basis(cells, ElementQuad2(), intorder=6)
    plane = Basis(cells, ElementVector(ElementQuad2()), intorder=6)
    rim, rims = (
        FacetBasis(cells, element, facets=outer, intorder=6)
        for element in (ElementQuad2(), ElementVector(ElementQuad2()))
    )
    free = plane.complement_dofs(plane.get_dofs(outer))
    stretch = splu(asm(_elastic, plane)[free][:, free].tocsc())
    tensions = []
    at_rim = np.zeros((2, 2, *rim.dx.shape))
    for load in loads:
        before, beyond = (_before(load, *_points(space)) for space in (flat, rim))
        moved = np.zeros(plane.N)
        moved[free] = -stretch.solve(asm(_released, plane, before=before)[free])
        tensions.append(before + _stress(sym_grad(_field(plane, moved))))
        if load in EVEN:
            at_rim = at_rim + beyond + _stress(sym_grad(_field(rims, moved)))
    return Relaxed(flat, rim, outer, tensions, at_rim)


def _before(load: tuple[Load, Load, Load], x: Array, y: Array) -> Array:
    """The stress before the release at points, (2, 2, …)."""
    xx, yy, xy = (part(x, y) if callable(part) else part + 0 * x for part in load)
    return np.array([[xx, xy], [xy, yy]])


def shapes(side: float, count: int) -> dict[str, Array]:
    """Return k² and nodal values of the lowest modes under equal stresses, as in `solved`.

    side [m]: of the film.
    """
    film = relaxed(mesh(AROUND, OUTWARDS, side), [(1.0, 1.0, 0.0)])
    square, values = film.modes(asm(_pull, film.flat, tension=film.tensions[0]), count)
    return {
        "square": square,
        "area": np.array(float(film.flat.dx.sum())),
        "nodes": film.flat.doflocs,
        "shapes": values,
    }


def solve(around: int = AROUND, outwards: int = OUTWARDS) -> dict[str, Array]:
    """Solve the film; see `solved`."""
    film = relaxed(mesh(around, outwards), (*LOADS, *((load, load, 0.0) for load in GRADED)))
    flat = film.flat
    rim = film.rim
    stiff = [asm(_pull, flat, tension=tension) for tension in film.tensions]
    heavy = asm(mass, flat)
    area = float(flat.dx.sum())
    even = stiff[0] + stiff[1]
    square, shapes = film.modes(even, MODES)
    smooth = splu(heavy.tocsc())
    slopes = [
        smooth.solve(asm(_slope, flat, along=np.full(flat.dx.shape, axis)) @ shapes)
        for axis in (0, 1)
    ]
    edge = np.empty(MODES)
    bending = np.empty(MODES)
    ring = flat.get_dofs(film.outer).all()
    ends = splu(asm(mass, rim)[ring][:, ring].tocsc())
    normal = np.einsum("ij...,i...,j...", film.at_rim, rim.normals, rim.normals)
    for k, shape in enumerate(shapes.T):
        # What the edge pulls follows from the film's balance much better than from the slope there.
        pull = np.zeros(flat.N)
        pull[ring] = ends.solve(((even - square[k] * heavy) @ shape)[ring])
        edge[k] = np.sum(rim.dx * _field(rim, pull) ** 2 / normal**1.5) / area
        a, b = (_field(flat, slope[:, k]).grad for slope in slopes)
        mixed = (a[1] + b[0]) / 2
        bending[k] = (
            np.sum(
                flat.dx
                * (
                    (1 - POISSON) * (a[0] ** 2 + b[1] ** 2 + 2 * mixed**2)
                    + POISSON * (a[0] + b[1]) ** 2
                )
            )
            / area
        )
    loads = np.array([shapes.T @ (matrix @ shapes) for matrix in stiff]) / area
    known = {
        "loads": loads[:3],
        "graded": loads[3:],
        "edge": edge,
        "bending": bending,
        "area": np.array(area),
    }
    return known | {"nodes": flat.doflocs, "shapes": shapes}


def _field(space: Basis | FacetBasis, values: Array) -> Any:
    """A function of the space at its points of quadrature."""
    return space.interpolate(values)


def _points(space: Basis | FacetBasis) -> Any:
    """Places of the points of quadrature."""
    return space.global_coordinates()


def _stress(strain: Any) -> Any:
    """Plane stress of Young's modulus 1.

    How stiff the film is does not count where its edge is held.
    """
    identity = np.eye(2)[:, :, None, None]
    return ((1 - POISSON) * strain + POISSON * trace(strain) * identity) / (1 - POISSON**2)


@BilinearForm
def _elastic(u: Any, v: Any, w: Any) -> Any:
    """∫ σ(u) : ε(v)."""
    return ddot(_stress(sym_grad(u)), sym_grad(v))


@LinearForm
def _released(v: Any, w: Any) -> Any:
    """∫ σ₀ : ε(v)."""
    return ddot(w["before"], sym_grad(v))


@BilinearForm
def _pull(u: Any, v: Any, w: Any) -> Any:
    """∫ T : ∇u ∇v."""
    return np.einsum("ij...,i...,j...", w["tension"], u.grad, v.grad)


@BilinearForm
def _slope(u: Any, v: Any, w: Any) -> Any:
    """∫ ∂ₐu v, a = x or y."""
    return np.where(w["along"] == 0, u.grad[0], u.grad[1]) * v


@dataclass(frozen=True)
class Perforated(Membrane):
    """The film with its holes; a point is taken for the nearest node."""

    edge: Array
    bending: Array
    nodes: Array
    shapes: Array

    def clamped(self, layer: float, depth: float = 0.0) -> Array:
        """Return k² of each mode with the clamp's boundary layer.

        The layer makes the film smaller by ℓ; ℓ²k⁴ is taken off and the film's own bending
        put in.

        To first order what the edge's pull does over ℓ; to second as on a film without holes, (1 −
        x)⁻² of 1 + 2x.
        """
        part = layer * self.edge / self.square
        grown = self.square * (1 + part + 0.75 * part**2)
        return np.asarray(grown + layer**2 * (self.bending - grown**2))

    def at(self, x: Array, y: Array, count: int | None = None) -> Array:
        """Values of the lowest modes at the nodes nearest to points (n,)."""
        nearest = [
            int(np.argmin(np.hypot(self.nodes[0] - a, self.nodes[1] - b)))
            for a, b in zip(x, y, strict=True)
        ]
        return np.asarray(self.shapes[nearest, :count].T)


@cache
def perforated() -> Perforated:
    """The film, in m."""
    known = solved()
    xx, yy, xy = known["loads"] / SIDE**2
    graded = known["graded"] / np.array([SIDE, SIDE, 1.0])[:, None, None]
    return Perforated(
        slopes=(xx, yy, xy / 2),
        graded=lambda: graded,
        area=float(known["area"]) * SIDE**2,
        half=SIDE / 2,
        orders=np.empty((0, 2), np.int64),
        inner=(SIDE, SIDE),
        space=None,
        edge=known["edge"] / SIDE**3,
        bending=known["bending"] / SIDE**4,
        nodes=known["nodes"] * SIDE,
        shapes=known["shapes"],
    )


class HolesBench(SpectrumBench):
    """A list of the lowest modes of the film with its holes; see `Bench`."""

    less = 3.0

    def membrane(self, layer: float = 0.0, stretch: float = 0.0) -> Membrane:
        """The one film there is."""
        return perforated()


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> HolesBench:
    """Prepare a measurement."""
    return HolesBench(name, causes, rng)


RIGID = ("aspect_ratio", "compliant_clamp", "gas_loading", "trapped_gas", "yielding_edge")
"""What would need other meshes, or gas that flows through the holes."""
CAUSES: dict[str, Callable[[np.random.Generator, Any], Cause]] = {
    **{n: draw for n, draw in spectrum.CAUSES.items() if n not in RIGID},
    "hole_dispersion": spectrum.simple("beta_area", 1e-14, 3e-13, signed=True),
}
DERIVED: dict[str, str] = {"hole_dispersion": "waves on a string with masses, at all orders"}
"""How the laboratory computes a cause, other than the library does."""
