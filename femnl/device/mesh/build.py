"""Meshes of the film by gmsh.

Curved triangles, graded towards clamped edges, corners and holes, whole or by symmetry.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.choices import check_resolution
from femnl.core.device import Model
from femnl.core.errors import GeometryError
from femnl.core.mechanics import Domain
from femnl.core.memory import need_memory
from femnl.core.outline import Outline, Segment
from femnl.device.geometry import curves as exact
from femnl.device.geometry.placing import moved
from femnl.device.mesh.collect import Raw, assemble, check_unfolded, collect, double, misfit
from femnl.device.mesh.grading import SCALE, TOLERANCE, Curves, Fineness, grade
from femnl.device.mesh.layers import covered
from femnl.device.mesh.symmetry import (
    EIGHTH,
    FULL,
    HALF,
    QUARTER,
    beyond_mirrors,
    film_middle,
    find_wedge,
    has_symmetry,
)

Array = NDArray[np.float64]
PROGRESS = logging.getLogger("femnl.progress")

# Of memory a triangle by the degree of the elements, for the factorised in-plane stiffness: 38, 81,
# 158, 284 kB at 6820 triangles (peak resident memory, degrees 3 to 6), and the more the more
# triangles.
BYTES = {3: 42_000, 4: 90_000, 5: 180_000, 6: 320_000}
# Relative error of the number of elements along an edge, by which gmsh places their ends: its 1e-9
# took nine tenths of the time of meshes with many corners or small holes
PLACING = 1e-4
# Lengths of the film between it and the origin: numbers of 16 digits then still place its edges to
# 1e-10 of its length, and gmsh needs 1e-9.
FARTHEST = 1e6
ROUND_HOLE = -1  # in the place of an opening's index


def mesh(
    model: Model,
    symmetry: str = "auto",
    resolution: float = 1.0,
    degree: int = 4,
    wave: float = np.inf,
) -> Domain:
    """Mesh the film of a device, or the wedge that its mirror symmetry leaves.

    Args: symmetry: `auto` (a quarter or half where outline and holes allow, else the whole film),
        `full`, `half`, `quarter`, `eighth` or `twelfth`. resolution: factor on the number of
        elements per length; 2 halves every element. degree: of the elements that are meant for it,
        by which their memory is foreseen. wave: length [m] of the shortest waves that the elements
        have to follow, see `waves`.
    Returns: curved triangles with boundaries `clamped`, `free`, `mirror-0`, `mirror-1`, as present.
    Raises: ParameterError where the device lacks the symmetry asked for; GeometryError where
    meshing fails.
    """
    check_resolution(resolution)
    if not any(s.clamped for s in model.outline.segments):
        raise GeometryError(
            f"{model.name}: no edge of the outline is clamped, so that nothing holds the film; "
            "clamp at least one"
        )
    PROGRESS.info("%s: meshing", model.name)
    wedge = find_wedge(model, symmetry)
    diagonal = wedge == QUARTER and has_symmetry(model, EIGHTH)
    middle = _middle(model)
    # gmsh's tolerances are absolute, so that a film far from the origin would mesh differently
    centred = moved(model, -middle) if middle.any() else model
    fineness = Fineness(resolution, degree, wave)
    with _gmsh_session():
        raw = (
            double(_build(centred, EIGHTH, fineness, 2))
            if diagonal
            else _build(centred, wedge, fineness, 1)
        )
    result = assemble(replace(raw, points=raw.points + middle))
    check_unfolded(model, result)
    if model.overhang is not None:
        outside = ~exact.contains(model.outline, result.p[:, result.t].mean(axis=1).T)
        result = replace(result, _subdomains={"overhang": np.flatnonzero(outside)})
    if model.layers:
        result = replace(result, _subdomains=covered(model, result))
    x, y = map(float, middle)
    return Domain(model, result, wedge, diagonal, misfit=misfit(model, result), middle=(x, y))


def _middle(model: Model) -> Array:
    """Return the middle (2,) [m] of the film.

    Raises: GeometryError where the film is too far from the origin for its coordinates.
    """
    middle = film_middle(model)
    away = float(np.hypot(*middle))
    if away > FARTHEST * model.outline.length:
        raise GeometryError(
            f"{model.name}: the film lies {away:.4g} m from the origin, more than {FARTHEST:g} "
            f"times its length of {model.outline.length:.4g} m, where 16 digits no longer tell its "
            "edges; move it and its holes nearer to the origin"
        )
    return middle


@contextmanager
def _gmsh_session() -> Iterator[None]:
    """One gmsh model, closed whatever happens.

    One thread and no rounding by clock make meshes reproducible.
    """
    gmsh.initialize(interruptible=False)
    try:
        for option, value in {
            "General.Terminal": 0,
            "General.NumThreads": 1,
            "Mesh.MeshSizeExtendFromBoundary": 0,
            "Mesh.LcIntegrationPrecision": PLACING,
        }.items():
            gmsh.option.setNumber(option, value)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 6)
        gmsh.model.add("film")
        yield
    finally:
        gmsh.finalize()


def _build(model: Model, wedge: float, fineness: Fineness, copies: int) -> Raw:
    unit = SCALE / model.outline.length
    try:
        rims = _draw(model, wedge, unit)
        curves = _classify(model, rims, wedge, unit)
        triangles = copies * grade(model, curves, wedge, unit, fineness)
        PROGRESS.info("%s: about %.3g triangles", model.name, triangles)
        degree = max(fineness.degree, min(BYTES))
        what = f"{model.name}: modes of degree {fineness.degree} on {triangles:.2g} triangles"
        need_memory(BYTES[degree] * triangles, what, "lower the resolution")
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
    except Exception as error:
        if type(error) is not Exception:  # gmsh knows no other class for its failures
            raise
        raise GeometryError(
            f"{model.name}: the mesher failed ({error}); check for holes or edges closer to each "
            "other than 1e-8 of the outline"
        ) from error
    mirrors = {f"mirror-{k}": tags for k, tags in enumerate(curves.mirrors)}
    free = curves.free + curves.holes + curves.openings
    raw = collect({"clamped": curves.clamped, "free": free, **mirrors}, unit)
    if len(raw.triangles) == 0:
        raise GeometryError(
            f"{model.name}: the outline encloses no film; give its edges in order, "
            "counter-clockwise and without crossings"
        )
    return raw


def _draw(model: Model, wedge: float, unit: float) -> dict[int, int]:
    """Draw the film's surface; return the opening on whose rim a curve lies, where that is known.

    Edge, cut to the wedge, minus the holes that reach into it, split along the outline, one
    operation each. Holes and openings of a whole film are its inner edges, which need no operation:
    a geometry has none that meet.
    """
    occ = gmsh.model.occ
    known: dict[int, int] = {}
    loops = [_loop(model.edge_outline.segments, unit)]
    if wedge == FULL:
        for index, lines in _inner_edges(model, unit):
            loops.append(lines)
            known |= dict.fromkeys(lines, index)
    film = [(2, occ.addPlaneSurface([occ.addCurveLoop(lines) for lines in loops]))]
    if wedge < FULL:
        film, _ = occ.intersect(film, [(2, _wedge_surface(wedge))])
        reaching = _reaching_into(model, wedge, unit)
        if reaching:
            film, _ = occ.cut(film, reaching)
    between = [] if model.overhang is None else [model.outline]
    between += [rim for lamina in model.layers for rim in lamina.rims]
    across = [(1, line) for rim in between for line in _loop(rim.segments, unit)]
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


def _inner_edges(model: Model, unit: float) -> Iterator[tuple[int, list[int]]]:
    """Yield the curves of each hole, as ROUND_HOLE, and of each opening, as its index."""
    radius = model.holes.radius * unit
    for x, y in model.holes.centres * unit:
        yield ROUND_HOLE, [gmsh.model.occ.addCircle(x, y, 0, radius)]
    for index, opening in enumerate(model.openings):
        yield index, _loop(opening.segments, unit)


def _reaching_into(model: Model, wedge: float, unit: float) -> list[tuple[int, int]]:
    """Return surfaces of the holes and openings that reach into a wedge."""
    occ = gmsh.model.occ
    near = model.holes.centres[beyond_mirrors(model.holes.centres, wedge) < model.holes.radius]
    radius = model.holes.radius * unit
    inner = [o for o in model.openings if np.any(beyond_mirrors(exact.polyline(o), wedge) < 0)]
    return [(2, occ.addDisk(x * unit, y * unit, 0, radius, radius)) for x, y in near] + [
        (2, occ.addPlaneSurface([occ.addCurveLoop(_loop(o.segments, unit))])) for o in inner
    ]


def _loop(segments: tuple[Segment, ...], unit: float) -> list[int]:
    """Return gmsh's curves of consecutive segments, arcs in pieces of a quarter turn at most."""
    occ = gmsh.model.occ
    # Of one loop alone: gmsh forgets the points of what it has cut
    points: dict[tuple[float, float], int] = {}

    def point(xy: Array | tuple[float, float]) -> int:
        x, y = np.round(np.asarray(xy) * unit, 9)
        if (x, y) not in points:
            points[x, y] = occ.addPoint(x, y, 0)
        return points[x, y]

    lines = []
    for s in segments:
        if s.centre is None:
            lines.append(occ.addLine(point(s.start), point(s.end)))
            continue
        pieces = int(np.ceil(abs(exact.turn(s)) / (np.pi / 2) - 1e-9))
        inner = exact.point_at(s, np.arange(1, pieces) / pieces) if pieces > 1 else ()
        stops = [point(s.start), *map(point, inner), point(s.end)]
        if s.semi_axes is None:
            lines += [occ.addCircleArc(a, point(s.centre), b) for a, b in pairwise(stops)]
            continue
        longer = s.frame[:, int(np.argmax(s.semi_axes))]
        centre = point(s.centre)
        major = point(np.asarray(s.centre) + longer)
        lines += [occ.addEllipseArc(a, centre, major, b) for a, b in pairwise(stops)]
    return lines


