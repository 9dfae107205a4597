"""Which triangles the layers on a film cover."""

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from femnl.core.device import Lamina, Model
from femnl.device.geometry import curves


def covered(model: Model, mesh: MeshTri2) -> dict[str, NDArray[np.int64]]:
    """Return the triangles under each layer of a mesh that follows their rims, as `layer-0` …."""
    middle = mesh.p[:, mesh.t].mean(axis=1).T
    return {
        f"layer-{number}": np.flatnonzero(covers(lamina, middle))
        for number, lamina in enumerate(model.layers)
    }


def covers(lamina: Lamina, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return at which points (n, 2) [m] a layer lies, as far as the film does."""
    if not lamina.rims:
        return np.ones(len(points), dtype=bool)
    around = np.zeros(len(points), dtype=np.int64)
    for rim in lamina.rims:
        around += curves.contains(rim, points)
    return np.asarray(around % 2 == 1)
