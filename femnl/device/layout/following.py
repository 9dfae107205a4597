"""Where a frame that touches the film holds it.

A layout draws an arc as chords, and the curves of each layer are recognised for themselves: to cut
a film by a frame that touches it would leave slivers. Their chords tell exactly where they touch.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from femnl.core.outline import Segment
from femnl.device.geometry import curves
from femnl.device.layout.drawing import Loop

Array = NDArray[np.float64]

WITHIN = 4.0
"""Steps of the grid within which a point is on a curve that was recognised from chords."""


class Touch:
    """The parts of the edge of a film where a frame touches it, and the rest.

    Args: film and frame: corners (n, 2) [m] of their polygons; grid: step [m] of the coordinates.
    """

    def __init__(self, film: Sequence[Array], frame: Sequence[Array], grid: float) -> None:
        area, other = (_union(polygons, grid) for polygons in (film, frame))
        edge = area.boundary
        self.overlaps = shapely.intersection(area, other).area > grid * edge.length
        self.held = shapely.line_merge(_lines(shapely.intersection(edge, other.boundary)))
        self.free = shapely.line_merge(_lines(shapely.difference(edge, self.held)))
        self._within = grid

    @property
    def decides(self) -> bool:
        """Whether the frame touches the film, and takes nothing off it."""
        return not self.overlaps and not self.held.is_empty

    def marked(self, loop: Loop) -> Loop:
        """Return the edge of the film, clamped where the frame touches it and free elsewhere."""
        ends = shapely.get_coordinates(shapely.intersection(self.held, self.free))
        pieces = [piece for segment in loop for piece in _cut(segment, ends, self._within)]
        return tuple(replace(piece, clamped=self._holds(piece)) for piece in pieces)

    def _holds(self, piece: Segment) -> bool:
        middle = shapely.Point(curves.point_at(piece, 0.5))
        return self.free.is_empty or bool(self.held.distance(middle) <= self.free.distance(middle))


def _union(polygons: Sequence[Array], grid: float) -> shapely.Geometry:
    shapes = [shapely.make_valid(shapely.Polygon(corners)) for corners in polygons]
    return shapely.union_all(shapely.set_precision(shapes, grid), grid_size=grid)


def _lines(shape: shapely.Geometry) -> shapely.Geometry:
    """Return the lines of an intersection, without lone points."""
    return shapely.union_all([p for p in shapely.get_parts(shape) if p.length > 0])


def _cut(segment: Segment, points: Array, within: float) -> list[Segment]:
    """Return the pieces of a segment between those points (n, 2) [m] that lie on it."""
    found = (_place_on(segment, point, within) for point in points)
    places = sorted(place for place in found if place is not None)
    cuts = [(float(x), float(y)) for x, y in curves.point_at(segment, np.array(places))]
    corners = [segment.start, *cuts, segment.end]
    return [replace(segment, start=one, end=other) for one, other in pairwise(corners)]


def _place_on(segment: Segment, point: Array, within: float) -> float | None:
    """Return the part of a segment before a point on it; None off it and at its ends."""
    if segment.centre is None:
        along = np.subtract(segment.end, segment.start)
        place = float((point - np.array(segment.start)) @ along / (along @ along))
    else:
        ends = np.array([segment.start, point]) - np.array(segment.centre)
        start, here = np.linalg.solve(segment.frame, ends.T).T
        turn = curves.turn(segment)
        angle = np.arctan2(start[0] * here[1] - start[1] * here[0], start @ here)
        place = float(angle % np.copysign(2 * np.pi, turn) / turn)
    if not 0 < place < 1:
        return None
    near = (point, np.array(segment.start), np.array(segment.end))
    away, from_start, from_end = (
        np.hypot(*(curves.point_at(segment, place) - one)) for one in near
    )
    on_it = away < WITHIN * within and min(from_start, from_end) > WITHIN * within
    return place if on_it else None
