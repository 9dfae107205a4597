"""From gmsh's memory to scikit-fem's mesh."""

from dataclasses import dataclass

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skfem import MeshTri2

from femnl.core.device import Model
from femnl.core.errors import GeometryError
from femnl.device.geometry import curves
from femnl.mechanics.fem.elements import STRAIGHT, Space
from femnl.mechanics.fem.reference import nodes

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LINE, TRIANGLE, CURVED_LINE = 1, 2, 8
"""gmsh's numbers of elements: two ends, three corners, two ends and a middle."""
EDGES = ([0, 1], [1, 2], [2, 0])  # of a triangle, in gmsh's order
OPPOSITE = np.array([1, 2, 0])  # of those, to each corner
BEYOND = (2, 0, 1)  # corner, of those in order, opposite to each of scikit-fem's facets
NEAR = 1e-3  # of an ellipse's shorter half axis, up to which nodes on the edge belong to it
JOIN = 1e-9  # of the largest coordinate, up to which corners are the same


@dataclass(frozen=True)
class Raw:
    """Return points (n, 2) [m], second-order triangles (m, 6) and edges by boundary.

    The edges (k, 2) of each named boundary, by their ends.
    """

    points: Array
    triangles: Index
    edges: dict[str, Index]


def collect(named: dict[str, list[int]], unit: float) -> Raw:
    """Take the mesh of the current gmsh model and make it of second order.

    Middles of edges inside the film are those of their ends. gmsh places the others, on the curves:
    it is left with these alone, since it takes a sixth of the time of meshing for all.

    Args:
        named: curve tags by boundary.
        unit: of gmsh's lengths in 1 m.
    """
    mesh = gmsh.model.mesh
    corners, row = _nodes(unit)
    triangles = row[mesh.getElementsByType(TRIANGLE)[1].reshape(-1, 3)]
    elements, ends = mesh.getElementsByType(LINE)
    lines = row[ends.reshape(-1, 2)]
    boundary = _boundaries(named, elements)
    edges = {name: lines[boundary == k] for k, name in enumerate(named) if named[name]}
    for _, face in gmsh.model.getEntities(2):
        mesh.removeElements(2, face)
    mesh.setOrder(2)  # numbers nodes anew, and keeps lines in their order
    places, row = _nodes(unit)
    on_curves = places[row[mesh.getElementsByType(CURVED_LINE)[1].reshape(-1, 3)[:, 2]]]
    sides, middles = _sides(triangles, lines, corners, on_curves)
    points = np.concatenate([corners, middles])
    return Raw(points, np.concatenate([triangles, len(corners) + sides], axis=1), edges)


def _boundaries(named: dict[str, list[int]], lines: Index) -> Index:
    """Return the position among the boundaries of that on which each of gmsh's lines lies.

    It is -1 on none. gmsh is asked about each curve, which takes long, but those of the boundary
    with the most curves: the lines that are left are its own.
    """
    number = {tag: k for k, tags in enumerate(named.values()) for tag in tags}
    most = int(np.argmax([len(tags) for tags in named.values()]))
    boundary = np.full(int(lines.max()) + 1, most)
    for _, tag in gmsh.model.getEntities(1):
        if number.get(tag, -1) != most:
            for on_curve in gmsh.model.mesh.getElements(1, tag)[1]:
                boundary[on_curve] = number.get(tag, -1)
    return np.asarray(boundary[lines])


