"""Meshes of the film by gmsh.

Curved triangles, graded towards clamped edges, corners and holes, whole or by symmetry.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.device import Model, Segment
from femnl.core.errors import GeometryError, ParameterError
from femnl.core.mechanics import Domain
from femnl.device.geometry import curves as exact
from femnl.device.mesh.collect import Raw, assemble, check_unfolded, collect, double, misfit
from femnl.device.mesh.corners import singular_corners
from femnl.device.mesh.openings import SEGMENTS as HOLE_SEGMENTS
from femnl.device.mesh.openings import arcs_by_radius, rim_sizes
from femnl.device.mesh.symmetry import EIGHTH, FULL, HALF, QUARTER, find_wedge, has_symmetry
from femnl.mechanics.fem.memory import need_memory

Array = NDArray[np.float64]
PROGRESS = logging.getLogger("femnl.progress")

# gmsh's geometry kernel has absolute tolerances near 1e-7: it works on coordinates scaled to this
# many units per outline length.
SCALE = 100.0
TOLERANCE = 1e-6  # of a point lying on a curve, in scaled units

# Element size gained per distance from the feature that asks for small elements, at resolution 1.
# Coarser meshes grade no more steeply: what fades as a power of the distance is resolved by the
# ratio of distances across an element, and gmsh cannot follow a size that grows faster than the
# distance.
GROWTH = 0.7
# The same away from holes, whose fields fade faster than those of edges and corners
HOLE_GROWTH = 1.0
ELEMENTS_ACROSS = 3  # elements across the narrowest place of a strip, such as a tether
ARC_SEGMENTS = 64  # curved edges per full turn of an outline arc
ELEMENTS_PER_LENGTH = 12  # elements across the outline far from every feature
# Times the triangles along a straight line as long, measured: the film widens away from a hole
AROUND_HOLES = 3
# Of memory a triangle by the degree of the elements, for the factorised in-plane stiffness: 38, 81,
# 158, 284 kB at 6820 triangles (peak resident memory, degrees 3 to 6), and the more the more
# triangles.
BYTES = {3: 42_000, 4: 90_000, 5: 180_000, 6: 320_000}
LAYER_SIZE = 1.5  # element size at clamped edges in units of the bending length ℓ = √(D/σh)


def mesh(model: Model, symmetry: str = "auto", resolution: float = 1.0, degree: int = 4) -> Domain:
    """Mesh the film of a device, or the wedge that its mirror symmetry leaves.

    Args: symmetry: `auto` (a quarter or half where outline and holes allow, else the whole film),
        `full`, `half`, `quarter`, `eighth` or `twelfth`. resolution: factor on the number of
        elements per length; 2 halves every element. degree: of the elements that are meant for it,
        by which their memory is foreseen.
    Returns: curved triangles with boundaries `clamped`, `free`, `mirror-0`, `mirror-1`, as present.
    Raises: ParameterError where the device lacks the symmetry asked for; GeometryError where
    meshing fails.
    """
    if not 0.1 <= resolution <= 20:
        raise ParameterError(f"resolution = {resolution:g}: expected a number from 0.1 to 20")
    if not any(s.clamped for s in model.outline.segments):
        raise GeometryError(
            f"{model.name}: no edge of the outline is clamped, so that nothing holds the film; "
            "clamp at least one"
        )
    PROGRESS.info("%s: meshing", model.name)
    wedge = find_wedge(model, symmetry)
    diagonal = wedge == QUARTER and has_symmetry(model, EIGHTH)
    with _gmsh_session():
        raw = (
            double(_build(model, EIGHTH, resolution, degree, 2))
            if diagonal
            else _build(model, wedge, resolution, degree, 1)
        )
    result = assemble(raw)
    check_unfolded(model, result)
    if model.overhang is not None:
        outside = ~exact.contains(model.outline, result.p[:, result.t].mean(axis=1).T)
        result = replace(result, _subdomains={"overhang": np.flatnonzero(outside)})
    return Domain(model, result, wedge, diagonal, misfit=misfit(model, result))


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
        }.items():
            gmsh.option.setNumber(option, value)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        gmsh.option.setNumber("Mesh.Algorithm", 6)
        gmsh.model.add("film")
        yield
    finally:
        gmsh.finalize()


@dataclass(frozen=True)
class _Curves:
    """gmsh's curve tags by what they are."""

    clamped: list[int]
    free: list[int]
    holes: list[int]
    mirrors: tuple[list[int], list[int]]
    rim: list[int]  # between film and overhang
    segment: dict[int, int]  # the edge's segment that a clamped or free curve is part of
    openings: list[int]  # free rims of openings; clamped ones are among the clamped curves
    rims: dict[int, int]  # the opening on whose rim a curve lies


