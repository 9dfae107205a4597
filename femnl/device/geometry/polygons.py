"""Polygons of a geometry file, with arcs for edges and rounded corners."""

from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.geometry import curves
from femnl.device.geometry.corners import arc_through, loop, rounded
from femnl.device.geometry.crossings import (
    counter_clockwise,
    refuse_crossings,
    refuse_curved_crossings,
)
from femnl.device.geometry.naming import place
from femnl.device.geometry.quantities import Lengths, Position
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
        arcs = self._through()
        straight = ~np.isin(np.arange(number), [k for k, _ in arcs])
        refuse_crossings(corners, straight)
        segments = list(loop(corners, clamped))
        for k, through in arcs:
            segments[k] = _arc(k, segments[k], through)
        names = [f"point {k + 1}" for k in range(number)]
        made = rounded(tuple(segments), self._radii(), names)
        if self.arcs or np.any(self.fillet):
            refuse_curved_crossings(made, "lower fillet or move the arcs")
        length = float(np.ptp(corners, axis=0).max())
        if not self.arcs:
            return Outline(self.kind, counter_clockwise(made), None, length)
        outline = Outline(self.kind, counter_clockwise(made), None, length)
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
