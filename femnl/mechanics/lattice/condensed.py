"""Modes of a perforated rectangle whose cells are condensed.

The unknowns inside a cell are eliminated once for all cells alike.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.errors import ConvergenceError
from femnl.core.modes import Modes
from femnl.mechanics.fem.solvers import lowest_eigenpairs
from femnl.mechanics.lattice.relaxed import Frame, Relaxed
from femnl.mechanics.lattice.skeleton import need_room, summed
from femnl.mechanics.lattice.tile import Flexure
from femnl.mechanics.lattice.tiling import Tiling, placed_domain
from femnl.mechanics.modes import solve_sectors

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHUNK = 2000  # tiles and modes at a time
TAKEN = 10  # functions by which a basis is extended
# Relative excess of ω² that is mended to first order, and from which the basis is extended
MISSED = 1e-8
EXTENSIONS = 4


def solve_condensed(tiling: Tiling, count: int, degree: int, missed: float = MISSED) -> Modes:
    """Solve the modes of a film in tiles, whose inner unknowns are eliminated first.

    Stiffness and film stress of a tile follow from what its sides do, so that a film of thousands
    of holes costs what their sides cost. The basis of a tile spans its response to every motion of
    its sides, and its own slowest motions. What the basis misses is computed from the residual,
    tile by tile, and the frequencies are corrected for it. Where it is more than `missed` of ω²,
    the basis is extended by it.

    Args: count: how many modes. degree: of the elements, 2 to 6, from 1 without bending.
    missed: relative excess of ω² that a basis may leave.
    Returns: the modes of the whole mesh of all tiles, as `femnl.mechanics.modes.solve_modes` gives
    them for meshes of other films.
    Raises: ParameterError; ConvergenceError where the basis does not suffice.
    Source: component mode synthesis, Craig & Bampton, AIAA J. 6, 1313 (1968); held against the same
        film without any condensation by tests/physics/test_condensed.py.
    """
    relaxed = Relaxed(Frame(tiling, degree))
    source = Condensed(relaxed, missed)
    prestress = relaxed.prestress()
    modes = solve_sectors(source, prestress, count)
    for _ in range(EXTENSIONS):
        if source.missed <= missed:
            break
        source.extend()
        modes = solve_sectors(source, prestress, count)
    if source.missed <= missed:
        placed = replace(prestress, domain=placed_domain(tiling))
        return replace(modes, prestress=placed)
    raise ConvergenceError(
        f"{tiling.model.name}: condensed cells leave {source.missed:.1e} of ω² in the highest "
        "mode; ask for fewer modes, or for symmetry quarter, which condenses nothing"
    )


class Condensed:
    """K and M of the deflection of all tiles, in the basis of their sides.

    Together with slow responses of their inside.

    The basis leaves out what tiles of unequal stress answer to waves on their sides in unequal
    ways: `missed` says how much that is, and `extend` takes it in.

    Args: relaxed: the film's stress. most: relative excess of ω² from which tiles are to be
    extended.
    Attributes: space: of the mesh of all tiles; missed: the largest relative excess of ω² in what
    `lowest` found.
    """

    def __init__(self, relaxed: Relaxed, most: float) -> None:
        self._relaxed = relaxed
        self._most = most
        frame = relaxed.frame
        pairs = zip(frame.sides, relaxed.mean, strict=True)
        self._flexures = [
            Flexure(sides, frame.tiling.model, mean, frame.degree) for sides, mean in pairs
        ]
        self.space = frame.numbering.space
        self._assemble()

    def _assemble(self) -> None:
        relaxed = self._relaxed
        skeleton = self._relaxed.frame.skeleton
        need_room(
            sum(
                len(a) * f.basis.shape[1] ** 2
                for a, f in zip(relaxed.amounts, self._flexures, strict=True)
            )
        )
        first = skeleton.n_deflections + skeleton.n_slopes
        self._numbers = []
        stiff = []
        heavy = []
        for k, flexure in enumerate(self._flexures):
            tiles = len(relaxed.amounts[k])
            inner = flexure.basis.shape[1] - flexure.n_sides
            own = first + np.arange(tiles * inner).reshape(tiles, inner)
            first += tiles * inner
            self._numbers.append(
                np.concatenate(
                    [skeleton.deflections[k], skeleton.n_deflections + skeleton.slopes[k], own],
                    axis=1,
                )
            )
            still = flexure.reduced(flexure.bend + flexure.tension(relaxed.mean[k]))
            fields = [flexure.reduced(flexure.tension(field)) for field in relaxed.fields[k]]
            stiff.append(
                still
                + np.tensordot(relaxed.amounts[k], np.array(fields).reshape(-1, *still.shape), 1)
            )
            heavy.append(flexure.reduced(flexure.inertia))
        self._n = first
        self.missed = 0.0
        self._stiffness, self._mass = (
            summed(blocks, self._numbers, first) for blocks in (stiff, heavy)
        )
        self._corrections: list[list[Array]] = [[] for _ in self._flexures]

    def lowest(self, parity: tuple[int, ...], count: int) -> tuple[Array, Array]:
        """Return ω² (count,) and shapes (count, size), ∫ρhw² = 1, of a parity's lowest modes."""
        free = np.ones(self._n, dtype=bool)
        known = self._relaxed.frame.skeleton.free(parity)
        free[: len(known)] = known
        at = np.flatnonzero(free)
        values, vectors = lowest_eigenpairs(
            csc_matrix(self._stiffness[at][:, at]), csc_matrix(self._mass[at][:, at]), count
        )
        whole = np.zeros((self._n, count))
        whole[at] = vectors
        shapes = np.zeros((count, self.space.size))
        excess = np.zeros(count)
        for k, (flexure, numbers, dofs) in enumerate(
            zip(self._flexures, self._numbers, self._relaxed.frame.numbering.dofs, strict=True)
        ):
            n = dofs.shape[1]
            size = len(flexure.basis)
            step = max(CHUNK // count, 1)
            for start in range(0, len(numbers), step):
                some = slice(start, start + step)
                amounts = whole[numbers[some]].transpose(1, 0, 2)
                local = (flexure.basis @ amounts.reshape(len(amounts), -1)).reshape(size, -1, count)
                correction, energy = flexure.missed(self._relaxed.stress(k, some), values, local)
                shapes[:, dofs[some]] = (local - correction)[:n].transpose(2, 1, 0)
                excess += energy
                if np.any(energy > self._most * values / len(self._flexures)):
                    self._corrections[k].append(_most(correction.reshape(size, -1)))
        self.missed = max(self.missed, float(np.max(excess / values)))
        return values - excess, shapes

    def extend(self) -> None:
        """Take what the basis missed most of in the modes found so far into it."""
        for flexure, corrections in zip(self._flexures, self._corrections, strict=True):
            if corrections:
                flexure.extend(_most(np.concatenate(corrections, axis=1)))
        self._assemble()


def _most(corrections: Array) -> Array:
    """Return the `TAKEN` functions (size, n) that hold most of the given ones."""
    left, size, _ = np.linalg.svd(corrections, full_matrices=False)
    return np.asarray(left[:, :TAKEN] * size[:TAKEN])
