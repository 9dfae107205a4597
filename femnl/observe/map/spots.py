"""What a laser spot of finite size reads.

The signal on a grid that is finer and wider than the map, spread by diffusion.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh_tridiagonal

from femnl.core.readout import Array, ComplexArray

STEP = 2.1e-6
MOST = 4
"""Distance [m] of the points of the finer grid, and how many of them there are at most for a point
of the map along each axis.
"""
REACH = 2.3e-5
"""How far [m] the finer grid goes beyond the map: three sd of the widest spot."""


@dataclass(frozen=True)
class Grid:
    """Points of a map: x, y (n,) [m], row and column (n,) on axes of the given sizes."""

    x: Array
    y: Array
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    sizes: tuple[int, int]


@dataclass(frozen=True)
class Axis:
    """One axis of the finer grid.

    nodes (n_nodes,) [m], and which of them (n,) are the points of the map.
    """

    nodes: Array
    place: NDArray[np.int64]

    @classmethod
    def beside(cls, points: Array) -> "Axis":
        """Return nodes between and beyond the points of a map's axis."""
        ordered, inverse = np.unique(points, return_inverse=True)
        gaps = np.diff(ordered)
        parts = np.clip(np.ceil(gaps / STEP).astype(np.int64), 1, MOST)
        inner = [
            np.linspace(a, b, n, endpoint=False)
            for a, b, n in zip(ordered[:-1], ordered[1:], parts, strict=True)
        ]
        # Beyond a map of closer points, steps as wide as any: it may cover a corner of the spot
        # only.
        before, after = (
            (max(gap / n, STEP) for gap, n in ((gaps[0], parts[0]), (gaps[-1], parts[-1])))
            if len(gaps)
            else (STEP, STEP)
        )
        low = ordered[0] - before * np.arange(np.ceil(REACH / before), 0, -1)
        high = ordered[-1] + after * np.arange(1, np.ceil(REACH / after) + 1)
        place = len(low) + np.concatenate([[0], np.cumsum(parts)])
        return cls(np.concatenate([low, *inner, ordered[-1:], high]), place[inverse])

    @cached_property
    def _diffusion(self) -> tuple[Array, Array, Array]:
        """Roots of the nodes' widths, and the spectrum of the second difference.

        Its eigenvalues and vectors, without flux through the ends.
        """
        step = np.diff(self.nodes)
        width = (np.append(step, 0) + np.insert(step, 0, 0)) / 2
        off = 1 / (step * np.sqrt(width[1:] * width[:-1]))
        rates, vectors = eigh_tridiagonal(
            -(np.append(1 / step, 0) + np.insert(1 / step, 0, 0)) / width, off
        )
        return np.sqrt(width), np.asarray(rates, float), np.asarray(vectors, float)

    def spread(self, sd: float) -> Array:
        """Return weights (n, n_nodes) of a Gaussian of that sd [m].

        e^{sd²/2 ∂²}, which has its variance on every grid, coarse or fine.
        """
        root, rates, vectors = self._diffusion
        rows = vectors[self.place] / root[self.place, None] * np.exp(rates * sd**2 / 2)
        return np.asarray(rows @ (vectors * root[:, None]).T)


@dataclass(frozen=True)
class Finer:
    """The finer grid of a map."""

    across: Axis
    up: Axis

    @cached_property
    def grid(self) -> Grid:
        """All its points."""
        sizes = len(self.up.nodes), len(self.across.nodes)
        row, column = np.divmod(np.arange(sizes[0] * sizes[1]), sizes[1])
        return Grid(self.across.nodes[column], self.up.nodes[row], row, column, sizes)

    def average(self, volts: ComplexArray, sd: float, at: Grid) -> ComplexArray:
        """Spread signals (n_harmonics, n_nodes) over a spot.

        Return them (n_harmonics, n) at points of the map.
        """
        # Real products cost half of complex ones
        both = np.stack([volts.real, volts.imag]).reshape(2, len(volts), *self.grid.sizes)
        spread = self.up.spread(sd) @ both @ self.across.spread(sd).T
        return np.asarray(spread[0] + 1j * spread[1])[:, at.row, at.column]
