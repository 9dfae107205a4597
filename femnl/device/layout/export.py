"""A GDSII or OASIS layout from a geometry."""

from pathlib import Path

import gdstk
import numpy as np
import shapely
from numpy.typing import NDArray

from femnl.core.device import Lamina, Model
from femnl.core.errors import GeometryError
from femnl.core.outline import Outline, Segment
from femnl.device.geometry import curves
from femnl.device.geometry.shapes import ellipse

Array = NDArray[np.float64]

WRITTEN = (".gds", ".oas")
LAYERS = {"film": (1, 0), "holes": (2, 0), "frame": (3, 0), "posts": (4, 0), "metal": (5, 0)}
GRIDS = (1e-9, 1e-10, 1e-11)
"""Steps of coordinates [m], of which the coarsest is taken that all corners lie on; 32-bit integers
reach to 21 mm at the finest."""
SAGITTA = 1.0
"""Steps of the coarsest grid by which a chord may leave its arc."""
LEAST = 64  # chords a turn at least
MOST_CORNERS = 8190  # that GDSII allows in a polygon
FRAME = 1e-2  # of the film's length, how wide a strip of frame is drawn at clamped edges


def export_layout(model: Model, path: Path) -> tuple[str, ...]:
    """Write the film, its holes, its posts and, at an edge free in parts, the frame that holds it.

    Layers are those of LAYERS. Arcs become chords whose corners lie on them.

    Returns:
        The option --layers with which `femnl geometry import` reads the layout back, and notes.

    Raises:
        GeometryError: an overhang, which no layer draws.
    """
    if model.overhang is not None:
        raise GeometryError(
            f"{model.name}: an overhang is made by the etch and not drawn; leave [overhang] out"
        )
    grid = model.grid or _grid(model)
    polygons = {"film": [corners(model.outline, grid)]}
    rims = {"holes": [o for o in model.openings if not o.segments[0].clamped]}
    rims["posts"] = [o for o in model.openings if o.segments[0].clamped]
    for role, found in rims.items():
        polygons[role] = [corners(rim, grid) for rim in found]
    if len(model.holes.centres):
        radius = model.holes.radius
        rim = Outline("circle", ellipse((0.0, 0.0), (radius, radius)), None, 2 * radius)
        # One shape for all, so that its place alone is rounded to the grid
        shape = corners(rim, grid)
        polygons["holes"] += [shape + _on(centre, grid) for centre in model.holes.centres]
    if any(not lamina.rims for lamina in model.layers) or len(model.layers) > 1:
        raise GeometryError(
            f"{model.name}: [layers]: a layout draws one layer, with a shape; leave the others out"
        )
    for lamina in model.layers:
        polygons["metal"] = _metal(lamina, grid)
    if not all(s.clamped for s in model.outline.segments):
        polygons["frame"] = _frame(model.outline, grid)
    library = gdstk.Library(unit=1e-6, precision=grid)
    cell = library.new_cell(model.name.replace(" ", "-"))
    for role, drawn in polygons.items():
        layer, kind = LAYERS[role]
        cell.add(*(gdstk.Polygon((p * 1e6).tolist(), layer=layer, datatype=kind) for p in drawn))
    if path.suffix.lower() == ".gds":
        library.write_gds(path, max_points=MOST_CORNERS)
    else:
        library.write_oas(path)
    used = {role: LAYERS[role] for role, drawn in polygons.items() if drawn}
    words = ",".join(f"{role}={layer}/{kind}" for role, (layer, kind) in used.items())
    return f"--layers {words}", f"grid of {grid * 1e9:g} nm"


def _metal(lamina: Lamina, grid: float) -> list[Array]:
    """The polygons that a layer covers, holes cut out along a slit."""
    whole = shapely.Polygon()
    for rim in lamina.rims:
        whole = shapely.symmetric_difference(whole, shapely.Polygon(corners(rim, grid)))
    found: list[Array] = []
    for part in shapely.get_parts(whole):
        outer = [shapely.get_coordinates(part.exterior)[:-1]]
        inner = [shapely.get_coordinates(ring)[:-1] for ring in part.interiors]
        pieces = gdstk.boolean(outer, inner, "not", precision=grid / 2) if inner else []
        found += [np.asarray(piece.points) for piece in pieces] if inner else outer
    return found


def corners(outline: Outline, grid: float) -> Array:
    """Return corners (n, 2) [m] of an outline on the grid, arcs cut into chords."""
    pieces = []
    for segment in outline.segments:
        parts = np.arange(_chords(segment)) / _chords(segment)
        pieces.append(curves.point_at(segment, parts))
    return _on(np.concatenate(pieces), grid)


def _chords(segment: Segment) -> int:
    """How many chords keep within SAGITTA of the curve."""
    if segment.centre is None:
        return 1
    largest = float(np.linalg.norm(segment.frame, 2))
    angle = min(2 * np.sqrt(2 * SAGITTA * GRIDS[0] / largest), 2 * np.pi / LEAST)
    return int(np.ceil(abs(curves.turn(segment)) / angle))


def _frame(outline: Outline, grid: float) -> list[Array]:
    """A strip outside each clamped stretch of the edge, its inner corners those of the film."""
    film = shapely.Polygon(corners(outline, grid))
    width = FRAME * outline.length
    strips = []
    for segment in outline.segments:
        if segment.clamped:
            stops = np.linspace(0, 1, _chords(segment) + 1)
            line = shapely.LineString(_on(curves.point_at(segment, stops), grid))
            # Outside alone: the inner half would reach past the film along a free neighbour
            strips.append(line.buffer(-width, single_sided=True).difference(film))
    whole = shapely.get_parts(shapely.union_all(strips))
    return [_on(shapely.get_coordinates(p.exterior)[:-1], grid) for p in whole if p.area > 0]


def _grid(model: Model) -> float:
    """The coarsest of GRIDS on which all corners and centres lie, else the finest."""
    points = [model.holes.centres, np.array([s.start for s in model.outline.segments])]
    points += [np.array([s.start for s in rim.segments]) for rim in model.openings]
    for grid in GRIDS:
        if all(np.abs(p - _on(p, grid)).max(initial=0.0) < 1e-3 * grid for p in points):
            return grid
    return GRIDS[-1]


def _on(points: Array, grid: float) -> Array:
    return np.rint(points / grid) * grid