def _nodes(unit: float) -> tuple[Array, Index]:
    """Return the places (n, 2) [m] of gmsh's nodes, and the row of each of their tags."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row = np.full(int(tags.max()) + 1, -1)
    row[tags] = np.arange(len(tags))
    return coordinates.reshape(-1, 3)[:, :2] / unit, row


def _sides(triangles: Index, lines: Index, corners: Array, on_curves: Array) -> tuple[Index, Array]:
    """Number the sides of triangles, alike where two share one; return also their middles.

    Args:
        triangles: (m, 3) rows of their corners.
        lines: (l, 2) rows of the ends of sides that lie on curves.
        corners: (n, 2) [m].
        on_curves: (l, 2) [m], the middles of those sides.
    Returns: numbers (m, 3) of the sides in gmsh's order, and middles (k, 2) [m] by number.
    """

    def key(ends: Index) -> Index:
        low, high = np.sort(ends, axis=1).T
        return np.asarray(low * len(corners) + high)

    ends = np.concatenate([triangles[:, pair] for pair in EDGES])
    keys, first, number = np.unique(key(ends), return_index=True, return_inverse=True)
    middles = corners[ends[first]].mean(axis=1)
    beside = np.isin(key(lines), keys)  # a curve need not bound the film
    middles[np.searchsorted(keys, key(lines[beside]))] = on_curves[beside]
    return number.reshape(3, -1).T, middles


def double(raw: Raw) -> Raw:
    """Put the mesh of an eighth and its image in the diagonal together to that of a quarter.

    The mirrors of an eighth are the x axis and the diagonal.
    """
    diagonal = np.unique(raw.edges["mirror-1"])
    middle = np.abs(raw.points[:, 0] - raw.points[:, 1]) <= 1e-9 * np.abs(raw.points).max()
    middle[diagonal] = True
    image = np.arange(len(raw.points))
    image[~middle] = len(raw.points) + np.arange(np.sum(~middle))
    points = np.concatenate([raw.points, raw.points[~middle][:, ::-1]])
    points[: len(raw.points)][middle] = points[: len(raw.points)][middle].mean(
        axis=1, keepdims=True
    )
    edges = {
        name: np.concatenate([ends, image[ends]])
        for name, ends in raw.edges.items()
        if not name.startswith("mirror")
    }
    edges |= {"mirror-0": raw.edges["mirror-0"], "mirror-1": image[raw.edges["mirror-0"]]}
    return Raw(points, np.concatenate([raw.triangles, image[raw.triangles]]), edges)


def assemble(raw: Raw) -> MeshTri2:
    """Make scikit-fem's mesh.

    Vertices of each triangle sorted, middles of edges numbered by facet, boundaries named.
    """
    used = np.zeros(len(raw.points), dtype=bool)
    used[raw.triangles[:, :3]] = True
    corners = np.flatnonzero(used)
    vertex = np.full(len(raw.points), -1)
    vertex[corners] = np.arange(len(corners))
    places = np.ascontiguousarray(raw.points[corners].T)
    # One mesh from the start, as every other numbers its edges anew, which takes seconds of large
    # ones: its middles and boundaries follow.
    boundaries: dict[str, Index] = {}
    turned = np.argsort(raw.triangles[:, :3], axis=1)
    triangles = vertex[np.take_along_axis(raw.triangles, turned, axis=1)].T
    result = MeshTri2(places, np.ascontiguousarray(triangles), _boundaries=boundaries)
    middles = np.empty((2, result.nfacets))
    for facets, corner in zip(result.t2f, turned[:, BEYOND].T, strict=True):
        middle = np.take_along_axis(raw.triangles, 3 + OPPOSITE[corner][:, None], axis=1)[:, 0]
        middles[:, facets] = raw.points[middle].T
    result.doflocs = np.hstack([places, middles])
    keys = np.sort(result.facets.astype(np.int64), axis=0)
    numbers = keys[0] * len(corners) + keys[1]
    order = np.argsort(numbers)

    def facet_of(ends: Index) -> Index:
        low, high = np.sort(vertex[ends], axis=1).T
        return np.asarray(order[np.searchsorted(numbers, low * len(corners) + high, sorter=order)])

    boundaries |= {name: np.unique(facet_of(ends)) for name, ends in raw.edges.items()}
    return result


def distinct(values: Array, apart: float) -> Index:
    """Number values (n,) in their order, alike where they differ by less than `apart`."""
    order = np.argsort(values)
    numbers = np.empty(len(values), dtype=np.int64)
    numbers[order] = (
        np.concatenate([[0], np.cumsum(np.diff(values[order]) > apart)]) if len(values) else order
    )
    return numbers


def from_patches(patches: Array) -> MeshTri2:
    """Join second-order triangles (m, 6, 2) [m] wherever their corners meet.

    In each, corners stand before middles.
    """
    corners = patches[:, :3].reshape(-1, 2)
    key = np.stack([distinct(c, JOIN * np.abs(corners).max()) for c in corners.T], 1)
    _, first, index = np.unique(
        key[:, 0] * (key[:, 1].max() + 1) + key[:, 1], return_index=True, return_inverse=True
    )
    index = index.reshape(-1, 3)
    middles = len(first) + np.arange(3 * len(patches)).reshape(-1, 3)
    points = np.concatenate([corners[first], patches[:, 3:].reshape(-1, 2)])
    return assemble(Raw(points, np.concatenate([index, middles], axis=1), {}))


def misfit(model: Model, result: MeshTri2) -> float:
    """Return how far elliptical edges lie from their ellipses, relative to the shorter half axis.

    Curved edges are followed as arcs of circles through their ends and middles. Between these, an
    edge of length h leaves an ellipse of curvature κ by about κ'h³, which every degree shares, so
    that no difference of degrees shows it. To first order it changes a frequency by its mean.
    """
    loops = (model.edge_outline, *model.openings)
    ellipses = [s for loop in loops for s in loop.segments if s.semi_axes is not None]
    if not ellipses:
        return 0.0
    rim = Space(result, 2).arc_nodes
    if len(rim) == 0:
        return 0.0
    nodes_by_place = cKDTree(rim)
    found = 0.0
    for segment in ellipses:
        short, long = sorted(segment.semi_axes or (1.0, 1.0))
        centre = np.asarray(segment.centre)
        beside = nodes_by_place.query_ball_point(centre, (1 + NEAR) * long)
        gaps = curves.gaps_from_ellipse(segment, rim[beside]) / short
        found = max(found, float(np.max(gaps, where=gaps < NEAR, initial=0.0)))
    return found


def check_unfolded(model: Model, result: MeshTri2) -> None:
    """Curved triangles beside small arcs can fold over: their Jacobian must keep one sign."""
    space = Space(result, 2)
    start, end = (result.p[:, ends] for ends in result.facets)
    sagitta = np.linalg.norm(result.doflocs[:, result.nvertices :] - (start + end) / 2, axis=0)
    bent = sagitta > STRAIGHT * np.linalg.norm(end - start, axis=0)
    curved = np.flatnonzero(np.any(bent[result.t2f], axis=0))
    points = np.vstack([space.quadrature(8)[0], nodes(2)])
    determinant = space.determinant(curved, points)
    folded = curved[np.any(determinant * np.sign(determinant[:, :1]) <= 0, axis=1)]
    if len(folded):
        x, y = space.location[space.dofs[folded[0], 0]]
        raise GeometryError(
            f"{model.name}: {len(folded)} curved elements fold over, the first at ({x:.4g}, "
            f"{y:.4g}) m; raise the resolution"
        )
