"""Values of mode shapes at points."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from femnl.core.domain import Domain
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.reference import nodes, reference_basis

Array = NDArray[np.float64]

# In reference coordinates, how far outside a triangle a point still counts as on its edge
EDGE = 1e-9
ARRIVED = 1e-12  # in reference coordinates, the step at which Newton's method ends
NEIGHBOURS = 4  # triangles with the nearest centres that are tried first
CELLS = 128  # of the raster along each side of the mesh
BESIDE = 0.05  # parts of the mesh by which the raster reaches beyond it, as bent edges may


def shape_at(modes: Modes, index: int, x: Array, y: Array) -> Array:
    """Return ξ of one mode at points (x, y) in m, which broadcast against each other.

    Exactly 0 outside the film.

    Args: index: 0 for the fundamental mode.
    Raises: IndexError where there is no such mode; ParameterError where a point is not finite.
    """
    return np.asarray(ShapeValues(modes, [index])(x, y)[0])


def shapes_at(modes: Modes, x: Array, y: Array) -> Array:
    """Return ξ of every mode at points (x, y), (n_modes, *shape).

    It does for all modes what `shape_at` does for one, at little more cost.
    """
    return ShapeValues(modes)(x, y)


class ShapeValues:
    """ξ of some modes, all unless chosen, as a function of points; see `shapes_at`.

    It is prepared once and asked often.
    """

    def __init__(self, modes: Modes, chosen: Sequence[int] | None = None) -> None:
        kept = list(range(len(modes.frequency)) if chosen is None else chosen)
        self._domain = modes.domain
        self._finder = Finder(modes.domain)
        self._space = Space(modes.domain.mesh, modes.degree)
        self._shapes = modes.shapes[kept]
        self._parity = np.array([modes.parity[k] for k in kept])

    def __call__(self, x: Array, y: Array) -> Array:
        """Return ξ at points (x, y) in m, which broadcast against each other, (n_chosen, *shape).

        Raises: ParameterError.
        """
        points = np.stack(
            np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float)), -1
        )
        if not np.all(np.isfinite(points)):
            raise ParameterError(
                "x, y: expected finite numbers in m, found NaN or infinity among the points"
            )
        where, flips = _fold(self._domain, points.reshape(-1, 2), self._parity.shape[1])
        triangle, reference = self._finder.locate(where)
        found = triangle >= 0
        value = np.zeros((len(self._shapes), len(where)))
        basis = reference_basis(self._space.degree, reference[found])
        dofs = self._space.dofs[triangle[found]]
        rows = csr_array(
            (basis.ravel(), dofs.ravel(), np.arange(len(dofs) + 1) * basis.shape[1]),
            shape=(len(dofs), self._space.size),
        )
        value[:, found] = (rows @ self._shapes.T).T * np.prod(
            self._parity[:, None] ** flips[found], axis=2
        )
        return value.reshape(len(self._shapes), *points.shape[:-1])


def _fold(domain: Domain, points: Array, mirrors: int) -> tuple[Array, NDArray[np.int64]]:
    """Mirror points into the wedge; how often in each mirror, (n_points, mirrors)."""
    points = points - domain.middle
    flips = np.zeros((len(points), mirrors), dtype=np.int64)
    for _ in range(domain.copies):
        for k in range(mirrors):
            angle = (0.0, domain.wedge)[k]
            normal = np.array([-np.sin(angle), np.cos(angle)]) * (1 if k == 0 else -1)
            beyond = points @ normal < 0
            points[beyond] -= 2 * (points[beyond] @ normal)[:, None] * normal
            flips[beyond, k] += 1
    return points + domain.middle, flips


@dataclass(frozen=True, eq=False)
class _Cells:
    """A raster of cells (k, k) over a mesh, from the corner low (2,) in steps of size (2,) [m].

    holds: the triangle at the middle of each cell, −1 for none. touched: whether a triangle may
    reach into the cell.
    """

    low: Array
    size: Array
    holds: NDArray[np.int64]
    touched: NDArray[np.bool_]

    def at(self, points: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the triangle of the cell that each point (n, 2) is in, and whether one reaches it.

        Beyond all cells there is none.
        """
        index = np.floor((points - self.low) / self.size)
        within = np.all((index >= 0) & (index < len(self.holds)), axis=1)
        i, j = np.where(within[:, None], index, 0).astype(np.int64).T
        return np.where(within, self.holds[i, j], -1), within & self.touched[i, j]


