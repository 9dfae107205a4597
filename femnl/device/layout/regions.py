"""The connected regions that the polygons of a layer cover, and what is wrong with them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from femnl.device.layout.drawing import Drawing, Fault, Loop, Placed
from femnl.device.layout.recognise import recognise

Array = NDArray[np.float64]

SMALL = 2.0
"""Steps of the grid: an edge or a width below it is rounding, and no feature."""
SLIVER = 1e-3
"""Width over length of a piece that is an accident of drawing."""


@dataclass(frozen=True)
class Drawn:
    """A connected region of a layer: its outer edge and its holes."""

    outer: Placed
    inner: tuple[Placed, ...] = ()


def faults_of(drawing: Drawing) -> list[Fault]:
    """Return what is wrong with each layer of a layout, whatever becomes of the film."""
    faults = list(drawing.faults)
    for role, polygons in drawing.polygons.items():
        seen = merged(polygons, drawing.grid)[2]
        faults += [replace(fault, what=f"{fault.what} ({role})") for fault in seen]
    return faults


def merged(polygons: Sequence[Array], grid: float) -> tuple[list[Drawn], Counter[str], list[Fault]]:
    """Return the regions that polygons (n, 2) cover together, their curves and their faults.

    A polygon may meet itself along the cut by which layouts draw holes.
    """
    whole = []
    faults: list[Fault] = []
    for corners in polygons:
        shape = shapely.Polygon(corners)
        if not shape.is_valid:
            shape = shapely.make_valid(shape, method="structure", keep_collapsed=False)
            # A cut that is walked twice leaves the area as it is, a crossing does not
            if abs(shape.area - abs(_area(corners))) > 1e-6 * shape.area:
                faults.append(Fault("self-intersection", _where_invalid(corners), True))
        whole.append(shape)
    counts: Counter[str] = Counter()
    found = []
    known: dict[bytes, tuple[Loop, Counter[str]]] = {}
    for shape in _joined(np.array(whole, dtype=object)):
        if shape.is_empty or shape.geom_type != "Polygon":  # a line that was drawn as an area
            continue
        faults += _small_features(shape, grid)
        loops = []
        for ring in (shape.exterior, *shape.interiors):
            loop, kinds = _recognised(shapely.get_coordinates(ring)[:-1], grid, known)
            loops.append(loop)
            counts += kinds
        found.append(Drawn(loops[0], tuple(loops[1:])))
    return found, counts, faults


def _joined(shapes: NDArray[np.object_]) -> NDArray[np.object_]:
    """The connected parts of the union; a shape that meets no other stays as it is."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = shapely.STRtree(shapes).query(shapes, "intersects")
    meets = coo_array((np.ones(pairs.shape[1]), pairs), shape=2 * (len(shapes),))
    _, group = connected_components(meets, directed=False)
    order = np.argsort(group, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    together = [
        shapes[members[0]] if len(members) == 1 else shapely.union_all(shapes[members])
        for members in groups
    ]
    return np.asarray(shapely.get_parts(together))


def _recognised(
    corners: Array, grid: float, known: dict[bytes, tuple[Loop, Counter[str]]]
) -> tuple[Placed, Counter[str]]:
    """Recognise a ring; rings of one shape in different places are looked at once."""
    start = int(np.lexsort(corners.T)[0])
    turned = np.roll(corners, -start, axis=0)
    if _area(turned) < 0:
        turned = np.roll(turned[::-1], 1, axis=0)
    origin = turned[0]
    steps = np.rint((turned - origin) / (1e-3 * grid)).astype(np.int64)
    key = steps.tobytes()
    if key not in known:
        known[key] = recognise(turned - origin, grid)
    loop, counts = known[key]
    return Placed(loop, origin), counts


def _small_features(shape: shapely.Polygon, grid: float) -> list[Fault]:
    """Slivers, and edges or widths that the grid does not resolve."""
    found = []
    points = shapely.get_coordinates(shape.exterior)
    x0, y0, x1, y1 = shape.bounds
    longest = max(x1 - x0, y1 - y0)
    width = 2 * shape.area / shape.length
    if width < SMALL * grid:
        found.append(
            Fault(f"feature {width * 1e9:.3g} nm wide, below the grid", _pair(points[0]), False)
        )
    elif width < SLIVER * longest:
        found.append(Fault(f"sliver {width * 1e9:.3g} nm wide", _pair(points[0]), False))
    chords = np.diff(points, axis=0)
    lengths = np.hypot(*chords.T)
    short = np.flatnonzero(lengths < SMALL * grid)
    if len(short):
        found.append(
            Fault(
                f"edge of {lengths[short[0]] * 1e9:.3g} nm, below the grid",
                _pair(points[short[0]]),
                False,
            )
        )
    return found


def _where_invalid(corners: Array) -> tuple[float, float]:
    """The point that GEOS names, in the brackets of its explanation."""
    reason = shapely.is_valid_reason(shapely.Polygon(corners))
    x, y = reason.partition("[")[2].rstrip("]").split()
    return float(x), float(y)


def _area(corners: Array) -> float:
    x, y = (corners - corners[0]).T
    return float(x @ np.roll(y, -1) - np.roll(x, -1) @ y) / 2


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
