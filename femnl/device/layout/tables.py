"""Closed curves as the tables of a geometry file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.core.outline import Segment
from femnl.device.geometry import curves
from femnl.device.geometry.quantities import LENGTH
from femnl.device.geometry.splines import arcs_along
from femnl.device.layout.drawing import Loop, Placed
from femnl.device.layout.recognise import circle_of, outline_of

Array = NDArray[np.float64]
Keys = dict[str, Any]

TOUCHES = 1e-6  # rad between a line and the arc that is its fillet
ROUNDED = 1e-13  # m, up to which two coordinates are alike
FEWEST = 3  # corners that a polygon is written with
SHARPEST = np.radians(150.0)  # turn of a corner that may have one
ELLIPSE_WITHIN = 1e-7  # of its longer half axis, how far arcs of circles may leave part of one


def outline_keys(loop: Loop) -> Keys:
    """Return [outline] of a loop whose box has its middle at the origin."""
    circle = circle_of(loop)
    held = all(s.clamped for s in loop)
    if circle is not None and held and np.hypot(*circle[0]) < 1e-9 * circle[1]:
        return {"kind": "circle", "diameter": written(2 * circle[1])}
    first = loop[0]
    if first.semi_axes is not None and _whole_ellipse(loop) and held:
        shape = {
            "kind": "ellipse",
            "width": written(2 * first.semi_axes[0]),
            "height": written(2 * first.semi_axes[1]),
        }
        if abs(first.angle) < 1e-9:
            return shape
        part = {"shape": shape, "angle": written_angle(first.angle)}
        return {"kind": "combined", "parts": [part]}
    return _box_keys(loop) or polygon_keys(loop)


def hole_groups(placed: Sequence[Placed], origin: Array, grid: float) -> list[Keys]:
    """Return tables [[holes]], one for each shape and size, in the order of first appearance.

    Args:
        placed: curves of the layout.
        origin: (2,) [m] of the geometry in the layout.
        grid: step of its coordinates [m].
    """
    known: dict[tuple[int, bool], tuple[Keys, Array]] = {}
    groups: dict[str, tuple[Keys, list[Array]]] = {}
    for one in placed:
        like = (id(one.loop), one.clamped)
        if like not in known:
            known[like] = _hole_keys(one)
        keys, middle = known[like]
        groups.setdefault(repr(keys), (keys, []))[1].append(one.at + middle - origin)
    return [array_keys(np.array(centres), keys, grid) for keys, centres in groups.values()]


def _hole_keys(one: Placed) -> tuple[Keys, Array]:
    """The keys of a hole's shape, and its middle (2,) from the point about which it is drawn."""
    circle = circle_of(one.loop)
    first = one.loop[0]
    keys: Keys
    if circle is not None:
        middle = circle[0]
        keys = {"radius": written(circle[1])}
    elif first.semi_axes is not None and _whole_ellipse(one.loop):
        middle = np.array(first.centre)
        keys = {"semi_axes": [written(size) for size in first.semi_axes]}
        if abs(first.angle) > 1e-9:
            keys["angle"] = written_angle(first.angle)
    else:
        x0, y0, x1, y1 = curves.box(outline_of(one.loop))
        middle = np.array([x0 + x1, y0 + y1]) / 2
        about = Placed(one.loop, -middle).there
        keys = {"shape": _box_keys(about) or polygon_keys(about)}
    if one.clamped:
        keys["clamped"] = True
    return keys, middle


def array_keys(centres: Array, keys: Keys, grid: float) -> Keys:
    """Return a group of holes at centres (n, 2) [m], as a rectangular array where they are one."""
    columns = _evenly(centres[:, 0], grid)
    rows = _evenly(centres[:, 1], grid)
    if len(centres) > 3 and columns is not None and rows is not None:
        (x, step_x, nx), (y, step_y, ny) = columns, rows
        places = {(round((a - x) / step_x * 2), round((b - y) / step_y * 2)) for a, b in centres}
        if nx * ny == len(centres) == len(places) and nx > 1 and ny > 1:
            square = abs(step_x - step_y) <= grid / 2
            pitch: Any = written(step_x) if square else [written(step_x), written(step_y)]
            keys = {
                "lattice": "square" if square else "rectangular",
                "pitch": pitch,
                "count": [nx, ny],
                **keys,
            }
            if max(abs(x), abs(y)) > 0:
                keys["offset"] = [written(x), written(y)]
            return keys
    return {"lattice": "list", "centres": [_point(c) for c in centres], **keys}


@dataclass(frozen=True)
class _Edge:
    """An edge of a polygon: its corner (2,), the fillet there, and the middle of an arc or None."""

    corner: Array
    fillet: float
    through: Array | None
    clamped: bool


def polygon_keys(loop: Loop) -> Keys:
    """Return the keys of a polygon: its points, with fillets, arcs and free edges.

    The first point is the rightmost corner, the lower one of two.
    """
    loop = _without_elliptical(loop)
    edges = _edges(_halved(loop) if len(loop) < FEWEST else loop)
    places = [(-round(e.corner[0] / ROUNDED), round(e.corner[1] / ROUNDED)) for e in edges]
    first = min(range(len(edges)), key=lambda k: places[k])
    edges = edges[first:] + edges[:first]
    keys: Keys = {"kind": "polygon", "points": [_point(e.corner) for e in edges]}
    arcs = [
        {"edge": k, "through": _point(e.through)}
        for k, e in enumerate(edges, start=1)
        if e.through is not None
    ]
    if arcs:
        keys["arcs"] = arcs
    fillets = [written(e.fillet) for e in edges]
    if any(e.fillet for e in edges):
        keys["fillet"] = fillets if len(set(fillets)) > 1 else fillets[0]
    free = [k for k, e in enumerate(edges, start=1) if not e.clamped]
    if free:
        keys["free"] = free
    return keys


