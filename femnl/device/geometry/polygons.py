"""Polygons of a geometry file, with arcs for edges and rounded corners."""

from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from femnl.core.device import Holes, Outline, Segment
from femnl.core.errors import GeometryError
from femnl.device.geometry import curves
from femnl.device.geometry.corners import arc_through, loop, rounded
from femnl.device.geometry.holes import Position, place
from femnl.device.geometry.quantities import Lengths
from femnl.device.geometry.tables import Table

Array = NDArray[np.float64]


class Arc(Table):
    """An edge of a polygon that is an arc of a circle, `through` a point between its ends."""

    edge: int
    through: Position


class Polygon(Table):
    """Any simple polygon, in the coordinates of the file.

    points: corners in order, either way round. Edge k runs from point k to point k + 1, counted
    from 1, the last one back to point 1. free: the edges where the film ends free, such as the
    sides of a trampoline; all others are clamped. arcs: the edges that are no straight lines.
    fillet: the radius of every corner, or of each in the order of the points.
    """

    kind: Literal["polygon"]
    points: Annotated[list[Position], Field(min_length=3, max_length=2000)]
    free: list[int] = Field(default_factory=list)
    arcs: list[Arc] = Field(default_factory=list)
    fillet: Lengths = 0.0

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
        if self.arcs or np.any(self.fillet):
            raise GeometryError(
                "[overhang] a polygon with arcs or fillets has no strip of frame around it yet; "
                "leave [overhang] out"
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
        segments = list(loop(corners, clamped))
        for k, through in self._through():
            segments[k] = _arc(k, segments[k], through)
        names = [f"point {k + 1}" for k in range(number)]
        made = rounded(tuple(segments), self._radii(), names)
        if self.arcs or np.any(self.fillet):
            _refuse_curved_crossings(made)
        length = float(np.ptp(corners, axis=0).max())
        if not self.arcs:
            return Outline(self.kind, _counter_clockwise(made), None, length)
        outline = Outline(self.kind, _counter_clockwise(made), None, length)
        x0, y0, x1, y1 = curves.box(outline)
        return replace(outline, length=max(x1 - x0, y1 - y0))

    def _radii(self) -> Array:
        """Radii of the fillets [m] by point."""
        if isinstance(self.fillet, list) and len(self.fillet) != len(self.points):
            raise GeometryError(
                f"[outline] fillet: {len(self.fillet)} radii for {len(self.points)} points; give "
                "one a point, or one for all"
            )
        return np.broadcast_to(self.fillet, len(self.points))

    def _through(self) -> list[tuple[int, Array]]:
        """Edges that are arcs, counted from 0, and the points that they run through."""
        numbers = [arc.edge for arc in self.arcs]
        for edge in numbers:
            if not 1 <= edge <= len(self.points):
                raise GeometryError(
                    f"[outline] arcs: edge = {edge}: expected the number of an edge, from 1 to "
                    f"{len(self.points)}"
                )
            if numbers.count(edge) > 1:
                raise GeometryError(
                    f"[outline] arcs: edge = {edge} stands twice; give one arc an edge"
                )
        return [(arc.edge - 1, np.array(arc.through)) for arc in self.arcs]


def _arc(number: int, edge: Segment, through: Array) -> Segment:
    try:
        return arc_through(np.array(edge.start), through, np.array(edge.end), edge.clamped)
    except GeometryError as error:
        raise GeometryError(
            f"[outline] arcs: edge = {number + 1}: through = {place(through)} {error}"
        ) from None


def _counter_clockwise(segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
    """Return the segments walked the way round that encloses an area, from the same point."""
    if curves.area(Outline("", segments, None, 0.0)) > 0:
        return segments
    return tuple(
        replace(s, start=s.end, end=s.start, clockwise=s.centre is not None and not s.clockwise)
        for s in segments[::-1]
    )


def _refuse_curved_crossings(segments: tuple[Segment, ...]) -> None:
    """Refuse arcs that meet another edge away from their ends, as far as 2° of an arc show."""
    pieces = [
        curves.point_at(s, np.linspace(0, 1, 2 + int(abs(curves.turn(s)) / np.radians(2))))
        for s in segments
    ]
    starts = np.concatenate([p[:-1] for p in pieces])
    ends = np.concatenate([p[1:] for p in pieces])
    number = len(starts)
    tolerance = 1e-12 * np.ptp(starts, axis=0).max() ** 2
    for k in range(number):
        others = np.arange(k + 2, number - (k == 0))
        meets = others[_meet(starts[k], ends[k], starts[others], ends[others], tolerance)]
        if len(meets):
            raise GeometryError(
                f"[outline] its edges cross or touch near {place(np.round(starts[k], 9))}; lower "
                "fillet or move the arcs"
            )


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