def _wedge_surface(wedge: float) -> int:
    """A polygon that covers the angles 0 … wedge far beyond the outline."""
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


def _classify(model: Model, rims: dict[int, int], wedge: float, unit: float) -> Curves:
    """Tell curves apart by where they lie. rims: the openings of those that are known already."""
    curves = Curves([], [], [], ([], []), [], {}, [], {})
    for tag, index in rims.items():
        if index == ROUND_HOLE:
            curves.holes.append(tag)
        else:
            curves.add_to_rim(tag, index, model)
    outline = model.edge_outline
    holes = cKDTree(model.holes.centres * unit) if len(model.holes.centres) else None
    boxes = np.array([exact.box(o) for o in model.openings]).reshape(-1, 4) * unit
    sides = np.array([_box(outline, s) for s in outline.segments])
    for _, tag in gmsh.model.getEntities(1):
        if tag in rims:
            continue
        low, high = gmsh.model.getParametrizationBounds(1, tag)
        where = np.array(
            gmsh.model.getValue(1, tag, list(np.linspace(low[0], high[0], 5)[1:4]))
        ).reshape(-1, 3)[:, :2]
        if len(gmsh.model.getAdjacencies(1, tag)[0]) == 2:
            curves.rim.append(tag)
        elif wedge < FULL and np.all(np.abs(where[:, 1]) < TOLERANCE):
            curves.mirrors[0].append(tag)
        elif wedge < HALF and np.all(np.abs(where @ [np.sin(wedge), -np.cos(wedge)]) < TOLERANCE):
            curves.mirrors[1].append(tag)
        elif holes is not None and np.all(
            np.abs(holes.query(where)[0] - model.holes.radius * unit) < TOLERANCE
        ):
            curves.holes.append(tag)
        elif (found := _opening(model, boxes, where, unit)) is not None:
            curves.add_to_rim(tag, found, model)
        else:
            number = _segment(outline, sides, where / unit)
            curves.segment[tag] = number
            (curves.clamped if outline.segments[number].clamped else curves.free).append(tag)
    return curves


