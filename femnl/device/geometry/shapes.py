"""Shapes that an outline, a hole or a part of either may have, and their segments."""

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.geometry import curves
from femnl.device.geometry.corners import loop, rounded
from femnl.device.geometry.crossings import counter_clockwise, refuse_curved_crossings
from femnl.device.geometry.quantities import Depth, Length, Position
from femnl.device.geometry.splines import spline
from femnl.device.geometry.tables import Table

Array = NDArray[np.float64]


class Square(Table):
    """A square, sides along x and y, corners rounded by `fillet`."""

    kind: Literal["square"]
    side: Length
    fillet: Depth = 0.0

    def widened(self, width: float) -> Self:
        """Return the outline with every side moved outwards by `width` [m]."""
        return self.model_copy(
            update={"side": self.side + 2 * width, "fillet": _widened(self.fillet, width)}
        )

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, from the lower left corner."""
        return _rectangle(self.kind, self.side, self.side, self.fillet)


class Rectangle(Table):
    """A rectangle, width along x, height along y; its length is the longer of the two."""

    kind: Literal["rectangle"]
    width: Length
    height: Length
    fillet: Depth = 0.0

    def widened(self, width: float) -> Self:
        """Return the outline with every side moved outwards by `width` [m]."""
        return self.model_copy(
            update={
                "width": self.width + 2 * width,
                "height": self.height + 2 * width,
                "fillet": _widened(self.fillet, width),
            }
        )

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, from the lower left corner."""
        return _rectangle(self.kind, self.width, self.height, self.fillet)


class RegularPolygon(Table):
    """A regular polygon with a corner on the positive x axis.

    `long_axis` is the diameter of the circle through its corners.
    """

    kind: Literal["regular-polygon"]
    sides: Annotated[int, Field(ge=3, le=1000)]
    long_axis: Length
    fillet: Depth = 0.0

    def widened(self, width: float) -> Self:
        """Return the outline with every side moved outwards by `width` [m]."""
        return self.model_copy(
            update={
                "long_axis": self.long_axis + 2 * width / np.cos(np.pi / self.sides),
                "fillet": _widened(self.fillet, width),
            }
        )

    def outline(self, holes: Holes) -> Outline:
        """Return the outline, from the corner on the x axis."""
        angle = 2 * np.pi * np.arange(self.sides) / self.sides
        corners = self.long_axis / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return Outline(self.kind, _filleted(loop(corners), self.fillet), None, self.long_axis)


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


class Ellipse(Table):
    """An ellipse about the origin, its axes `width` along x and `height` along y."""

    kind: Literal["ellipse"]
    width: Length
    height: Length

    def widened(self, width: float) -> Self:
        """Refuse: the curve at a distance from an ellipse is none.

        Raises:
            GeometryError: always.
        """
        raise GeometryError(
            '[overhang] kind = "ellipse": a strip of even width around it does not end in an '
            "ellipse; leave [overhang] out"
        )

    def outline(self, holes: Holes) -> Outline:
        """Return four arcs, from the positive x axis."""
        arcs = ellipse((0.0, 0.0), (self.width / 2, self.height / 2))
        return Outline(self.kind, arcs, None, max(self.width, self.height))


class Spline(Table):
    """The closed smooth curve through points, in the coordinates of the file.

    points: in order, either way round.
    """

    kind: Literal["spline"]
    points: Annotated[list[Position], Field(min_length=3, max_length=1000)]

    def widened(self, width: float) -> Self:
        """Refuse: the curve at a distance from a spline is none.

        Raises:
            GeometryError: always.
        """
        raise GeometryError(
            '[overhang] kind = "spline" has no strip of frame around it; leave [overhang] out'
        )

    def outline(self, holes: Holes) -> Outline:
        """Return the arcs along the spline, counter-clockwise.

        Raises:
            GeometryError: coinciding neighbours, or a curve that crosses itself.
        """
        corners = np.array(self.points)
        segments = spline(corners)
        refuse_curved_crossings(segments, "move the points")
        turned = counter_clockwise(segments)
        x0, y0, x1, y1 = curves.box(Outline(self.kind, turned, None, 0.0))
        return Outline(self.kind, turned, None, max(x1 - x0, y1 - y0))


def ellipse(
    centre: tuple[float, float],
    semi_axes: tuple[float, float],
    angle: float = 0.0,
    clamped: bool = True,
) -> tuple[Segment, ...]:
    """Return the four quarters of an ellipse, counter-clockwise from the end of its first axis.

    Args:
        centre: (x, y) [m].
        semi_axes: half the axes [m].
        angle: of the first axis from x [rad].
        clamped: whether the film is held there.
    """
    first = semi_axes[0] * np.array([np.cos(angle), np.sin(angle)])
    second = semi_axes[1] * np.array([-np.sin(angle), np.cos(angle)])
    points = [
        (float(centre[0] + x), float(centre[1] + y)) for x, y in (first, second, -first, -second)
    ]
    axes = None if semi_axes[0] == semi_axes[1] else semi_axes
    return tuple(
        Segment(a, b, centre, clamped, axes, angle if axes else 0.0)
        for a, b in zip(points, points[1:] + points[:1], strict=True)
    )


def _rectangle(kind: str, width: float, height: float, fillet: float) -> Outline:
    corners = np.array([(-width, -height), (width, -height), (width, height), (-width, height)]) / 2
    segments = _filleted(loop(corners), fillet)
    return Outline(kind, segments, (width, height), max(width, height))


def _filleted(segments: tuple[Segment, ...], fillet: float) -> tuple[Segment, ...]:
    names = [f"corner {k + 1}" for k in range(len(segments))]
    return rounded(segments, np.full(len(segments), fillet), names)


def _widened(fillet: float, width: float) -> float:
    """The radius of a corner whose two edges move outwards; a sharp one stays sharp."""
    return fillet + width if fillet > 0 else 0.0