class Finder:
    """Which triangle of a mesh holds a point, and where in it."""

    def __init__(self, domain: Domain) -> None:
        space = Space(domain.mesh, 2)
        self._degree = space.map_degree
        self._nodes = space.map_nodes
        corners = self._nodes[:, :3]
        self._centre = corners.mean(axis=1)
        self._reach = 1.05 * np.linalg.norm(self._nodes - self._centre[:, None], axis=2).max(axis=1)
        self._nearest = cKDTree(self._centre)
        self._origin = corners[:, 0]
        sides = corners[:, 1:] - corners[:, :1]
        self._inverse = np.linalg.inv(sides)
        flat = self._origin[:, None] + nodes(self._degree) @ sides
        self._bent = np.abs(self._nodes - flat).max(axis=(1, 2)) > ARRIVED * self._reach

    def locate(self, points: Array) -> tuple[NDArray[np.int64], Array]:
        """Return the triangle that holds each point (n, 2), −1 for none, and the place in it."""
        likely, possible = self._cells.at(points)
        return self._locate(points, likely, possible)

    @cached_property
    def _cells(self) -> "_Cells":
        """What a raster of cells over the mesh says of the points in each."""
        low = self._nodes.min(axis=(0, 1))
        size = np.ptp(self._nodes, axis=(0, 1)) * (1 + 2 * BESIDE) / CELLS
        low = low - BESIDE * CELLS * size / (1 + 2 * BESIDE)
        index = np.stack(np.meshgrid(np.arange(CELLS), np.arange(CELLS), indexing="ij"), -1)
        middle = (low + (index + 0.5) * size).reshape(-1, 2)
        everywhere = np.ones(len(middle), dtype=bool)
        holds, _ = self._locate(middle, np.full(len(middle), -1), everywhere)
        # Every triangle lies in a square of cells; how many do so over each cell, by their corners
        first, last = (
            np.clip(
                np.floor((self._centre + side * self._reach[:, None] - low) / size), 0, CELLS - 1
            ).astype(np.int64)
            for side in (-1, 1)
        )
        count = np.zeros((CELLS + 1, CELLS + 1), dtype=np.int64)
        np.add.at(count, (first[:, 0], first[:, 1]), 1)
        np.add.at(count, (last[:, 0] + 1, first[:, 1]), -1)
        np.add.at(count, (first[:, 0], last[:, 1] + 1), -1)
        np.add.at(count, (last[:, 0] + 1, last[:, 1] + 1), 1)
        touched = count.cumsum(axis=0).cumsum(axis=1)[:CELLS, :CELLS] > 0
        return _Cells(low, size, holds.reshape(CELLS, CELLS), touched)

    def _locate(
        self, points: Array, likely: NDArray[np.int64], possible: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], Array]:
        """Return the same for points of which a likely triangle is known, −1 for none.

        Args: possible (n,): whether any triangle may hold each point.
        """
        triangle = np.full(len(points), -1)
        reference = np.zeros((len(points), 2))

        def settle(point: NDArray[np.int64], trial: NDArray[np.int64]) -> None:
            near = np.linalg.norm(points[point] - self._centre[trial], axis=1) <= self._reach[trial]
            point = point[near]
            trial = trial[near]
            place = self._place(trial, points[point])
            inside = np.all(place > -EDGE, axis=1) & (place.sum(axis=1) < 1 + EDGE)
            triangle[point[inside]] = trial[inside]
            reference[point[inside]] = place[inside]

        guessed = np.flatnonzero(likely >= 0)
        settle(guessed, likely[guessed])
        left = np.flatnonzero(possible & (triangle < 0))
        farthest = float(self._reach.max())
        away, near = map(
            np.asarray,
            self._nearest.query(points[left], NEIGHBOURS, distance_upper_bound=farthest),
        )
        for k in range(NEIGHBOURS):
            still = (triangle[left] < 0) & np.isfinite(away[:, k])
            settle(left[still], near[still, k])
        # Beside an edge of the film, or the centre is far off
        left = left[(triangle[left] < 0) & np.isfinite(away[:, -1])]
        pairs = cKDTree(points[left]).sparse_distance_matrix(
            self._nearest, farthest, output_type="ndarray"
        )
        settle(left[pairs["i"]], pairs["j"])
        return triangle, reference

    def _place(self, triangle: NDArray[np.int64], points: Array) -> Array:
        """Return reference coordinates of points (n, 2), each in its own triangle.

        Newton's method finds them where the triangle is bent.
        """
        place: Array = np.einsum(
            "nx,nxr->nr", points - self._origin[triangle], self._inverse[triangle]
        )
        bent = self._bent[triangle]
        if bent.any():
            place[bent] = _invert(
                self._degree, self._nodes[triangle[bent]], points[bent], np.clip(place[bent], -2, 3)
            )
        return place


def _invert(degree: int, nodes: Array, points: Array, place: Array) -> Array:
    """Return reference coordinates of points (n, 2), each in its own triangle, from a first guess.

    The triangle's map has the given degree and nodes.
    """
    for _ in range(8):
        value = np.einsum("nj,njx->nx", reference_basis(degree, place), nodes)
        jacobian = np.stack(
            [
                np.einsum("nj,njx->nx", reference_basis(degree, place, d), nodes)
                for d in ((1, 0), (0, 1))
            ],
            -1,
        )
        step = np.linalg.solve(jacobian, (points - value)[..., None])[..., 0]
        place = np.clip(place + step, -2, 3)
        if np.abs(step).max(initial=0) < ARRIVED:
            break
    return place
