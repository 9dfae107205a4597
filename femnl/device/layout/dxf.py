"""DXF through ezdxf."""

import logging
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
from ezdxf import units
from ezdxf.entities import (
    Arc,
    ArcEdge,
    Circle,
    Ellipse,
    EllipseEdge,
    Line,
    LineEdge,
    LWPolyline,
    PolylinePath,
    Spline,
)
from numpy.typing import NDArray

from femnl.core.errors import GeometryError, one_line, suggest
from femnl.core.outline import Segment
from femnl.device.geometry.corners import arc_through
from femnl.device.geometry.quantities import LENGTH, to_si
from femnl.device.geometry.shapes import ellipse
from femnl.device.geometry.splines import arcs_along
from femnl.device.layout.chains import GRID, closed, meet, reverse
from femnl.device.layout.drawing import Drawing, Loop

Array = NDArray[np.float64]

DRAWN = {"LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE"}
FILLED = {"HATCH", "MPOLYGON"}
LETTERING = {"TEXT", "MTEXT", "DIMENSION", "LEADER", "MULTILEADER", "POINT", "ATTDEF", "VIEWPORT"}
FLAT = 1e-9  # what the normal of a hatch may lack of upright
MIRRORED = ezdxf.math.Matrix44.scale(-1.0, 1.0, 1.0)
"""What a plane seen from below does to x, by DXF's arbitrary axis algorithm."""
FULL = 360 - 1e-9  # degrees of an arc that is a circle
WITHIN = GRID  # m, how far arcs may leave a spline


def read(path: Path, cell: str | None, layers: Mapping[str, str], unit: str | None) -> Drawing:
    """Read lines, arcs, circles, ellipses, splines and polylines; see `readers.read_drawing`.

    The borders of hatches are read on a layer that has nothing else: beside drawn lines they mostly
    fill these.
    """
    try:
        document = ezdxf.readfile(path)
    except (OSError, ezdxf.DXFError, UnicodeDecodeError, StopIteration) as error:
        raise GeometryError(one_line(f"{path}: not a whole DXF file; export it again")) from error
    size = _unit(path, document.units, unit)
    space: Any = document.modelspace()
    if cell is not None:
        names = [block.name for block in document.blocks if not block.name.startswith("*")]
        if cell not in names:
            raise GeometryError(one_line(f"{path}: no block {cell}; {suggest(cell, names)}"))
        space = document.blocks[cell]
    entities = list(_flat(space))
    drawn = [e for e in entities if e.dxftype() in DRAWN]
    filled = [e for e in entities if e.dxftype() in FILLED]
    polygons = {}
    loops = {}
    faults = []
    for role, layer in layers.items():
        _tell_what_is_not_read(path, layer, [e for e in entities if _on(layer, e)])
        lines, hatches = ([e for e in kinds if _on(layer, e)] for kinds in (drawn, filled))
        if lines and hatches:
            logging.getLogger("femnl").warning(
                "%s: layer %s (%s): its hatches (%d) are left out, as they fill what lines bound; "
                "draw the border of any that do not",
                path,
                layer,
                role,
                len(hatches),
            )
        pieces = [p for e in lines or hatches for p in _pieces(e, size)]
        if not pieces:
            known = sorted({e.dxf.layer for e in drawn + filled})
            raise GeometryError(
                one_line(
                    f"{path}: layer {layer} ({role}) is empty; expected one of {', '.join(known)}"
                )
            )
        polygons[role], loops[role], seen = closed(pieces, f"layer {layer} ({role})")
        faults += seen
    return Drawing(cell or path.stem, GRID, polygons, loops, tuple(faults))


def _on(layer: str, entity: Any) -> bool:
    """Whether an entity is on a layer, of whose name DXF heeds no case."""
    return str(entity.dxf.layer).casefold() == layer.casefold()


def _tell_what_is_not_read(path: Path, layer: str, entities: list[Any]) -> None:
    """Warn of shapes of a layer that are not read, and of widths of its polylines."""
    other = {e.dxftype() for e in entities} - DRAWN - FILLED - LETTERING
    if other:
        logging.getLogger("femnl").warning(
            "%s: layer %s: %s are not read and left out; draw them as polylines",
            path,
            layer,
            " and ".join(sorted(other)),
        )
    if any(e.dxftype() == "LWPOLYLINE" and e.has_width for e in entities):
        logging.getLogger("femnl").warning(
            "%s: layer %s: polylines have a width, which is not read; draw the border of what they "
            "cover",
            path,
            layer,
        )


def _unit(path: Path, known: int, unit: str | None) -> float:
    """The length [m] of the drawing's unit."""
    if known and unit is not None:
        raise GeometryError(one_line(f"{path}: this file names its unit; leave --unit out"))
    if known:
        try:
            return float(
                units.conversion_factor(
                    ezdxf.enums.InsertUnits(known), ezdxf.enums.InsertUnits.Meters
                )
            )
        except (TypeError, ValueError):
            raise GeometryError(
                one_line(f"{path}: $INSUNITS = {known} is no unit that is read; save it in mm")
            ) from None
    if unit is None:
        raise GeometryError(one_line(f"{path}: names no unit; give one, such as --unit um"))
    return to_si(f"1 {unit}", LENGTH)


def _flat(drawn: Any) -> Iterator[Any]:
    """Entities, those of inserted blocks in their places.

    What a block has on layer 0 is on the layer of its insertion.
    """
    for entity in drawn:
        if entity.dxftype() == "INSERT":
            for one in entity.multi_insert() if entity.mcount > 1 else [entity]:
                for inner in _flat(one.virtual_entities()):
                    if inner.dxf.layer == "0":
                        inner.dxf.layer = entity.dxf.layer
                    yield inner
        else:
            yield entity