def _box(outline: Outline, segment: Segment) -> Array:
    """Return the box (4,) [m] around one segment: x and y of its lower left and upper right."""
    low, high = np.split(np.array(exact.box(replace(outline, segments=(segment,)))), 2)
    return np.concatenate([np.minimum(low, segment.end), np.maximum(high, segment.end)])


def _segment(outline: Outline, boxes: Array, where: Array) -> int:
    """Return the segment of an outline nearest to points (n, 2) [m] of a curve.

    boxes (m, 4) [m]: around the segments; those around all points come before the others.
    """
    margin = TOLERANCE * outline.length
    outside = np.maximum(boxes[:, None, :2] - where, where - boxes[:, None, 2:]).max(axis=(1, 2))
    near = np.flatnonzero(outside < margin)
    tried = near if len(near) else np.arange(len(boxes))
    distances = [
        exact.distance(replace(outline, segments=(outline.segments[k],)), where).max()
        for k in tried
    ]
    return int(tried[np.argmin(distances)])


def _opening(model: Model, boxes: Array, where: Array, unit: float) -> int | None:
    """The opening on whose rim points (n, 2) of a curve lie, in scaled units, or None.

    boxes (m, 4): around the openings, outside of which there is no need to look.
    """
    within = np.all(
        (boxes[:, None, :2] - TOLERANCE <= where) & (where <= boxes[:, None, 2:] + TOLERANCE),
        axis=(1, 2),
    )
    for k in np.flatnonzero(within):
        if exact.distance(model.openings[k], where / unit).max() * unit < TOLERANCE:
            return int(k)
    return None
