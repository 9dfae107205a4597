"""The kinds of outline that a geometry file may name, and their segments."""

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from femnl.core.device import Holes, Outline, Segment
from femnl.core.errors import GeometryError
from femnl.device.geometry import curves
from femnl.device.geometry.holes import Position
from femnl.device.geometry.quantities import Length
from femnl.device.geometry.scallops import union_of_discs
from femnl.device.geometry.tables import Table

Array = NDArray[np.float64]


class Square(Table):
    """A square, sides along x and y."""

    kind: Literal["square"]
    side: Length

    def widened(self, width: float) -> Self:
        """Return the outline with every side moved outwards by `width` [m]."""
        return self.model_copy(update={"side": self.side + 2 * width})

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, from the lower left corner."""
        return _rectangle(self.kind, self.side, self.side)


class Rectangle(Table):
    """A rectangle, width along x, height along y; its length is the longer of the two."""

    kind: Literal["rectangle"]
    width: Length
    height: Length

    def widened(self, width: float) -> Self:
        """Return the outline with every side moved outwards by `width` [m]."""
        return self.model_copy(
            update={"width": self.width + 2 * width, "height": self.height + 2 * width}
        )

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, from the lower left corner."""
        return _rectangle(self.kind, self.width, self.height)


class RegularPolygon(Table):
    """A regular polygon with a corner on the positive x axis.

    `long_axis` is the diameter of the circle through its corners.
    """

    kind: Literal["regular-polygon"]
    sides: Annotated[int, Field(ge=3, le=1000)]
    long_axis: Length

    def widened(self, width: float) -> Self:
        """Return the outline with every side moved outwards by `width` [m]."""
        return self.model_copy(
            update={"long_axis": self.long_axis + 2 * width / np.cos(np.pi / self.sides)}
        )

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, from the corner on the x axis."""
        angle = 2 * np.pi * np.arange(self.sides) / self.sides
        corners = self.long_axis / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return Outline(self.kind, _loop(corners), None, self.long_axis)


class Circle(Table):
    """A circle about the origin."""

    kind: Literal["circle"]
    diameter: Length

    def widened(self, width: float) -> Self:
        """Return the outline with every side moved outwards by `width` [m]."""
        return self.model_copy(update={"diameter": self.diameter + 2 * width})

    def outline(self, holes: Holes) -> Outline:
        """Return four arcs, from the positive x axis."""
        points = [
            (float(x), float(y))
            for x, y in self.diameter / 2 * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
        ]
        arcs = tuple(
            Segment(a, b, (0.0, 0.0)) for a, b in zip(points, points[1:] + points[:1], strict=True)
        )
        return Outline(self.kind, arcs, None, self.diameter)


class Polygon(Table):
    """Any simple polygon, in the coordinates of the file.

    points: corners in order, either way round. Edge k runs from point k to point k + 1, counted
    from 1, the last one back to point 1. free: the edges where the film ends free, such as the
    sides of a trampoline; all others are clamped.
    """

    kind: Literal["polygon"]
    points: Annotated[list[Position], Field(min_length=3, max_length=2000)]
    free: list[int] = Field(default_factory=list)

    def widened(self, width: float) -> Self:
        """Return the polygon with every edge moved outwards by `width` [m].

        Edges are lengthened until neighbours meet again.

        Raises:
            GeometryError: free edges, or edges so short that they vanish.
        """
        if self.free:
            raise GeometryError(
                "[overhang] an outline with free edges has no strip of frame all around; leave "
                "[overhang] or free out"
            )
        corners = np.array(self.points)
        x, y = corners.T
        along = np.roll(corners, -1, axis=0) - corners
        along /= np.hypot(*along.T)[:, None] * np.sign(
            np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
        )
        outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
        before = np.roll(outward, 1, axis=0)
        moved = (
            corners + width * (outward + before) / (1 + np.sum(outward * before, axis=1))[:, None]
        )
        if np.any(
            np.sum(
                (np.roll(moved, -1, axis=0) - moved) * (np.roll(corners, -1, axis=0) - corners),
                axis=1,
            )
            <= 0
        ):
            raise GeometryError(
                f"[overhang] width = {width * 1e6:.4g} um: an edge of the outline would vanish; "
                "lower width"
            )
        return self.model_copy(update={"points": moved.tolist()})

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, counter-clockwise from point 1.

        Raises:
            GeometryError: coinciding neighbours, edges that cross or touch, no area, edges that do
            not exist, none clamped.
        """
        corners = np.array(self.points)
        number = len(corners)
        for edge in self.free:
            if not 1 <= edge <= number:
                raise GeometryError(
                    f"[outline] free = {edge}: expected numbers of edges, from 1 to {number}"
                )
        clamped = ~np.isin(np.arange(1, number + 1), self.free)
        if not clamped.any():
            raise GeometryError(
                "[outline] free names every edge: the film hangs on nothing, leave at least one "
                "edge clamped"
            )
        _refuse_crossings(corners)
        x, y = corners.T
        if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0:
            # Walked backwards from point 1, the last edge comes first.
            corners = np.roll(corners[::-1], 1, axis=0)
            clamped = clamped[::-1]
        return Outline(
            self.kind, _loop(corners, clamped), None, float(np.ptp(corners, axis=0).max())
        )