def _pieces(entity: Any, size: float) -> list[Loop]:
    """An entity as chains of lines and arcs [m]."""
    kind = entity.dxftype()
    if kind in FILLED:
        if abs(entity.dxf.extrusion.z) < 1 - FLAT:
            raise GeometryError(
                f"layer {entity.dxf.layer}: a hatch is drawn on a tilted plane; draw its border"
            )
        edges = [edge for border in entity.paths for edge in _bordering(border)]
        if entity.dxf.extrusion.z < 0:  # seen from below, as in a mirrored block
            edges = [edge.transform(MIRRORED) for edge in edges]
        return [piece for edge in edges for piece in _pieces(edge, size)]
    if kind in ("LWPOLYLINE", "POLYLINE"):
        parts = [s for part in entity.virtual_entities() for s in _pieces(part, size)[0]]
        # Closed ones may repeat their first corner
        chain = _in_line([s for s in parts if s.start != s.end])
        return [chain] if chain else []
    if kind == "LINE":
        return [(Segment(_at(entity.dxf.start, size), _at(entity.dxf.end, size)),)]
    if kind == "CIRCLE":
        centre = entity.ocs().to_wcs(entity.dxf.center)
        radius = entity.dxf.radius * size
        return [ellipse(_at(centre, size), (radius, radius))]
    if kind == "ARC":
        return [(_arc(entity, size),)]
    if kind == "ELLIPSE" and abs(entity.dxf.end_param - entity.dxf.start_param) > 2 * np.pi - 1e-9:
        major = entity.dxf.major_axis
        longer = float(np.hypot(major.x, major.y)) * size
        axes = (longer, longer * entity.dxf.ratio)
        return [ellipse(_at(entity.dxf.center, size), axes, float(np.arctan2(major.y, major.x)))]
    return [_smooth(entity.construction_tool(), size)]


def _in_line(parts: list[Segment]) -> Loop:
    """Return parts of a polyline from its start to its end; arcs may come the other way round."""
    chain = parts[:1]
    for part in parts[1:]:
        if len(chain) == 1 and not _touch(chain[0].end, part):
            chain = list(reverse(tuple(chain)))
        turned = not meet(chain[-1].end, part.start) and meet(chain[-1].end, part.end)
        chain += reverse((part,)) if turned else (part,)
    return tuple(chain)


def _touch(point: tuple[float, float], part: Segment) -> bool:
    return meet(point, part.start) or meet(point, part.end)


def _bordering(border: Any) -> list[Any]:
    """The border of a hatch as the entities that draw it."""
    if isinstance(border, PolylinePath):
        line = LWPolyline.new()
        line.set_points(border.vertices, format="xyb")
        line.closed = True
        return [line]
    return [_edge(edge) for edge in border.edges]


def _edge(edge: Any) -> Any:
    """An edge of the border of a hatch as the entity that draws it."""
    if isinstance(edge, LineEdge):
        return Line.new(dxfattribs={"start": edge.start, "end": edge.end})
    if isinstance(edge, ArcEdge):
        round_ = {"center": edge.center, "radius": edge.radius}
        if abs(edge.end_angle - edge.start_angle) >= FULL:
            return Circle.new(dxfattribs=round_)
        angles = {"start_angle": edge.start_angle, "end_angle": edge.end_angle}
        return Arc.new(dxfattribs=round_ | angles)
    if isinstance(edge, EllipseEdge):
        shape = edge.construction_tool().dxfattribs()
        if abs(edge.end_angle - edge.start_angle) >= FULL:
            shape |= {"start_param": 0.0, "end_param": 2 * np.pi}
        return Ellipse.new(dxfattribs=shape)
    spline = Spline.new()
    if edge.control_points:
        spline.apply_construction_tool(edge.construction_tool())
    else:
        spline.fit_points = edge.fit_points
    return spline


def _arc(entity: Any, size: float) -> Segment:
    """An arc, which may be mirrored by its plane."""
    begin = np.radians(entity.dxf.start_angle)
    turn = (np.radians(entity.dxf.end_angle) - begin) % (2 * np.pi)
    ocs = entity.ocs()
    points = []
    for part in (0.0, 0.5, 1.0):
        angle = begin + part * turn
        spoke = entity.dxf.radius * np.array([np.cos(angle), np.sin(angle)])
        x, y, _ = entity.dxf.center
        points.append(np.array(_at(ocs.to_wcs((x + spoke[0], y + spoke[1], 0.0)), size)))
    return arc_through(points[0], points[1], points[2], True)


def _smooth(tool: Any, size: float) -> Loop:
    """Arcs along a spline, or along part of an ellipse."""
    spline = tool if hasattr(tool, "derivatives") else ezdxf.math.BSpline.from_ellipse(tool)

    def curve(place: float) -> tuple[Array, Array]:
        point, slope = next(iter(spline.derivatives([place], 1)))
        along = np.array([slope.x, slope.y])
        return np.array([point.x, point.y]) * size, along / np.hypot(*along)

    # A closed spline may have knots beyond its ends
    ends = spline.degree
    knots = np.unique(spline.knots()[ends : len(spline.knots()) - ends])
    pieces: list[Segment] = []
    for low, high in pairwise(knots):
        pieces += arcs_along(curve, float(low), float(high), WITHIN)
    return tuple(pieces)


def _at(point: Any, size: float) -> tuple[float, float]:
    return float(point[0]) * size, float(point[1]) * size
