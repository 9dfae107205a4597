"""The surface of a film, as gmsh draws it from a geometry."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import gmsh
import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.core.outline import Segment
from femnl.device.geometry import curves as exact
from femnl.device.geometry.shapes import ellipse
from femnl.device.mesh.grading import SCALE
from femnl.device.mesh.kernel import kernel_of
from femnl.device.mesh.symmetry import FULL, HALF, beyond_mirrors

Array = NDArray[np.float64]


def draw_film(model: Model, wedge: float, unit: float) -> dict[int, int | None]:
    """Draw the film's surface; return on the rim of which opening curves lie, where that is known.

    None stands for a round hole.

    Edge, cut to the wedge, minus the holes that reach into it, split along the outline, one
    operation each. Holes and openings of a whole film are its inner edges, which need no operation:
    a geometry has none that meet.
    """
    kernel = kernel_of(model, wedge)
    known: dict[int, int | None] = {}
    loops = [_loop(model.edge_outline.segments, unit, kernel)]
    if wedge == FULL:
        for index, lines in _inner_edges(model, unit, kernel):
            loops.append(lines)
            known |= dict.fromkeys(lines, index)
    film = [(2, kernel.addPlaneSurface([kernel.addCurveLoop(lines) for lines in loops]))]
    if kernel is not gmsh.model.occ:
        kernel.synchronize()
        return known
    occ = kernel
    if wedge < FULL:
        film, _ = occ.intersect(film, [(2, _wedge_surface(wedge))])
        reaching = _reaching_into(model, wedge, unit)
        if reaching:
            film, _ = occ.cut(film, reaching)
    between = [] if model.overhang is None else [model.outline]
    between += [rim for lamina in model.layers for rim in lamina.rims]
    across = [(1, line) for rim in between for line in _loop(rim.segments, unit, occ)]
    if across:
        occ.fragment(film, across)
    occ.synchronize()
    # Curves beyond the wedge, and the centres of arcs, bound nothing
    if across:
        faces = gmsh.model.getEntities(2)
        bounding = {tag for _, tag in gmsh.model.getBoundary(faces, combined=False, oriented=False)}
        occ.remove(
            [(1, tag) for _, tag in gmsh.model.getEntities(1) if tag not in bounding],
            recursive=True,
        )
        occ.synchronize()
    # Operations number curves anew
    return {} if across else known


def _inner_edges(model: Model, unit: float, kernel: Any) -> Iterator[tuple[int | None, list[int]]]:
    """Yield the curves of each hole with None, and of each opening with its index."""
    radius = model.holes.radius
    for x, y in model.holes.centres:
        yield None, _loop(ellipse((x, y), (radius, radius)), unit, kernel)
    for index, opening in enumerate(model.openings):
        yield index, _loop(opening.segments, unit, kernel)


def _reaching_into(model: Model, wedge: float, unit: float) -> list[tuple[int, int]]:
    """Return surfaces of the holes and openings that reach into a wedge."""
    occ = gmsh.model.occ
    near = model.holes.centres[beyond_mirrors(model.holes.centres, wedge) < model.holes.radius]
    radius = model.holes.radius * unit
    inner = [o for o in model.openings if np.any(beyond_mirrors(exact.polyline(o), wedge) < 0)]
    return [(2, occ.addDisk(x * unit, y * unit, 0, radius, radius)) for x, y in near] + [
        (2, occ.addPlaneSurface([occ.addCurveLoop(_loop(o.segments, unit, occ))])) for o in inner
    ]


def _loop(segments: tuple[Segment, ...], unit: float, kernel: Any) -> list[int]:
    """Return gmsh's curves of consecutive segments, arcs in pieces of a quarter turn at most."""
    # Of one loop alone: gmsh forgets the points of what it has cut
    points: dict[tuple[float, float], int] = {}

    def point(xy: Array | tuple[float, float]) -> int:
        x, y = (round(float(value) * unit, 9) for value in xy)
        if (x, y) not in points:
            points[x, y] = kernel.addPoint(x, y, 0)
        return points[x, y]

    lines = []
    for s in segments:
        if s.centre is None:
            lines.append(kernel.addLine(point(s.start), point(s.end)))
            continue
        pieces = int(np.ceil(abs(exact.turn(s)) / (np.pi / 2) - 1e-9))
        inner = exact.point_at(s, np.arange(1, pieces) / pieces) if pieces > 1 else ()
        stops = [point(s.start), *map(point, inner), point(s.end)]
        if s.semi_axes is None:
            lines += [kernel.addCircleArc(a, point(s.centre), b) for a, b in pairwise(stops)]
            continue
        longer = s.frame[:, int(np.argmax(s.semi_axes))]
        centre = point(s.centre)
        major = point(np.asarray(s.centre) + longer)
        lines += [kernel.addEllipseArc(a, centre, major, b) for a, b in pairwise(stops)]
    return lines


def _wedge_surface(wedge: float) -> int:
    """Return a polygon that covers the angles 0 … wedge far beyond the outline."""
    occ = gmsh.model.occ
    far = 10 * SCALE
    if wedge == HALF:
        corners = [(far, 0.0), (far, far), (-far, far), (-far, 0.0)]
    else:
        corners = [(0.0, 0.0), (far, 0.0), (far * np.cos(wedge), far * np.sin(wedge))]
    tags = [occ.addPoint(*c, 0) for c in corners]
    return int(
        occ.addPlaneSurface(
            [
                occ.addCurveLoop(
                    [occ.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1], strict=True)]
                )
            ]
        )
    )
