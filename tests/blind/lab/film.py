"""Modes of clamped films without femnl.

Sines on rectangles, finite elements of third order on a polygon; bending by its boundary layer.

A clamped plate under tension is, up to third order in ℓ/L, a membrane that is smaller by ℓ on every
side, with ω² raised by ℓ²k².
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.tri import Triangulation, TriFinder
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh, splu
from skfem import (
    Basis,
    BilinearForm,
    ElementTriP2,
    ElementTriP3,
    ElementVector,
    LinearForm,
    MeshTri,
    asm,
)
from skfem.helpers import ddot, sym_grad, trace
from skfem.models.poisson import laplace, mass

from femnl.core.device import Model
from femnl.device import geometry
from tests.blind.lab import inplane
from tests.blind.lab.bench import Array


def _unknown(*_: float) -> Any:
    raise ValueError("the laboratory cannot make this of this film")


@dataclass(frozen=True)
class Membrane:
    """Lowest modes of an ideal membrane, ∫ξᵢξⱼ = δᵢⱼ × area.

    slopes: ∫ ∂ξᵢ∂ξⱼ / area along x, along y and mixed. graded(): ∫ S : ∇ξᵢ∇ξⱼ / area, (3, n, n), S
    what is left in equilibrium of the stresses x, y, x² + y². yielded(λ): k² of the modes on an
    edge that yields, their overlaps with these, (n, modes), and what the layer of a plate adds to
    k² between these, per ℓ.

    orders: (m, n) of each sine, empty for a polygon. half: the size that x and y count in.
    """

    slopes: tuple[Array, Array, Array]
    area: float
    half: float
    orders: NDArray[np.int64]
    inner: tuple[float, float]
    space: tuple[Basis, Array, TriFinder] | None
    graded: Callable[[], Array] = field(default=_unknown, kw_only=True)
    yielded: Callable[[float], tuple[Array, Array, Array]] = field(default=_unknown, kw_only=True)

    @property
    def square(self) -> Array:
        """k² of each mode."""
        return np.asarray(np.diag(self.slopes[0] + self.slopes[1]))

    def clamped(self, layer: float, depth: float = 0.0) -> Array:
        """Return k² of each mode with the boundary layer of a plate.

        The layer decays as e^{−qd}, q² = 1/ℓ² + k² + 2k_t² (t along the edge).

        Where springs of T/δ per length hold the edge, which still does not turn, its shear force
        −Dw‴ is theirs: a wave a sin(kd + φ) + (ak/q) cos φ e^{−qd} then has tan φ = k (δℓ²(k² + q²)
        − 1/q), with d counted from the edge. Exact but for the corners of a rectangle; on a polygon
        to the third order in ℓ, with k_t² = k²/2 on the average.
        """
        if self.space is not None:
            apothem = self.half * np.sqrt(3) / 2
            return np.asarray(self.square * (1 - 2 / apothem * layer**3 * 11 / 12 * self.square))
        k = np.pi * self.orders / np.array(self.inner)
        for _ in range(20):
            along = k**2
            q = np.sqrt(layer**-2 + along + 2 * along[:, ::-1])
            given = depth * layer**2 * (along + q**2)
            k = (np.pi * self.orders - 2 * np.arctan(k * (given - 1 / q))) / (
                np.array(self.inner) + 2 * (layer - depth)
            )
        return np.asarray(np.sum(k**2, axis=1))

    def at(self, x: Array, y: Array, count: int | None = None) -> Array:
        """Values of the lowest modes at points (n,) of the film, 0 beyond it, (count, n)."""
        order = (
            np.argsort(self.square, kind="stable")[:count] if count else np.arange(len(self.square))
        )
        if self.space is None:
            sides = zip((x, y), self.inner, self.orders[order].T, strict=True)
            one, two = (
                np.sin(np.outer(m, np.pi * (p / side + 0.5))) * (np.abs(p) <= side / 2)
                for p, side, m in sides
            )
            return np.asarray(2 * one * two)
        basis, values, cell_at = self.space
        here = np.stack([x / self.inner[0], y / self.inner[1]])
        cell = np.asarray(cell_at(*here), np.int64)
        inside = cell >= 0
        cell = cell[inside]
        found = np.zeros((len(order), len(x)))
        place = basis.mapping.invF(here[:, inside, None], tind=cell)
        for k, dofs in enumerate(basis.element_dofs[:, cell]):
            shape = np.asarray(basis.elem.gbasis(basis.mapping, place, k, tind=cell)[0])[:, 0]
            found[:, inside] += shape * values[np.ix_(dofs, order)].T
        return found

    def held(self, x: Array, y: Array, count: int, layer: float) -> Array:
        """The same of a plate whose clamped edge lies `layer` outside.

        a slope g at the membrane's edge becomes g (d − ℓ + ℓ e^{−d/ℓ}).
        """
        normal, reach = self._sides()
        place = np.stack([x, y])
        away = reach[:, None] + layer - normal @ place
        nearest = np.argmin(away, axis=0)
        d = away[nearest, np.arange(len(x))]
        out = normal[nearest].T
        deep = DEEP * layer
        near = d < FADED * layer
        inner = place - out * np.where(near, deep + layer - d, 0)
        slope = self.at(inner[0], inner[1], count) / deep * near
        beyond = slope * np.where(d < layer, d - layer, 0)
        return np.asarray(
            (self.at(x, y, count) + beyond + slope * layer * np.exp(-np.maximum(d, 0) / layer))
            * (d > 0)
        )

    def _sides(self) -> tuple[Array, Array]:
        """Return outward unit normals (n, 2) of the sides and their distances from the middle."""
        if self.space is None:
            width, height = self.inner
            return np.array([[1, 0], [-1, 0], [0, 1], [0, -1.0]]), np.array(
                [width, width, height, height]
            ) / 2
        rows = _normals(self.space[0]) / np.array(self.inner)
        size = np.linalg.norm(rows, axis=1)
        return rows / size[:, None], 1 / size


DEEP = 2.0
"""Boundary layers inside the membrane's edge at which its slope is read off."""
FADED = 16.0
"""Boundary layers inside the clamped edge at which nothing is left of the layer (e⁻¹⁶ = 1e-7)."""


