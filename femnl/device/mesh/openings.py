"""Element sizes along the rims of openings of any shape."""

from collections.abc import Iterator

import gmsh
import numpy as np
import shapely

from femnl.core.device import Model
from femnl.device.geometry.openings import polygon

SEGMENTS = 12  # curved edges around a hole or opening
# The same of rims that are no circles or ellipses: where a line meets an arc the curvature jumps,
# and the error falls more slowly with the degree, measured at slots
JUMPS = 24
ACROSS = 3  # elements across a web of film between two openings, or to the outline
STEP = np.sqrt(2)  # sizes within this factor of each other count as one


def rim_sizes(
    model: Model, rims: dict[int, int], free: set[int], unit: float, largest: float
) -> Iterator[tuple[float, list[int]]]:
    """Yield element sizes along the rims of openings, and the curves that ask so.

    Free arcs ask for SEGMENTS or JUMPS a full turn of their circle; see `webs` for the rest.

    Args:
        model: the device.
        rims: gmsh's curve tags, and the opening that each is part of the rim of.
        free: tags of the curves among them that are not clamped.
        unit: of gmsh's lengths in 1 m.
        largest: element size far from everything, in gmsh's lengths.
    """
    drawn = {t for t in free if model.openings[rims[t]].kind not in ("circle", "ellipse")}
    for tags, segments in ((free - drawn, SEGMENTS), (drawn, JUMPS)):
        for radius, arcs in arcs_by_radius(sorted(tags)).items():
            yield 2 * np.pi * radius / segments, arcs
    yield from webs(model, rims, unit, largest)


def webs(
    model: Model, rims: dict[int, int], unit: float, largest: float
) -> Iterator[tuple[float, list[int]]]:
    """Yield element sizes along rims that are no circles or ellipses, and the curves that ask so.

    A rim asks for a part of its length and, towards a narrow web, for a third of the web.

    Args:
        model: the device.
        rims: gmsh's curve tags, and the opening that each is part of the rim of.
        unit: of gmsh's lengths in 1 m.
        largest: element size far from everything, in gmsh's lengths.
    """
    drawn = {k for k in rims.values() if model.openings[k].kind not in ("circle", "ellipse")}
    if not drawn:
        return
    shapes = [polygon(rim) for rim in model.openings]
    holes = shapely.points(model.holes.centres).tolist()
    everything = [*shapes, polygon(model.outline).exterior, *holes]
    radii = np.zeros(len(everything))
    radii[len(shapes) + 1 :] = model.holes.radius
    tree = shapely.STRtree(everything)
    groups: dict[int, list[int]] = {}
    for tag, k in rims.items():
        if k not in drawn:
            continue
        low, high = gmsh.model.getParametrizationBounds(1, tag)
        stops = np.linspace(low[0], high[0], 9)
        line = shapely.LineString(
            np.reshape(gmsh.model.getValue(1, tag, list(stops)), (-1, 3))[:, :2] / unit
        )
        size = min(largest, shapes[k].exterior.length * unit / JUMPS)
        near = tree.query(line, "dwithin", ACROSS * size / unit + model.holes.radius)
        others = near[near != k]
        if len(others):
            gaps = [line.distance(everything[j]) - radii[j] for j in others]
            size = min(size, min(gaps) * unit / ACROSS)
        if size < largest:
            groups.setdefault(round(np.log(size) / np.log(STEP)), []).append(tag)
    for power, tags in groups.items():
        yield float(STEP**power), tags


def arcs_by_radius(tags: list[int]) -> dict[float, list[int]]:
    """Return the arcs among gmsh's curves, by their least radius of curvature in scaled units."""
    arcs: dict[float, list[int]] = {}
    for tag in tags:
        if gmsh.model.getType(1, tag) != "Line":
            low, high = gmsh.model.getParametrizationBounds(1, tag)
            stops = np.linspace(low[0], high[0], 5)
            radius = 1 / np.max(gmsh.model.getCurvature(1, tag, list(stops)))
            arcs.setdefault(round(radius, 6), []).append(tag)
    return arcs