class Etched(Table):
    """What an isotropic etch around every release hole sets free, scallops included.

    `etch_radius`: from the centre of the hole.

    Its length is the larger side of its box; a rectangular grid of holes about the origin also
    gives the box for (m,n) labels.
    """

    kind: Literal["etched"]
    etch_radius: Length

    def widened(self, width: float) -> Self:
        """Return the outline with every side moved outwards by `width` [m]."""
        return self.model_copy(update={"etch_radius": self.etch_radius + width})

    def outline(self, holes: Holes) -> Outline:
        """Return the arcs of the union of discs.

        Raises:
            GeometryError: no holes; an etch that stays inside the holes; a film in pieces or with
            pillars left under it.
        """
        if not len(holes.centres):
            raise GeometryError(
                '[outline] kind = "etched": the film is etched free around holes, write a table '
                "[holes] or another kind"
            )
        if self.etch_radius <= holes.radius:
            raise GeometryError(
                f"[outline] etch_radius = {self.etch_radius * 1e6:.4g} um: expected more than "
                "the radius of the holes, "
                f"{holes.radius * 1e6:.4g} um, as it counts from their centres"
            )
        arcs = union_of_discs(holes, self.etch_radius)
        x0, y0, x1, y1 = curves.box(Outline(self.kind, arcs, None, 0.0))
        size = (
            (x1 - x0, y1 - y0) if _is_centred_grid(holes.centres, 1e-6 * self.etch_radius) else None
        )
        return Outline(self.kind, arcs, size, max(x1 - x0, y1 - y0))


OutlineTable = Annotated[
    Square | Rectangle | RegularPolygon | Circle | Polygon | Etched, Field(discriminator="kind")
]


def _rectangle(kind: str, width: float, height: float) -> Outline:
    corners = np.array([(-width, -height), (width, -height), (width, height), (-width, height)]) / 2
    return Outline(kind, _loop(corners), (width, height), max(width, height))


def _loop(corners: Array, clamped: ArrayLike = True) -> tuple[Segment, ...]:
    """Return the closed polygon through corners (n, 2)."""
    points = [(float(x), float(y)) for x, y in corners]
    held = np.broadcast_to(clamped, len(points))
    return tuple(
        Segment(a, b, None, bool(c))
        for a, b, c in zip(points, points[1:] + points[:1], held, strict=True)
    )


def _is_centred_grid(centres: Array, tolerance: float) -> bool:
    """Return whether the centres fill a grid of rows and columns whose middle is the origin."""
    columns, rows = (len(np.unique(np.rint(centres[:, axis] / tolerance))) for axis in (0, 1))
    middle = np.abs(centres.min(axis=0) + centres.max(axis=0)).max() / 2
    return columns * rows == len(centres) and bool(middle < tolerance)


def _refuse_crossings(corners: Array) -> None:
    """Refuse a polygon with edges of no length, or edges that meet away from corners."""
    number = len(corners)
    extent = np.ptp(corners, axis=0).max()
    ends = np.roll(corners, -1, axis=0)
    short = np.flatnonzero(np.hypot(*(ends - corners).T) <= 1e-9 * extent)
    if len(short):
        k = int(short[0])
        hint = (
            "the outline closes by itself, leave the last point out"
            if k == number - 1
            else "leave one of them out"
        )
        raise GeometryError(f"[outline] points {k + 1} and {(k + 1) % number + 1} coincide: {hint}")
    for k in range(number):
        chord = ends[k] - corners[k]
        # The neighbour on either side shares a corner, and must only not fold back onto this edge.
        after = ends[(k + 1) % number] - ends[k]
        if chord @ after < 0 and abs(_cross(chord, after)) <= 1e-9 * np.hypot(*chord) * np.hypot(
            *after
        ):
            raise GeometryError(
                f"[outline] points: edge {(k + 1) % number + 1} folds back onto edge {k + 1}; "
                "give the corners in order"
            )
        others = np.arange(k + 2, number - (k == 0))
        meets = others[_meet(corners[k], ends[k], corners[others], ends[others], 1e-12 * extent**2)]
        if len(meets):
            raise GeometryError(
                f"[outline] points: edges {k + 1} and {int(meets[0]) + 1} cross or touch; give "
                "the corners in order"
            )


def _meet(a: Array, b: Array, c: Array, d: Array, tolerance: float) -> NDArray[np.bool_]:
    """Return which of the segments c–d (n, 2) cross or touch the segment a–b.

    Twice the areas below `tolerance` count as 0.
    """
    sides = [_cross(b - a, c - a), _cross(b - a, d - a), _cross(d - c, a - c), _cross(d - c, b - c)]
    c_side, d_side, a_side, b_side = (
        np.where(np.abs(s) <= tolerance, 0, np.sign(s)) for s in sides
    )
    boxes = np.all(
        (np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b)), axis=1
    )
    return np.asarray((c_side * d_side <= 0) & (a_side * b_side <= 0) & boxes)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