@cache
def device(name: str) -> Model:
    """The device of that name, of the laboratory or of femnl."""
    own = Path(__file__).with_name(f"{name}.toml")
    return geometry.load(str(own) if own.is_file() else name)


def membrane(name: str, layer: float, stretch: float = 0.0, basis: int = 14) -> Membrane:
    """Return the film of a geometry, smaller by `layer` on every side, stretched by ±stretch/2."""
    outline = device(name).outline
    if outline.size is not None:
        width, height = outline.size
        sides = width * (1 + stretch / 2) - 2 * layer, height / (1 + stretch / 2) - 2 * layer
        outer = sides[0] + 2 * layer, sides[1] + 2 * layer
        return _rectangle(sides, outer, max(outline.size) / 2, device(name).film.poisson, basis)
    corners = np.array([s.start for s in outline.segments])
    apothem = float(np.min(np.linalg.norm((corners + np.roll(corners, -1, axis=0)) / 2, axis=1)))
    found = _polygon(tuple(map(tuple, corners)), device(name).film.poisson)
    factor = 1 - layer / apothem
    x = factor * (1 + stretch / 2)
    y = factor / (1 + stretch / 2)
    scales = (1 / x**2, 1 / y**2, 1 / (x * y))
    xx, yy, xy = (one * scale for one, scale in zip(found.slopes, scales, strict=True))
    # Of the first order in the stress: what the stretch does to it is of the second
    weights = np.array([1 / factor, 1 / factor, 1.0])[:, None, None]
    return replace(
        found,
        slopes=(xx, yy, xy),
        graded=lambda: weights * found.graded(),
        area=found.area * x * y,
        inner=(x, y),
    )


def _rectangle(
    sides: tuple[float, float],
    outer: tuple[float, float],
    half: float,
    poisson: float,
    basis: int,
) -> Membrane:
    m = np.arange(1, basis + 1)
    orders = np.array([(i, j) for i in m for j in m])
    # ∫ sin' sin of two orders, and the products along x and y
    odd = (m[:, None] + m) % 2 == 1
    gap = np.where(odd, m[:, None] ** 2 - m**2, 1)
    turn = np.where(odd, 4 * m[:, None] * m / gap, 0.0)
    mixed = np.kron(turn, -turn) / (sides[0] * sides[1])
    along = (np.pi * orders / np.array(sides)) ** 2

    def yielded(compliance: float) -> tuple[Array, Array, Array]:
        square, overlap = inplane.yielded_modes(outer, sides, poisson, compliance, (basis, basis))
        layer = inplane.layer_pull(outer, sides, poisson, compliance, basis)
        return square, overlap.reshape(basis**2, -1), layer

    return Membrane(
        (np.diag(along[:, 0]), np.diag(along[:, 1]), (mixed + mixed.T) / 2),
        sides[0] * sides[1],
        half,
        orders,
        sides,
        None,
        graded=partial(inplane.pulled, outer, sides, poisson, basis),
        yielded=yielded,
    )


