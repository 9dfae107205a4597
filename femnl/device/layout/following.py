"""Where a frame that touches the film holds it.

A layout draws an arc as chords, and the curves of each layer are recognised for themselves: to cut
a film by a frame that touches it would leave slivers. Their chords tell where they touch, to a few
steps of the grid.
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

NEAR = 2.0
"""Steps of the grid up to which a frame touches the film: both have rounded corners."""
WITHIN = 6.0
"""Steps of the grid within which a point is on a curve that was recognised from chords."""


class Touch:
    """The parts of the edge of a film where a frame touches it, and the rest.

    Args: film and frame: corners (n, 2) [m] of their polygons; grid: step [m] of the coordinates.
    """

    def __init__(self, film: Sequence[Array], frame: Sequence[Array], grid: float) -> None:
        area, other = (_union(polygons, grid) for polygons in (film, frame))
        edge, inner = _rings(area)
        near = other.buffer(NEAR * grid)
        # Rounding moves an edge by a step of the grid at most
        self._overlaps = not shapely.intersection(area, other).buffer(-grid).is_empty
        self._inside = inner.intersects(near)
        self.held = _long(shapely.intersection(edge, near), WITHIN * grid)
        self.free = _long(shapely.difference(edge, near), WITHIN * grid)
        self._grid = grid

    @property
    def decides(self) -> bool:
        """Whether the frame touches the outer edge of the film alone, and takes nothing off it."""
        return not (self._overlaps or self._inside or self.held.is_empty)

    def marked(self, loop: Loop) -> Loop:
        """Return the edge of the film, clamped where the frame touches it and free elsewhere."""
        ends = _ends(self.held)
        pieces = [piece for segment in loop for piece in _cut(segment, ends, self._grid)]
        return tuple(replace(piece, clamped=self._holds(piece)) for piece in pieces)

    def _holds(self, piece: Segment) -> bool:
        middle = shapely.Point(curves.point_at(piece, 0.5))
        return self.free.is_empty or bool(self.held.distance(middle) <= self.free.distance(middle))


def _union(polygons: Sequence[Array], grid: float) -> shapely.Geometry:
    shapes = [shapely.make_valid(shapely.Polygon(corners)) for corners in polygons]
    return shapely.union_all(shapely.set_precision(shapes, grid), grid_size=grid)


def _rings(area: shapely.Geometry) -> tuple[shapely.Geometry, shapely.Geometry]:
    """Return the outer edges of a region, and its inner ones."""
    polygons = [part for part in shapely.get_parts(area) if part.geom_type == "Polygon"]
    outer = shapely.union_all([polygon.exterior for polygon in polygons])
    return outer, shapely.union_all([ring for polygon in polygons for ring in polygon.interiors])


def _long(shape: shapely.Geometry, least: float) -> shapely.Geometry:
    """Return the lines of a shape that are longer than that [m], joined where they meet."""
    joined = shapely.get_parts(shapely.line_merge(shapely.union_all(shapely.get_parts(shape))))
    return shapely.union_all([line for line in joined if line.length > least])


def _ends(lines: shapely.Geometry) -> Array:
    """Return where lines begin and end (n, 2) [m]."""
    found = [shapely.get_coordinates(line)[[0, -1]] for line in shapely.get_parts(lines)]
    return np.concatenate(found) if found else np.empty((0, 2))


def _cut(segment: Segment, points: Array, grid: float) -> list[Segment]:
    """Return the pieces of a segment between those points (n, 2) [m] that lie on it.

    Args: grid: step [m] of the coordinates.
    """
    found = (_place_on(segment, point, grid) for point in points)
    places = sorted(place for place in found if place is not None)
    cuts = [(float(x), float(y)) for x, y in curves.point_at(segment, np.array(places))]
    corners = [segment.start, *cuts, segment.end]
    return [replace(segment, start=one, end=other) for one, other in pairwise(corners)]


def _place_on(segment: Segment, point: Array, grid: float) -> float | None:
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
    on_it = away < WITHIN * grid and min(from_start, from_end) > WITHIN * grid
    return place if on_it else None
