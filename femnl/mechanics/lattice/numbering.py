"""From the unknowns of tiles to those of the mesh that all tiles make."""

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.reference import nodes
from femnl.mechanics.lattice.tiling import Kind, Tiling

Index = NDArray[np.int64]


class Numbering:
    """The numbers that each tile's unknowns have in the whole mesh.

    dofs: for each kind of tile, an array (tiles, size of the tile's space).
    """

    def __init__(self, tiling: Tiling, spaces: list[Space], degree: int) -> None:
        self.space = Space(tiling.domain.mesh, degree)
        self.dofs = []
        start = 0
        for kind, space in zip(tiling.kinds, spaces, strict=True):
            n = len(space.dofs)
            tiles = len(kind.shifts)
            whole = self.space.dofs[start : start + n * tiles].reshape(tiles, n, -1)
            turn = self._turns(kind, start)
            start += n * tiles
            found = np.empty((tiles, space.size), dtype=np.int64)
            local = space.dofs[np.arange(n)[None, :, None], turn]
            np.put_along_axis(found, local.reshape(tiles, -1), whole.reshape(tiles, -1), axis=1)
            self.dofs.append(found)

    def _turns(self, kind: Kind, start: int) -> Index:
        """Return which node of its tile each node of the whole mesh's triangles is.

        A triangle may begin at another vertex in the whole mesh than in its tile.

        Returns: (tiles, e, n_basis), numbers of nodes within the tile's triangle.
        """
        mesh = self.space.mesh
        tiles = len(kind.shifts)
        n = kind.mesh.nelements
        own = kind.mesh.p[:, kind.mesh.t[:3]].transpose(2, 1, 0)  # (e, 3, 2)
        whole = (
            mesh.p[:, mesh.t[:3, start : start + n * tiles]]
            .transpose(2, 1, 0)
            .reshape(tiles, n, 3, 2)
        )
        away = (whole - kind.shifts[:, None, None])[:, :, :, None] - own[None, :, None]
        # (tiles, e, 3): the tile's vertex at each vertex of the whole
        order = np.argmin(np.abs(away).sum(axis=-1), axis=-1)
        table = _node_turns(self.space.degree)
        return np.asarray(table[order[..., 0], order[..., 1]])


def _node_turns(degree: int) -> Index:
    """Return the nodes of a triangle that is turned, by where its first two vertices then are.

    Each entry is its own node at a node of the triangle so turned.
    """
    where = nodes(degree)
    full = np.column_stack([1 - where.sum(axis=1), where])
    table = np.zeros((3, 3, len(where)), dtype=np.int64)
    for order in permutations(range(3)):
        turned = np.empty_like(full)
        turned[:, order] = full
        table[order[0], order[1]] = np.argmin(
            np.abs(turned[:, None] - full[None]).sum(axis=-1), axis=1
        )
    return table
