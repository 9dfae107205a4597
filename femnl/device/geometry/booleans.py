"""Unions, differences and intersections of regions bounded by lines and arcs.

GEOS finds which pieces of which curves remain, on curves cut into short chords. What remains are
the curves themselves, cut where they meet exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import brentq

from femnl.core.errors import GeometryError
from femnl.core.outline import Outline, Segment
from femnl.device.geometry import curves
from femnl.device.geometry.naming import place

Array = NDArray[np.float64]
Loop = tuple[Segment, ...]
Operation = Literal["add", "subtract", "intersect"]

CHORDS = 720
"""Chords of a full turn, at the same angles of equal circles, so that these share their chords."""
SNAP = 1e-9
"""Of the extent: points nearer to each other are one."""
TANGENT = 1e-4
"""Sine of the angle below which two curves touch rather than cross: they meet where one ends."""
FAR = 1e-3
"""Of the extent: curves that meet farther than this from where their chords meet are a mistake."""
NEWTON = 30
BESIDE = 3
"""Chords on either side of where chords meet, within which curves that nearly touch may cross."""


@dataclass(frozen=True)
class Region:
    """A connected region: its outer edge, counter-clockwise, and its holes, counter-clockwise."""

    outer: Loop
    inner: tuple[Loop, ...]


def combine(steps: Sequence[tuple[Operation, Loop]]) -> list[Region]:
    """Return what is left of loops that are added, subtracted or intersected in their order.

    Every piece keeps what its curve says of the clamp. Where two edges coincide, a clamped one
    wins.

    Raises:
        GeometryError: curves that meet where their ends do not tell the place.
    """
    extent = max(_reach(loop) for _, loop in steps)
    grid = SNAP * extent
    result = shapely.Polygon()
    operations = {
        "add": shapely.union,
        "subtract": shapely.difference,
        "intersect": shapely.intersection,
    }
    for operation, loop in steps:
        part = shapely.set_precision(shapely.Polygon(_chords(loop)), grid)
        result = operations[operation](result, part, grid_size=grid)
    sources = _sources([segment for _, loop in steps for segment in loop], grid)
    return [
        Region(
            _along(shapely.get_exterior_ring(polygon), sources, extent),
            tuple(
                _along(ring, sources, extent) for ring in map(shapely.LinearRing, polygon.interiors)
            ),
        )
        for polygon in shapely.get_parts(result)
        if polygon.geom_type == "Polygon" and polygon.area > grid * extent
    ]


@dataclass(frozen=True)
class _Sources:
    """The curves that edges of a result may be part of, found by their chords.

    start, end (n, 2) [m]: of every chord; owner (n,): the segment that it is part of.
    """

    segments: list[Segment]
    grid: float
    owner: NDArray[np.int64]
    start: Array
    end: Array
    tree: shapely.STRtree

    def of(self, edges: Array) -> NDArray[np.int64]:
        """Return which curve each edge (n, 2, 2) is part of; −1 for edges too short to tell."""
        length = np.hypot(*(edges[:, 1] - edges[:, 0]).T)
        middle = shapely.points(edges.mean(axis=1))
        edge, chord = self.tree.query(middle, "dwithin", 4 * self.grid)
        along = self.end[chord] - self.start[chord]
        along /= np.hypot(*along.T)[:, None]
        away = edges[edge] - self.start[chord][:, None]
        across = away[..., 0] * along[:, None, 1] - away[..., 1] * along[:, None, 0]
        gap = np.abs(across).max(axis=1)
        clamped = np.array([segment.clamped for segment in self.segments])[self.owner[chord]]
        # Ties go to a clamped edge: there the film ends at the clamp
        rank = gap - np.where(clamped, self.grid, 0.0)
        tells = (gap < 4 * self.grid) & (length[edge] > 8 * self.grid)
        # The best comes last, and stays
        order = np.flatnonzero(tells)[::-1]
        order = order[np.argsort(-rank[order], kind="stable")]
        found = np.full(len(edges), -1)
        found[edge[order]] = self.owner[chord[order]]
        return found


def _sources(segments: list[Segment], grid: float) -> _Sources:
    points = [_stops(segment) for segment in segments]
    owner = np.repeat(np.arange(len(segments)), [len(p) - 1 for p in points])
    start = np.concatenate([p[:-1] for p in points])
    end = np.concatenate([p[1:] for p in points])
    tree = shapely.STRtree(shapely.linestrings(np.stack([start, end], axis=1)))
    return _Sources(segments, grid, owner, start, end, tree)


def _along(ring: shapely.LinearRing, sources: _Sources, extent: float) -> Loop:
    """Return the exact curves along a ring, counter-clockwise."""
    points = shapely.get_coordinates(ring)[:-1]
    if not ring.is_ccw:
        points = points[::-1]
    edges = np.stack([points, np.roll(points, -1, axis=0)], axis=1)
    owner = sources.of(edges)
    edges = edges[owner >= 0]
    owner = owner[owner >= 0]
    first = np.flatnonzero(owner != np.roll(owner, 1))
    owner = np.roll(owner, -first[0])
    edges = np.roll(edges, -first[0], axis=0)
    first = np.flatnonzero(np.append(True, np.diff(owner) != 0))
    runs = [sources.segments[k] for k in owner[first]]
    joints = [_meeting(runs[k - 1], run, edges[first[k], 0], extent) for k, run in enumerate(runs)]
    found = []
    for k, run in enumerate(runs):
        start = joints[k]
        end = joints[(k + 1) % len(joints)]
        if np.hypot(*np.subtract(end, start)) > 8 * sources.grid:
            found.append(_directed(run, start, end, edges[first[k]]))
    return _merged(found)


def _directed(
    segment: Segment, start: tuple[float, float], end: tuple[float, float], edge: Array
) -> Segment:
    """Return the part of a curve from start to end, walked as an edge (2, 2) of it is."""
    if segment.centre is None:
        return replace(segment, start=start, end=end)
    spoke = edge[0] - segment.centre
    along = edge[1] - edge[0]
    clockwise = bool(spoke[0] * along[1] - spoke[1] * along[0] < 0)
    return replace(segment, start=start, end=end, clockwise=clockwise)


def _meeting(a: Segment, b: Segment, near: Array, extent: float) -> tuple[float, float]:
    """Return where two curves meet near a point.

    An end that both share, else by Newton's method where they cross, else the nearest end if it is
    on both, else a crossing of curves that nearly touch, else the nearest end.
    """
    ends = [np.asarray(p) for p in (a.start, a.end, b.start, b.end)]
    close = [p for p in ends if np.hypot(*(p - near)) < 4 * SNAP * extent]
    shared = [p for p in close if max(_off(a, p), _off(b, p)) < 1e-3 * SNAP * extent]
    if shared:
        return float(shared[0][0]), float(shared[0][1])
    point = near
    for _ in range(NEWTON):
        (gap_a, normal_a), (gap_b, normal_b) = _level(a, point), _level(b, point)
        if abs(normal_a[0] * normal_b[1] - normal_a[1] * normal_b[0]) < TANGENT:
            break
        step = np.linalg.solve(np.stack([normal_a, normal_b]), [gap_a, gap_b])
        point = point - step
        if np.hypot(*step) < 1e-14 * extent:
            break
    # Curves that touch meet where one of them ends
    on_both = max(_off(a, point), _off(b, point)) < SNAP * extent
    if not on_both or np.hypot(*(point - near)) > FAR * extent:
        point = min(ends, key=lambda p: float(np.hypot(*(p - near))))
        off = max(_off(a, point), _off(b, point))
        crossing = _slight_crossing(a, b, near) if off > SNAP * extent else None
        if crossing is not None:
            return float(crossing[0]), float(crossing[1])
        if off > FAR * extent:
            raise GeometryError(
                f"[outline] two curves touch without crossing near {place(near)}; let them overlap"
            )
    return float(point[0]), float(point[1])


def _slight_crossing(a: Segment, b: Segment, near: Array) -> Array | None:
    """Return where two curves that nearly touch cross nearest to a point, None where they do not.

    Between two such crossings the curves are parallel, and Newton's method has no direction.
    """
    arc, other = (b, a) if a.centre is None else (a, b)
    if arc.centre is None:
        return None
    frame, centre = arc.frame, np.asarray(arc.centre)
    x, y = np.linalg.solve(frame, near - centre)
    beside = 2 * np.pi / CHORDS * np.linspace(-BESIDE, BESIDE, 32 * BESIDE + 1)
    angles = np.arctan2(y, x) + beside

    def along(angle: float) -> Array:
        return np.asarray(centre + frame @ (np.cos(angle), np.sin(angle)))

    def level(angle: float) -> float:
        return _level(other, along(angle))[0]

    levels = np.array([level(angle) for angle in angles])
    changes = np.flatnonzero(levels[:-1] * levels[1:] < 0)
    crossings = [along(brentq(level, angles[k], angles[k + 1], xtol=1e-15)) for k in changes]
    return min(crossings, key=lambda p: float(np.hypot(*(p - near))), default=None)


def _off(segment: Segment, point: Array) -> float:
    return abs(_level(segment, point)[0])


def _level(segment: Segment, point: Array) -> tuple[float, Array]:
    """Return about how far a point (2,) is from a whole line or ellipse, and the normal (2,)."""
    if segment.centre is None:
        chord = np.subtract(segment.end, segment.start)
        normal = np.array([chord[1], -chord[0]]) / np.hypot(*chord)
        return float((point - segment.start) @ normal), normal
    inverse = np.linalg.inv(segment.frame)
    round_ = inverse @ (point - segment.centre)
    radius = float(np.hypot(*round_))
    slope = inverse.T @ round_ / radius
    size = float(np.hypot(*slope))
    return (radius - 1) / size, slope / size


def _merged(segments: list[Segment]) -> Loop:
    """Join lines that continue each other."""
    found: list[Segment] = []
    for segment in segments:
        if found and _continues(found[-1], segment):
            found[-1] = replace(found[-1], end=segment.end)
        else:
            found.append(segment)
    if len(found) > 1 and _continues(found[-1], found[0]):
        found[0] = replace(found[0], start=found.pop().start)
    return tuple(found)


def _continues(before: Segment, after: Segment) -> bool:
    if before.centre is not None or after.centre is not None or before.clamped != after.clamped:
        return False
    a = np.subtract(before.end, before.start)
    b = np.subtract(after.end, after.start)
    return bool(a @ b > 0 and abs(a[0] * b[1] - a[1] * b[0]) < 1e-6 * np.hypot(*a) * np.hypot(*b))


def _reach(loop: Loop) -> float:
    return float(np.abs(curves.polyline(Outline("", loop, None, 0.0))).max())


def _chords(loop: Loop) -> Array:
    return np.concatenate([_stops(segment)[:-1] for segment in loop])


def _stops(segment: Segment) -> Array:
    """Return points along a segment, its ends included, at fixed angles about its centre."""
    if segment.centre is None:
        return np.array([segment.start, segment.end])
    turn = curves.turn(segment)
    x, y = np.linalg.solve(segment.frame, np.subtract(segment.start, segment.centre))
    begin = float(np.arctan2(y, x))
    step = 2 * np.pi / CHORDS
    low, high = sorted((begin, begin + turn))
    angles = step * np.arange(np.ceil(low / step + 1e-6), np.floor(high / step - 1e-6) + 1)
    inside = np.sort((angles - begin) / turn)
    return curves.point_at(segment, np.concatenate([[0.0], inside, [1.0]]))
