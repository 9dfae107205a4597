"""Lattices: vectors, cells, and the paths of wave vectors along which bands run."""

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Clamp, Lamina, Model
from femnl.core.outline import CELL, Holes, Outline, Segment

Array = NDArray[np.float64]
Symmetry = Literal["quarter", "eighth", "twelfth"]
"""Parts of a cell that may make the whole."""
SPREAD = 4
"""Parts of a side between wave vectors inside the irreducible part, where a band may be higher or
lower than anywhere on its rim."""


@dataclass(frozen=True)
class Lattice:
    """A lattice of equal cells, a row of them along x. kind: `square` or `hexagonal`.

    pitch [m]: of nearest cells.
    """

    kind: Literal["square", "hexagonal"]
    pitch: float

    @property
    def turns(self) -> int:
        """By how many equal turns a cell comes back to itself: its number of sides."""
        return 4 if self.kind == "square" else 6

    @property
    def steps(self) -> Array:
        """Vectors (turns/2, 2) [m] to the neighbours across half of the cell's sides.

        Those across the others are opposite.
        """
        angle = 2 * np.pi / self.turns * np.arange(self.turns // 2)
        return np.asarray(self.pitch * np.stack([np.cos(angle), np.sin(angle)], -1))

    @property
    def corners(self) -> Array:
        """Corners (turns, 2) [m] of the cell around the origin, counter-clockwise."""
        angle = 2 * np.pi / self.turns * (np.arange(self.turns) + 0.5)
        return np.asarray(
            self.pitch
            / 2
            / np.cos(np.pi / self.turns)
            * np.stack([np.cos(angle), np.sin(angle)], -1)
        )

    @property
    def points(self) -> dict[str, Array]:
        """Wave vectors (2,) [rad/m] of the irreducible part's corners, in drawing order."""
        k = np.pi / self.pitch
        if self.kind == "square":
            return {"Γ": np.zeros(2), "X": np.array([k, 0]), "M": np.array([k, k])}
        return {"Γ": np.zeros(2), "M": np.array([k, k / np.sqrt(3)]), "K": np.array([4 * k / 3, 0])}

    def path(
        self, steps: int, corners: dict[str, Array] | None = None
    ) -> tuple[Array, tuple[tuple[str, int], ...]]:
        """Return wave vectors (n, 2) [rad/m] around the irreducible part.

        The second result names its corners and their places among the wave vectors.
        Args: steps: along the first side; the others have as many a length, at least one.
            corners: of the part, `points` by default.
        """
        points = self.points if corners is None else corners
        names = [*points, "Γ"]
        ends = np.array([points[name] for name in names])
        lengths = np.linalg.norm(np.diff(ends, axis=0), axis=1)
        counts = np.maximum(1, np.round(steps * lengths / lengths[0]).astype(int))
        parts = [
            a + (b - a) * np.arange(n)[:, None] / n
            for a, b, n in zip(ends, ends[1:], counts, strict=False)
        ]
        places = np.concatenate([[0], np.cumsum(counts)])
        return np.concatenate([*parts, ends[-1:]]), tuple(
            (name, int(place)) for name, place in zip(names, places, strict=True)
        )


@dataclass(frozen=True)
class Cell:
    """What repeats on a lattice, about the origin.

    holes, openings: all that reach into the cell, also those that its sides cut. symmetry: the part
    of it, in words of `device.mesh`, of which mirror lines make the whole. layers: those of the
    device, with the rims that reach into the cell.
    """

    lattice: Lattice
    holes: Holes
    openings: tuple[Outline, ...] = ()
    symmetry: Symmetry = "eighth"
    layers: tuple[Lamina, ...] = ()

    @property
    def points(self) -> dict[str, Array]:
        """Return the corners of the irreducible part of wave vectors.

        It is that of the lattice, or twice as large where x and y are not equivalent: there waves
        along both are solved.
        """
        found = self.lattice.points
        if self.symmetry == "quarter":
            found["Y"] = found["X"][::-1]
        return found

    @property
    def inside(self) -> Array:
        """Wave vectors (n, 2) [rad/m] within the irreducible part, evenly spread."""
        gamma, *others = self.points.values()
        found = []
        for first, second in pairwise(others):
            for i, j in combinations_with_replacement(range(1, SPREAD), 2):
                # i/SPREAD from Γ towards the opposite side, and along that
                found.append(gamma + (j * first + i * (second - first)) / SPREAD)
        return np.array(found)

    def of(self, model: Model) -> Model:
        """Return the cell as a device of the same even film, whose outline is the cell's sides."""
        corners = [(float(x), float(y)) for x, y in self.lattice.corners]
        sides = [Segment(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
        length = 2 * float(np.abs(self.lattice.corners).max())
        return replace(
            model,
            outline=Outline(CELL, tuple(sides), None, length),
            holes=self.holes,
            openings=self.openings,
            layers=self.layers,
            film=replace(model.film, gradient=(0.0, 0.0)),
            overhang=None,
            clamp=Clamp(),
        )
