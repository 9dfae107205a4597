"""Tiles that move in plane.

What their sides share of the load, and the film stress that is left after release.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.domain import Prestress
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import plane_stress
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.lattice.numbering import Numbering
from femnl.mechanics.lattice.sides import Sides
from femnl.mechanics.lattice.skeleton import Skeleton, summed
from femnl.mechanics.lattice.tile import Membrane
from femnl.mechanics.lattice.tiling import Tiling

Array = NDArray[np.float64]

# Of the largest in-plane displacement that relaxes a tile, what of the others' departures from it
# is left out
KEPT = 1e-10


class Frame:
    """Elements of one degree on all tiles.

    `spaces` and `sides` of each kind, and the `skeleton` of what they share.
    """

    def __init__(self, tiling: Tiling, degree: int) -> None:
        self.tiling = tiling
        self.degree = degree
        self.spaces = [Space(kind.mesh, degree) for kind in tiling.kinds]
        self.sides = [Sides(space, tiling.model.bending) for space in self.spaces]
        self.skeleton = Skeleton(tiling, self.sides)

    @cached_property
    def numbering(self) -> Numbering:
        """Where the tiles' deflections are in the mesh of all tiles."""
        return Numbering(self.tiling, self.spaces, self.degree)


class InPlane:
    """In-plane displacements of the sides of all tiles under loads on them."""

    def __init__(self, skeleton: Skeleton, membranes: list[Membrane]) -> None:
        n = skeleton.n_deflections
        self.numbers = [np.concatenate([at, at + n], axis=1) for at in skeleton.deflections]
        self._matrix = summed([m.stiffness for m in membranes], self.numbers, 2 * n)

    def gather(self, loads: list[Array]) -> Array:
        """Return loads (k, tiles, n) of each kind at the unknowns of all, (size, k)."""
        right = np.zeros((self._matrix.shape[0], len(loads[0])))
        for load, at in zip(loads, self.numbers, strict=True):
            np.add.at(right, at, np.moveaxis(load, 0, -1))
        return right

    def solve(self, right: Array, free: NDArray[np.bool_]) -> Array:
        """Return displacements (size, k) under loads (size, k), zero where not free."""
        found = np.zeros_like(right)
        at = np.flatnonzero(free)
        found[at] = factorize(csc_matrix(self._matrix[at][:, at]))(right[at])
        return found


class Relaxed:
    """The film stress of all tiles after release, as a mean and a few fields that tiles add to it.

    Args: frame: the tiles.
    Attributes: mean (e, q, 3) [Pa] and fields (r, e, q, 3) [Pa] of each kind, of which its tiles
    take amounts (tiles, r).
    Raises: ConvergenceError where the film is not supported.
    """

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        tiling = frame.tiling
        model = tiling.model
        film = tiling.model.film
        self._membranes = [
            Membrane(sides, model, film.poisson, 2 * frame.degree) for sides in frame.sides
        ]
        self._still = []
        loads = []
        for kind, membrane in zip(tiling.kinds, self._membranes, strict=True):
            initial = film.stress * membrane.thickness[..., None] * np.array([1.0, 1.0, 0.0])
            still, load = membrane.respond(membrane.load(initial[None]))
            self._still.append(still[:, 0])
            loads.append(np.broadcast_to(load.T[:, None], (1, len(kind.shifts), len(load))))
        in_plane = InPlane(frame.skeleton, self._membranes)
        moved = in_plane.solve(
            in_plane.gather(loads), frame.skeleton.free_in_plane("clamped", (1, 1))
        )[:, 0]
        self._edges = [moved[at] for at in in_plane.numbers]
        moduli = plane_stress(film.young, film.poisson)
        even = film.stress * np.array([1.0, 1.0, 0.0])
        self.mean = []
        self.fields = []
        self.amounts = []
        for membrane, still, edges in zip(self._membranes, self._still, self._edges, strict=True):
            centre = edges.mean(axis=0)
            left, size, right = np.linalg.svd(edges - centre, full_matrices=False)
            kept = size > KEPT * np.abs(still).max()
            strain = membrane.strain(
                np.column_stack([still + membrane.lift @ centre, membrane.lift @ right[kept].T])
            )
            self.mean.append(even + strain[0] @ moduli)
            self.fields.append(strain[1:] @ moduli)
            self.amounts.append(left[:, kept] * size[kept])

    def stress(self, kind: int, tiles: slice) -> Array:
        """Return σ (tiles, e, q, 3) [Pa] of some tiles of a kind."""
        fields = self.fields[kind]
        mean = self.mean[kind]
        return np.asarray(
            mean
            + (self.amounts[kind][tiles] @ fields.reshape(len(fields), mean.size)).reshape(
                -1, *mean.shape
            )
        )

    def prestress(self) -> Prestress:
        """Return the displacement on the mesh of all tiles."""
        numbering = self.frame.numbering
        whole = np.zeros((2, numbering.space.size))
        for k, (membrane, still, edges) in enumerate(
            zip(self._membranes, self._still, self._edges, strict=True)
        ):
            local = (still + edges @ membrane.lift.T).reshape(len(edges), 2, -1)
            whole[:, numbering.dofs[k]] = local.transpose(1, 0, 2)
        return Prestress(self.frame.tiling.domain, self.frame.degree, whole.ravel())