@cache
def _polygon(corners: tuple[tuple[float, float], ...], poisson: float, count: int = 90) -> Membrane:
    """Return cubic elements on triangles about the centre, finer at the singular corners."""
    points = np.array(corners)
    mesh = MeshTri(
        np.column_stack([np.zeros(2), points.T]),
        np.array([[0, i + 1, (i + 1) % len(points) + 1] for i in range(len(points))]).T,
    )
    mesh = mesh.refined(4)
    reach = float(np.abs(points).max())
    for level in range(7):
        centre = mesh.p[:, mesh.t].mean(axis=1)
        distance = np.min([np.hypot(centre[0] - x, centre[1] - y) for x, y in points], axis=0)
        mesh = mesh.refined(np.flatnonzero(distance < 0.25 * reach / 2**level))
    space = Basis(mesh, ElementTriP3(), intorder=7)
    inner = space.complement_dofs(space.get_dofs())
    stiff = asm(laplace, space)[inner][:, inner]
    heavy = asm(mass, space)[inner][:, inner]
    start = np.random.default_rng(0).standard_normal(len(inner))
    _, vectors = eigsh(stiff.tocsc(), count, heavy.tocsc(), sigma=0.0, v0=start)
    area = float(space.dx.sum())
    shapes = np.zeros((space.N, count))
    shapes[inner] = vectors * np.sqrt(area)

    def form(a: int, b: int) -> Array:
        found = np.asarray(shapes.T @ (asm(_slopes(a, b), space) @ shapes)) / area
        return (found + found.T) / 2

    @cache
    def graded() -> Array:
        stresses = _relaxed(space.mesh, poisson)
        return np.array([shapes.T @ (asm(_pull, space, **s) @ shapes) / area for s in stresses])

    finder = Triangulation(mesh.p[0], mesh.p[1], mesh.t.T).get_trifinder()
    return Membrane(
        (form(0, 0), form(1, 1), form(0, 1)),
        area,
        reach,
        np.empty((0, 2), np.int64),
        (1.0, 1.0),
        (space, shapes, finder),
        graded=graded,
    )


def _slopes(a: int, b: int) -> BilinearForm:
    """∫ ∂ₐu ∂_b v."""
    return BilinearForm(lambda u, v, w: u.grad[a] * v.grad[b])


def _relaxed(mesh: Any, poisson: float) -> list[dict[str, Array]]:
    """What is left of the stresses x, y, x² + y², by quadratic triangles held at the edge."""
    plane = Basis(mesh, ElementVector(ElementTriP2()), intorder=7)
    x, y = np.asarray(plane.global_coordinates())
    inner = plane.complement_dofs(plane.get_dofs())
    stretch = splu(asm(_elastic, plane, poisson=poisson)[inner][:, inner].tocsc())
    found = []
    for before in (x, y, x**2 + y**2):
        moved = np.zeros(plane.N)
        moved[inner] = -stretch.solve(asm(_released, plane, before=before)[inner])
        released: Any = plane.interpolate(moved)
        strain = sym_grad(released)
        stress = _stress(strain, poisson) + before * np.eye(2)[:, :, None, None]
        found.append({"xx": stress[0, 0], "yy": stress[1, 1], "xy": stress[0, 1]})
    return found


def _stress(strain: Any, poisson: float) -> Any:
    """Plane stress of Young's modulus 1."""
    identity = np.eye(2)[:, :, None, None]
    return ((1 - poisson) * strain + poisson * trace(strain) * identity) / (1 - poisson**2)


@BilinearForm
def _elastic(u: Any, v: Any, w: Any) -> Any:
    """∫ σ(u) : ε(v)."""
    return ddot(_stress(sym_grad(u), float(w["poisson"])), sym_grad(v))


@LinearForm
def _released(v: Any, w: Any) -> Any:
    """∫ s tr ε(v)."""
    return w["before"] * trace(sym_grad(v))


@BilinearForm
def _pull(u: Any, v: Any, w: Any) -> Any:
    """∫ S : ∇u ∇v."""
    return (
        w["xx"] * u.grad[0] * v.grad[0]
        + w["yy"] * u.grad[1] * v.grad[1]
        + w["xy"] * (u.grad[0] * v.grad[1] + u.grad[1] * v.grad[0])
    )


def _normals(basis: Basis) -> Array:
    """Rows a with a·p ≤ 1 inside a convex polygon."""
    edge = basis.mesh.p[:, basis.mesh.facets[:, basis.mesh.boundary_facets()]]
    a = edge[:, 0]
    b = edge[:, 1]
    rows = np.stack([b[1] - a[1], a[0] - b[0]]) / np.linalg.det(
        np.stack([a, b - a]).transpose(2, 0, 1)
    )
    return np.asarray(np.unique(np.round(rows.T, 3), axis=0))
