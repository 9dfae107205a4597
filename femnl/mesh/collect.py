"""From gmsh's memory to scikit-fem's mesh."""

import gmsh
import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri1, MeshTri2

from femnl.errors import GeometryError
from femnl.fem.elements import EDGES, Space, nodes
from femnl.types.device import Model

Array = NDArray[np.float64]


def collect(named: dict[str, list[int]], unit: float) -> MeshTri2:
    """Take the second-order mesh of the current gmsh model, with sorted vertices in each triangle; `named`: curve tags by boundary."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row = np.empty(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    where = coordinates.reshape(-1, 3)[:, :2] / unit
    six = row[gmsh.model.mesh.getElementsByType(9)[1].reshape(-1, 6)]
    corners = np.unique(six[:, :3])
    vertex = np.full(len(tags), -1)
    vertex[corners] = np.arange(len(corners))
    linear = MeshTri1(np.ascontiguousarray(where[corners].T), np.ascontiguousarray(vertex[six[:, :3]].T))

    keys = np.sort(linear.facets.astype(np.int64), axis=0)
    numbers = keys[0] * len(corners) + keys[1]
    order = np.argsort(numbers)

    def facet_of(ends: NDArray[np.int64]) -> NDArray[np.int64]:
        low, high = np.sort(vertex[ends], axis=1).T
        return np.asarray(order[np.searchsorted(numbers, low * len(corners) + high, sorter=order)])

    middles = np.empty((keys.shape[1], 2))
    for local, (a, b) in enumerate(EDGES):
        middles[facet_of(six[:, [a, b]])] = where[six[:, 3 + local]]
    boundaries = {}
    for name, entities in named.items():
        ends = [row[gmsh.model.mesh.getElements(1, tag)[2][0].reshape(-1, 3)[:, :2]] for tag in entities]
        if ends:
            boundaries[name] = np.unique(facet_of(np.concatenate(ends)))
    return MeshTri2(np.ascontiguousarray(np.hstack([linear.p, middles.T])), linear.t, _boundaries=boundaries)


def check_unfolded(model: Model, result: MeshTri2) -> None:
    """Curved triangles beside small arcs can fold over: their Jacobian must keep one sign."""
    space = Space(result, 2)
    points = np.vstack([space.quadrature(8)[0], nodes(2)])
    determinant = np.linalg.det(space.jet(slice(None), points).jacobian)
    folded = np.flatnonzero(np.any(determinant * np.sign(determinant[:, :1]) <= 0, axis=1))
    if len(folded):
        x, y = space.location[space.dofs[folded[0], 0]]
        raise GeometryError(
            f"{model.name}: {len(folded)} curved elements fold over, the first at ({x:.4g}, {y:.4g}) m; raise the resolution"
        )
