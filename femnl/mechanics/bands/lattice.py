"""Lattices of holes: vectors, cells, and the paths of wave vectors along which bands run."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.device import Model
from femnl.core.errors import ParameterError

Array = NDArray[np.float64]

EVEN = 1e-6  # of the pitch, to which holes must lie on their lattice


@dataclass(frozen=True)
class Lattice:
    """A lattice with one hole a cell, a row of it along x. kind: `square` or `hexagonal`.

    pitch [m]: of nearest neighbours.
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
        """Corners (turns, 2) [m] of the cell around the origin's hole, counter-clockwise."""
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

    def path(self, steps: int) -> tuple[Array, tuple[tuple[str, int], ...]]:
        """Wave vectors (n, 2) [rad/m] around the irreducible part.

        And the places of its corners among them.

        Args: steps: along the first side; the others have as many a length, at least one.
        """
        names = [*self.points, "Γ"]
        ends = np.array([self.points[name] for name in names])
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


def find_lattice(model: Model) -> Lattice:
    """The lattice on which the holes of a device lie.

    Raises: ParameterError where they lie on no square or hexagonal lattice, or are less than four.
    """
    centres = model.holes.centres
    name = model.name
    if len(centres) < 4:
        raise ParameterError(
            f"{name}: holes: {len(centres)} of them make no lattice; give a device with four or "
            "more, or a lattice"
        )
    gaps, nearest = (np.asarray(found) for found in cKDTree(centres).query(centres, k=2))
    pitch = float(gaps[:, 1].min())
    first = int(np.argmin(gaps[:, 1]))
    along = centres[nearest[first, 1]] - centres[first]
    for lattice in (Lattice("square", pitch), Lattice("hexagonal", pitch)):
        turn = np.array([[along[0], -along[1]], [along[1], along[0]]]) / pitch
        basis = turn @ lattice.steps[:2].T
        places = np.linalg.solve(basis, (centres - centres[first]).T)
        if np.abs(places - np.round(places)).max() < EVEN:
            return lattice
    raise ParameterError(
        f"{name}: holes: they lie on no square or hexagonal lattice; bands need one"
    )
