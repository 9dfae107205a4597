"""The sides of all tiles together: unknowns they share, and those an edge or mirror holds."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix

from femnl.core.device import Edge
from femnl.core.memory import need_memory
from femnl.device.mesh import distinct
from femnl.mechanics.lattice.sides import Sides
from femnl.mechanics.lattice.tiling import Tiling

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

SAME = 1e-9  # of the film's size, up to which places are one
# Of memory an entry of the tiles' matrices, measured: these, their sum and its factors
ENTRY_BYTES = 150


class Skeleton:
    """Unknowns on the sides of all tiles.

    First come deflections (and in plane u_x, u_y) at `place`, then slopes.

    Attributes: deflections, slopes: of each kind, (tiles, n) numbers of its unknowns;
    n_deflections, n_slopes.
    """

    def __init__(self, tiling: Tiling, sides: list[Sides]) -> None:
        self._half = tiling.half
        shifts = [kind.shifts for kind in tiling.kinds]
        self.deflections, self.place, _ = _number(
            [s.place for s in sides], [np.zeros(len(s.place), int) for s in sides], shifts
        )
        self.slopes, self.slope_place, self.slope_axis = _number(
            [s.slope_place for s in sides], [s.slope_axis for s in sides], shifts
        )
        self.n_deflections = len(self.place)
        self.n_slopes = len(self.slope_place)

    def _on(self, place: Array) -> tuple[Mask, ...]:
        """Whether places are on the right, the top, the mirror y = 0 and the mirror x = 0."""
        near = SAME * self._half.max()
        return tuple(
            np.abs(place[:, a] - at) < near
            for a, at in ((0, self._half[0]), (1, self._half[1]), (1, 0.0), (0, 0.0))
        )

    def free(self, parity: tuple[int, ...]) -> Mask:
        """Return which deflections, then which slopes, are free in modes of a parity.

        The parity is about the mirrors, and w = ∂ₙw = 0 at the edge.
        """
        right, top, *mirrors = self._on(self.place)
        held = right | top
        right, top, *slope_mirrors = self._on(self.slope_place)
        slope_held = (right & (self.slope_axis == 0)) | (top & (self.slope_axis == 1))
        for axis, on, slope_on, sign in zip((1, 0), mirrors, slope_mirrors, parity, strict=True):
            if sign < 0:
                held = held | on
            else:
                slope_held = slope_held | (slope_on & (self.slope_axis == axis))
        return ~np.concatenate([held, slope_held])

    def free_in_plane(self, edge: Edge, parity: tuple[int, ...]) -> Mask:
        """Return which displacements u_x, then u_y, are free under loads of a parity."""
        right, top, *mirrors = self._on(self.place)
        held = [right, top] if edge == "sliding" else [right | top, right | top]
        for axis, on, sign in zip((1, 0), mirrors, parity, strict=True):
            component = axis if sign > 0 else 1 - axis
            held[component] = held[component] | on
        return ~np.concatenate(held)


def _number(
    places: list[Array], marks: list[Index], shifts: list[Array]
) -> tuple[list[Index], Array, Index]:
    """Number the places (n, 2) of each kind at all of its shifts, one number a place and mark.

    Returns: these numbers by kind, and the place and the mark of each number.
    """
    where = np.concatenate(
        [(p[None] + s[:, None]).reshape(-1, 2) for p, s in zip(places, shifts, strict=True)]
    )
    mark = np.concatenate([np.tile(m, len(s)) for m, s in zip(marks, shifts, strict=True)])
    x, y = (distinct(c, SAME * np.abs(where).max(initial=0.0)) for c in where.T)
    key = (x * (y.max(initial=0) + 1) + y) * 2 + mark
    _, first, numbers = np.unique(key, return_index=True, return_inverse=True)
    ends = np.cumsum([len(p) * len(s) for p, s in zip(places, shifts, strict=True)])[:-1]
    split = [n.reshape(len(s), -1) for n, s in zip(np.split(numbers, ends), shifts, strict=True)]
    return split, where[first], mark[first]


def need_room(entries: int) -> None:
    """Refuse matrices of all tiles that the memory cannot hold with their sum and its factors."""
    need_memory(
        ENTRY_BYTES * entries, f"condensed cells on {entries:.2g} entries", "lower the resolution"
    )


def summed(blocks: list[Array], numbers: list[Index], size: int) -> csc_matrix:
    """Return the sum of the tiles' matrices (tiles or 1, n, n), kind by kind, at (tiles, n)."""
    need_room(sum(at.shape[0] * at.shape[1] ** 2 for at in numbers))
    data = []
    rows = []
    columns = []
    for block, at in zip(blocks, numbers, strict=True):
        shape = (len(at), at.shape[1], at.shape[1])
        data.append(np.broadcast_to(block, shape).ravel())
        rows.append(np.broadcast_to(at[:, :, None], shape).astype(np.int32).ravel())
        columns.append(np.broadcast_to(at[:, None, :], shape).astype(np.int32).ravel())
    entries = (np.concatenate(data), (np.concatenate(rows), np.concatenate(columns)))
    return csc_matrix(coo_matrix(entries, shape=(size, size)))