def _build(model: Model, wedge: float, resolution: float, degree: int, copies: int) -> Raw:
    unit = SCALE / model.outline.length
    try:
        _draw(model, wedge, unit)
        curves = _classify(model, wedge, unit)
        triangles = copies * _grade(model, curves, unit, resolution, degree)
        PROGRESS.info("%s: about %.3g triangles", model.name, triangles)
        what = f"{model.name}: modes of degree {degree} on {triangles:.2g} triangles"
        need_memory(BYTES[max(degree, min(BYTES))] * triangles, what, "lower the resolution")
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


def _draw(model: Model, wedge: float, unit: float) -> None:
    """Return the film's surface.

    Edge, cut to the wedge, minus the holes that reach into it, split along the outline, one
    operation each.
    """
    occ = gmsh.model.occ
    points: dict[tuple[float, float], int] = {}

    def point(xy: Array | tuple[float, float]) -> int:
        x, y = np.round(np.asarray(xy) * unit, 9)
        if (x, y) not in points:
            points[x, y] = occ.addPoint(x, y, 0)
        return points[x, y]

    def loop(segments: tuple[Segment, ...]) -> list[int]:
        lines = []
        for s in segments:
            if s.centre is None:
                lines.append(occ.addLine(point(s.start), point(s.end)))
                continue
            pieces = int(np.ceil(abs(exact.turn(s)) / (np.pi / 2) - 1e-9))
            stops = [
                point(s.start),
                *map(point, exact.point_at(s, np.arange(1, pieces) / pieces)),
                point(s.end),
            ]
            if s.semi_axes is None:
                lines += [occ.addCircleArc(a, point(s.centre), b) for a, b in pairwise(stops)]
                continue
            longer = s.frame[:, int(np.argmax(s.semi_axes))]
            centre = point(s.centre)
            major = point(np.asarray(s.centre) + longer)
            lines += [occ.addEllipseArc(a, centre, major, b) for a, b in pairwise(stops)]
        return lines

    film = [(2, occ.addPlaneSurface([occ.addCurveLoop(loop(model.edge_outline.segments))]))]
    if wedge < FULL:
        film, _ = occ.intersect(film, [(2, _wedge_surface(wedge))])
    near = model.holes.centres[_outside(model.holes.centres, wedge) < model.holes.radius]
    if len(near):
        radius = model.holes.radius * unit
        discs = [(2, occ.addDisk(x * unit, y * unit, 0, radius, radius)) for x, y in near]
        film, _ = occ.cut(film, discs)
    inner = [o for o in model.openings if np.any(_outside(exact.polyline(o), wedge) < 0)]
    if inner:
        film, _ = occ.cut(
            film, [(2, occ.addPlaneSurface([occ.addCurveLoop(loop(o.segments))])) for o in inner]
        )
    if model.overhang is not None:
        film, _ = occ.fragment(film, [(1, line) for line in loop(model.outline.segments)])
    occ.synchronize()
    # Curves beyond the wedge, and the centres of arcs, bound nothing
    if model.overhang is not None:
        faces = gmsh.model.getEntities(2)
        bounding = {tag for _, tag in gmsh.model.getBoundary(faces, combined=False, oriented=False)}
        occ.remove(
            [(1, tag) for _, tag in gmsh.model.getEntities(1) if tag not in bounding],
            recursive=True,
        )
        occ.synchronize()


def _outside(points: Array, wedge: float) -> Array:
    """How far points (n, 2) lie beyond the mirror lines of a wedge; negative inside."""
    x, y = points.T
    beyond = np.full(len(points), -np.inf)
    if wedge < FULL:
        beyond = np.maximum(beyond, -y)
    if wedge < HALF:
        beyond = np.maximum(beyond, y * np.cos(wedge) - x * np.sin(wedge))
    return beyond


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


def _classify(model: Model, wedge: float, unit: float) -> _Curves:
    """Tell curves apart by where they lie."""
    curves = _Curves([], [], [], ([], []), [], {}, [], {})
    outline = model.edge_outline
    holes = cKDTree(model.holes.centres * unit) if len(model.holes.centres) else None
    boxes = np.array([exact.box(o) for o in model.openings]).reshape(-1, 4) * unit
    for _, tag in gmsh.model.getEntities(1):
        low, high = gmsh.model.getParametrizationBounds(1, tag)
        where = np.array(
            gmsh.model.getValue(1, tag, list(np.linspace(low[0], high[0], 5)[1:4]))
        ).reshape(-1, 3)[:, :2]
        if wedge < FULL and np.all(np.abs(where[:, 1]) < TOLERANCE):
            curves.mirrors[0].append(tag)
        elif wedge < HALF and np.all(np.abs(where @ [np.sin(wedge), -np.cos(wedge)]) < TOLERANCE):
            curves.mirrors[1].append(tag)
        elif holes is not None and np.all(
            np.abs(holes.query(where)[0] - model.holes.radius * unit) < TOLERANCE
        ):
            curves.holes.append(tag)
        elif (index := _opening(model, boxes, where, unit)) is not None:
            rim = model.openings[index]
            curves.rims[tag] = index
            (curves.clamped if rim.segments[0].clamped else curves.openings).append(tag)
        elif (
            model.overhang is not None
            and exact.distance(model.outline, where / unit).max() * unit < TOLERANCE
        ):
            curves.rim.append(tag)
        else:
            distances = [
                exact.distance(replace(outline, segments=(s,)), where / unit).max()
                for s in outline.segments
            ]
            curves.segment[tag] = int(np.argmin(distances))
            (
                curves.clamped if outline.segments[curves.segment[tag]].clamped else curves.free
            ).append(tag)
    return curves


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