def _halved(loop: Loop) -> Loop:
    """Return a loop of two arcs, or of one and a line, with a corner in the middle of each arc."""
    found: list[Segment] = []
    for segment in loop:
        if segment.centre is None:
            found.append(segment)
            continue
        x, y = curves.point_at(segment, 0.5)
        middle = (float(x), float(y))
        found += [replace(segment, end=middle), replace(segment, start=middle)]
    return tuple(found)


def _edges(segments: Loop) -> list[_Edge]:
    """The edges of a loop whose arcs that touch two lines are fillets."""
    fillets = {k for k in range(len(segments)) if _is_fillet(segments, k)}
    found = []
    for k, segment in enumerate(segments):
        if k in fillets:
            continue
        corner = np.array(segment.start)
        radius = 0.0
        if (k - 1) % len(segments) in fillets:
            corner = _corner(segments[k - 2], segment)
            radius = float(segments[k - 1].frame[0, 0])
        through = None if segment.centre is None else curves.point_at(segment, 0.5)
        found.append(_Edge(corner, radius, through, segment.clamped))
    return found


def written(length: float) -> str:
    """Return a length [m] in micrometres, to a femtometre; one below a picometre is rounding."""
    known = length if abs(length) >= LENGTH.smallest else 0.0
    number = np.format_float_positional(round(known * 1e6, 9) + 0.0, trim="-")
    return f"{number} um"


def written_angle(angle: float) -> str:
    """Return an angle [rad] in degrees."""
    return f"{np.format_float_positional(round(np.degrees(angle), 10), trim='-')} deg"


def _box_keys(loop: Loop) -> Keys | None:
    """Return the keys of a clamped square or rectangle about the origin; None for others."""
    keys = polygon_keys(tuple(replace(s, clamped=True) for s in loop))
    alike = len({s.clamped for s in loop}) == 1
    if len(keys["points"]) != 4 or "arcs" in keys or not alike:
        return None
    if isinstance(keys.get("fillet"), list):
        return None
    x0, y0, x1, y1 = curves.box(outline_of(loop))
    corners = {(written(x), written(y)) for x in (x0, x1) for y in (y0, y1)}
    centred = max(abs(x0 + x1), abs(y0 + y1)) < 1e-9 * max(x1 - x0, y1 - y0)
    if {tuple(p) for p in keys["points"]} != corners or not centred:
        return None
    if written(x1 - x0) == written(y1 - y0):
        found: Keys = {"kind": "square", "side": written(x1 - x0)}
    else:
        found = {"kind": "rectangle", "width": written(x1 - x0), "height": written(y1 - y0)}
    if "fillet" in keys:
        found["fillet"] = keys["fillet"]
    return found


def _is_fillet(segments: Loop, k: int) -> bool:
    """Whether an arc touches the lines before and after it, all three held alike."""
    before = segments[k - 1]
    arc = segments[k]
    after = segments[(k + 1) % len(segments)]
    if arc.centre is None or before.centre is not None or after.centre is not None:
        return False
    if not before.clamped == arc.clamped == after.clamped or abs(curves.turn(arc)) > SHARPEST:
        return False
    return _turn(before.direction(before.end), arc.direction(arc.start)) < TOUCHES and (
        _turn(arc.direction(arc.end), after.direction(after.start)) < TOUCHES
    )


def _turn(a: Array, b: Array) -> float:
    return abs(float(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)))


def _corner(before: Segment, after: Segment) -> Array:
    """Where the lines of two edges meet (2,)."""
    one = np.subtract(before.end, before.start)
    other = np.subtract(after.end, after.start)
    gap = np.subtract(after.start, before.end)
    along = (gap[0] * other[1] - gap[1] * other[0]) / (one[0] * other[1] - one[1] * other[0])
    return np.asarray(np.array(before.end) + along * one)


def _whole_ellipse(loop: Loop) -> bool:
    first = loop[0]
    return all(s.centre == first.centre and s.semi_axes == first.semi_axes for s in loop)


def _without_elliptical(loop: Loop) -> Loop:
    """Return a loop with arcs of circles in the place of parts of ellipses."""
    found: list[Segment] = []
    for segment in loop:
        if segment.semi_axes is None:
            found.append(segment)
            continue

        def curve(place: float, segment: Segment = segment) -> tuple[Array, Array]:
            point = curves.point_at(segment, place)
            along = segment.direction((float(point[0]), float(point[1])))
            return point, along / np.hypot(*along)

        within = ELLIPSE_WITHIN * max(segment.semi_axes)
        pieces = arcs_along(curve, 0.0, 1.0, within)
        found += [replace(piece, clamped=segment.clamped) for piece in pieces]
    return tuple(found)


def _evenly(values: Array, grid: float) -> tuple[float, float, int] | None:
    """Middle, step and number of the distinct values, where these are evenly spaced."""
    ordered = np.sort(values)
    distinct = ordered[np.append(True, np.diff(ordered) > 2 * grid)]
    if len(distinct) == 1:
        return float(distinct[0]), 0.0, 1
    middle = float(distinct[0] + distinct[-1]) / 2
    step = float(distinct[-1] - distinct[0]) / (len(distinct) - 1)
    even = distinct[0] + step * np.arange(len(distinct))
    if np.abs(distinct - even).max() > grid:
        return None
    return middle, step, len(distinct)


def _point(point: Array) -> list[str]:
    return [written(float(point[0])), written(float(point[1]))]
