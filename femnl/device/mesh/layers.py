"""Which triangles the layers on a film cover."""

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from femnl.core.device import Model
from femnl.device.geometry import curves


def covered(model: Model, mesh: MeshTri2) -> dict[str, NDArray[np.int64]]:
    """Return the triangles under each layer of a mesh that follows their rims, as `layer-0` …."""
    middle = mesh.p[:, mesh.t].mean(axis=1).T
    found = {}
    for number, lamina in enumerate(model.layers):
        around = np.zeros(len(middle), dtype=np.int64)
        for rim in lamina.rims:
            around += curves.contains(rim, middle)
        on = around % 2 == 1 if lamina.rims else np.ones(len(middle), dtype=bool)
        found[f"layer-{number}"] = np.flatnonzero(on)
    return found
