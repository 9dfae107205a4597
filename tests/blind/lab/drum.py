"""Shapes of the film with holes at any point of it, from the nodes of `holes`.

Splines from each hole outwards and along its cell.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline, make_interp_spline
from scipy.spatial import cKDTree

from tests.blind.lab.bench import Array
from tests.blind.lab.film import Membrane
from tests.blind.lab.holes import (
    AROUND,
    COUNT,
    OUTWARDS,
    PITCH,
    RADIUS,
    SIDE,
    cell,
    kept,
    rings,
    shapes,
)

MODES = 12
CUBIC = 3
SECTORS = 8
"""Parts of a cell between which lines of the mesh have kinks: each side of its boundary has one in
its middle, too.
"""
RIM = 1e-6
"""Distance [m] from a hole up to which nothing is read: part of the spot is over it."""


@dataclass(frozen=True)
class Drum(Membrane):
    """The film with its holes.

    splines: of the lowest modes, from the hole outwards and along the boundary, in each sector of
    each cell.
    """

    splines: tuple[NdBSpline, ...]

    def at(self, x: Array, y: Array, count: int | None = None) -> Array:
        """Return the lowest modes at points (n,), 0 over holes and beyond the film, (count, n)."""
        found = np.zeros((len(x), count or MODES))
        column, row = (
            np.clip(np.floor(v / PITCH + COUNT / 2), 0, COUNT - 1).astype(np.int64) for v in (x, y)
        )
        u, v = (here - (n - (COUNT - 1) / 2) * PITCH for here, n in ((x, column), (y, row)))
        a, b = (self._outwards(here, n) for here, n in ((u, column), (v, row)))
        # Of which the cell's boundary is at 1
        out = np.maximum(np.maximum(np.abs(a), np.abs(b)), 1e-300)
        across = np.abs(a) >= np.abs(b)
        side = np.where(across, np.where(a > 0, 0, 2), np.where(b > 0, 1, 3))
        t = np.choose(side, [b, -a, -b, a]) / out
        r = np.hypot(u, v)
        s = (r - RADIUS) / (r / out - RADIUS)
        on = (
            (s >= 0)
            & (out <= 1 + 1e-12)
            & (np.abs(x) <= self.inner[0] / 2)
            & (np.abs(y) <= self.inner[1] / 2)
        )
        place = (column * COUNT + row) * SECTORS + 2 * side + (t >= 0)
        for k in np.unique(place[on]):
            here = np.flatnonzero(on & (place == k))
            found[here] = self.splines[k](np.stack([s[here], t[here]], axis=1))[:, : found.shape[1]]
        return found.T

    def over_hole(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Whether points lie over a hole or on its rim."""
        near = [
            v
            - (np.clip(np.round(v / PITCH + (COUNT - 1) / 2), 0, COUNT - 1) - (COUNT - 1) / 2)
            * PITCH
            for v in (x, y)
        ]
        return np.asarray(np.hypot(*near) < RADIUS + RIM)

    def _outwards(self, here: Array, n: NDArray[np.int64]) -> Array:
        """Distance from a cell's centre along one axis, in units of that of its boundary."""
        margin = self.inner[0] / 2 - COUNT * PITCH / 2
        far = PITCH / 2 + margin * np.where(here < 0, n == 0, n == COUNT - 1)
        return np.asarray(here / far)


@cache
def drum(layer: float) -> Drum:
    """The film, smaller by `layer` [m] on every side."""
    side = SIDE - 2 * layer
    known = kept(f"shapes-{1e9 * layer:.2f}", lambda: shapes(side, MODES))
    tree = cKDTree(known["nodes"].T)
    per = AROUND // SECTORS
    s = rings(OUTWARDS)
    t = np.linspace(-1, 1, 2 * per + 1)
    splines = []
    for column, row in product(range(COUNT), repeat=2):
        points = cell(column, row, AROUND, OUTWARDS, side)
        _, node = tree.query(points.reshape(2, -1).T)
        values = known["shapes"][node].reshape(OUTWARDS + 1, AROUND, MODES)
        values = np.concatenate([values, values[:, :1]], axis=1)  # all around
        for k in range(SECTORS):
            half = slice(k % 2 * per, k % 2 * per + per + 1)
            splines.append(_spline(s, t[half], values[:, k * per : (k + 1) * per + 1]))
    each = np.diag(known["square"]) / (2 * side**2)  # along x and along y
    return Drum(
        slopes=(each, each, np.zeros_like(each)),
        area=float(known["area"]) * side**2,
        half=SIDE / 2,
        orders=np.empty((0, 2), np.int64),
        inner=(side, side),
        space=None,
        splines=tuple(splines),
    )


def _spline(s: Array, t: Array, values: Array) -> NdBSpline:
    """Cubic in both directions, (n_s, n_t, n_modes)."""
    out = make_interp_spline(s, values, CUBIC)
    along = make_interp_spline(t, out.c.swapaxes(0, 1), CUBIC)
    return NdBSpline((out.t, along.t), np.ascontiguousarray(along.c.swapaxes(0, 1)), CUBIC)
