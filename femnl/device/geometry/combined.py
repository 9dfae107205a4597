"""Outlines made of simpler shapes: unions, differences and intersections of parts."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.geometry import curves
from femnl.device.geometry.corners import fillet_where_straight
from femnl.device.geometry.naming import place
from femnl.device.geometry.placing import held, placed
from femnl.device.geometry.polygons import Polygon
from femnl.device.geometry.quantities import Angle, Depth, Position
from femnl.device.geometry.shapes import Circle, Ellipse, Rectangle, RegularPolygon, Spline, Square
from femnl.device.geometry.tables import Table

Shape = Annotated[
    Square | Rectangle | RegularPolygon | Circle | Ellipse | Polygon | Spline,
    Field(discriminator="kind"),
]
MOST_PARTS = 1000


Operation = Literal["add", "subtract", "intersect"]


class Part(Table):
    """A shape that is turned by `angle`, moved by `at`, and put to those before it.

    name: by which `free` calls its edges.
    """

    shape: Shape
    operation: Operation = "add"
    at: Position = Field(default_factory=lambda: [0.0, 0.0])
    angle: Angle = 0.0
    name: str = ""


class Combined(Table):
    """What is left of parts that are added, subtracted and intersected in their order.

    free: names of the parts at whose edges the film ends free; it is clamped at all others. Where
    a free and a clamped edge coincide, the clamp wins. fillet: the radius of every corner between
    two straight edges that are held alike.
    """

    kind: Literal["combined"]
    parts: Annotated[list[Part], Field(min_length=1, max_length=MOST_PARTS)]
    free: list[str] = Field(default_factory=list)
    fillet: Depth = 0.0

    def widened(self, width: float) -> Self:
        """Refuse: what is combined has no edge to move.

        Raises:
            GeometryError: always.
        """
        raise GeometryError(
            '[overhang] kind = "combined" has no strip of frame around it yet; leave [overhang] out'
        )

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, counter-clockwise.

        Raises:
            GeometryError: parts that leave nothing, several pieces or a piece with holes; names
            that no part has; nothing clamped.
        """
        from femnl.device.geometry.booleans import combine

        names = [part.name for part in self.parts]
        for name in self.free:
            if name not in names:
                raise GeometryError(
                    f'[outline] free = "{name}": no part has this name; write name = "{name}" in '
                    "a part"
                )
        regions = combine(steps_of(self))
        if not regions:
            raise GeometryError("[outline] parts: they leave no film; check their operations")
        if len(regions) > 1:
            where = place(np.array(regions[1].outer[0].start))
            raise GeometryError(
                f"[outline] parts: the film falls into {len(regions)} pieces, one at {where}; "
                "join them or leave the others out"
            )
        if regions[0].inner:
            where = place(np.array(regions[0].inner[0][0].start))
            raise GeometryError(
                f"[outline] parts: they leave a hole at {where}; write it as a table [[holes]]"
            )
        segments = fillet_where_straight(regions[0].outer, self.fillet)
        if not any(s.clamped for s in segments):
            raise GeometryError(
                "[outline] free names all that is left of the edge: the film hangs on nothing; "
                "leave at least one part clamped"
            )
        outline = Outline(self.kind, segments, None, 0.0)
        x0, y0, x1, y1 = curves.box(outline)
        return Outline(self.kind, segments, None, max(x1 - x0, y1 - y0))


def steps_of(table: Combined) -> list[tuple[Operation, tuple[Segment, ...]]]:
    """Return the operations of a combined shape in their order, and the curve of each part."""
    none = Holes(np.empty((0, 2)), 0.0)
    steps: list[tuple[Operation, tuple[Segment, ...]]] = []
    for part in table.parts:
        shape = placed(part.shape.outline(none), part.at, part.angle)
        if part.name in table.free:
            shape = held(shape, False)
        steps.append((part.operation, shape.segments))
    return steps