def _grade(model: Model, curves: _Curves, unit: float, resolution: float, degree: int) -> float:
    """Return the element size h.

    It grows linearly with the distance from clamped edges, arcs, corners and holes.

    Returns: about how many triangles that makes: ∫ dA / (h²√3/4), where every curve of length l
        adds ∫ l dx / (s + g x)² = l / (s g), and every corner of angle β ∫ βr dr / (s + g r)² = β
        (ln h/s − 1) / g².
    """
    field = gmsh.model.mesh.field
    layer = bending_length(model)
    largest = SCALE / ELEMENTS_PER_LENGTH / resolution
    wanted = []
    grading = max(resolution, 1.0)
    inverse_square = [
        sum(gmsh.model.occ.getMass(2, tag) for _, tag in gmsh.model.getEntities(2)) / largest**2
    ]

    def grow(size: float, distance: int, growth: float = GROWTH) -> None:
        wanted.append(field.add("MathEval"))
        field.setString(
            wanted[-1], "F", f"min({largest}, {size} + {growth / grading} * F{distance})"
        )

    def grow_from_curves(size: float, tags: list[int], growth: float = GROWTH) -> None:
        distance = field.add("Distance")
        lengths = [gmsh.model.occ.getMass(1, t) for t in tags]
        inverse_square.append(
            (AROUND_HOLES if tags == curves.holes else 1) * sum(lengths) * grading / (size * growth)
        )
        field.setNumbers(distance, "CurvesList", tags)
        # gmsh measures the distance to points along the curves: two an element hide the gaps
        # between them.
        field.setNumber(distance, "Sampling", np.ceil(2 * max(lengths) / size))
        grow(size, distance, growth)

    if curves.holes:
        grow_from_curves(
            2 * np.pi * model.holes.radius * unit / HOLE_SEGMENTS / grading,
            curves.holes,
            HOLE_GROWTH,
        )
    if model.bending and curves.clamped:
        grow_from_curves(LAYER_SIZE * layer * unit / resolution, curves.clamped)
    if model.overhang is not None:
        rim = model.overhang.width * unit / ELEMENTS_ACROSS
        grow_from_curves(
            (min(LAYER_SIZE * layer * unit, rim) if model.bending else rim) / resolution, curves.rim
        )
    free = set(curves.openings)
    for size, tags in rim_sizes(model, curves.rims, free, unit, SCALE / ELEMENTS_PER_LENGTH):
        grow_from_curves(size / grading, tags, HOLE_GROWTH)
    for radius, arcs in arcs_by_radius(curves.clamped + curves.free).items():
        grow_from_curves(2 * np.pi * radius / ARC_SEGMENTS / resolution, arcs)
    for index, width in enumerate(exact.widths(model.edge_outline)):
        tags = [t for t, k in curves.segment.items() if k == index]
        if tags and width * unit < ELEMENTS_ACROSS * largest:
            grow_from_curves(width * unit / ELEMENTS_ACROSS / resolution, tags)
    ends = {t: np.array(gmsh.model.getValue(0, t, []))[:2] for _, t in gmsh.model.getEntities(0)}
    for corner, angle, size in singular_corners(model, resolution, layer, degree):
        near = [t for t, end in ends.items() if np.hypot(*(end - corner * unit)) < TOLERANCE]
        if near:
            distance = field.add("Distance")
            field.setNumbers(distance, "PointsList", near)
            grow(size * unit, distance)
            fan = max(np.log(largest / (size * unit)) - 1, 0.0)
            inverse_square.append(angle * (grading / GROWTH) ** 2 * fan)
    wanted.append(field.add("MathEval"))
    field.setString(wanted[-1], "F", str(largest))
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", wanted)
    field.setAsBackgroundMesh(smallest)
    return float(4 / np.sqrt(3) * sum(inverse_square))


def bending_length(model: Model) -> float:
    """Return ℓ = √(D/σh) [m], the width of the layer that bending makes at a clamped edge.

    0 without bending, L at most.
    """
    film = model.film
    length = model.outline.length
    if not model.bending:
        return 0.0
    squared = film.young * film.thickness**2 / 12 / (1 - film.poisson**2)
    return float(length if film.stress * length**2 <= squared else np.sqrt(squared / film.stress))
