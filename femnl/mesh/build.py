"""Meshes of the film by gmsh: curved triangles, graded towards clamped edges, corners and holes, whole or by symmetry."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skfem import MeshTri2

from femnl.errors import GeometryError, ParameterError
from femnl.mesh.collect import check_unfolded, collect
from femnl.mesh.curves import arc_angles, arc_radius, distance_from, point_on, singular_corners
from femnl.mesh.symmetry import FULL, HALF, find_wedge
from femnl.types.device import Model
from femnl.types.mechanics import Domain

Array = NDArray[np.float64]

# gmsh's geometry kernel has absolute tolerances near 1e-7: it works on coordinates scaled to this many units per outline length.
SCALE = 100.0
TOLERANCE = 1e-6  # of a point lying on a curve, in scaled units

GROWTH = 0.7  # element size gained per distance from the feature that asks for small elements
HOLE_SEGMENTS = 12  # curved edges around a hole
ARC_SEGMENTS = 64  # curved edges per full turn of an outline arc
ELEMENTS_PER_LENGTH = 12  # elements across the outline far from every feature
LAYER_SIZE = 1.5  # element size at clamped edges in units of the bending length ℓ = √(D/σh)


def mesh(model: Model, symmetry: str = "auto", resolution: float = 1.0) -> Domain:
    """Mesh the film of a device, or the wedge that its mirror symmetry leaves.

    Args: symmetry: `auto` (a quarter or half where outline and holes allow, else the whole film), `full`, `half`, `quarter`,
        `eighth` or `twelfth`. resolution: factor on the number of elements per length; 2 halves every element.
    Returns: curved triangles with boundaries `clamped`, `free`, `mirror-0`, `mirror-1`, as present.
    Raises: ParameterError where the device lacks the symmetry asked for; GeometryError where meshing fails.
    """
    if not 0.1 <= resolution <= 20:
        raise ParameterError(f"resolution = {resolution:g}: expected a number from 0.1 to 20")
    wedge = find_wedge(model, symmetry)
    with _gmsh_session():
        return Domain(model, _build(model, wedge, resolution), wedge)


@contextmanager
def _gmsh_session() -> Iterator[None]:
    """One gmsh model, closed whatever happens; one thread and no rounding by clock make meshes reproducible."""
    gmsh.initialize(interruptible=False)
    try:
        for option, value in {"General.Terminal": 0, "General.NumThreads": 1, "Mesh.MeshSizeExtendFromBoundary": 0}.items():
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


def _build(model: Model, wedge: float, resolution: float) -> MeshTri2:
    unit = SCALE / model.outline.length
    try:
        _draw(model, wedge, unit)
        curves = _classify(model, wedge, unit)
        _grade(model, curves, unit, resolution)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
    except Exception as error:
        if type(error) is not Exception:  # gmsh knows no other class for its failures
            raise
        raise GeometryError(
            f"{model.name}: the mesher failed ({error}); check for holes or edges closer to each other than 1e-8 of the outline"
        ) from error
    result = collect(
        {"clamped": curves.clamped, "free": curves.free + curves.holes, "mirror-0": curves.mirrors[0], "mirror-1": curves.mirrors[1]}, unit
    )
    check_unfolded(model, result)
    return result


def _draw(model: Model, wedge: float, unit: float) -> None:
    """The film's surface: outline, cut to the wedge, minus the holes that reach into it, in one boolean operation each."""
    occ = gmsh.model.occ
    points: dict[tuple[float, ...], int] = {}

    def point(xy: Array | tuple[float, float]) -> int:
        key = tuple(np.round(np.asarray(xy) * unit, 9))
        if key not in points:
            points[key] = occ.addPoint(*key, 0)
        return points[key]

    lines = []
    for s in model.outline.segments:
        if s.centre is None:
            lines.append(occ.addLine(point(s.start), point(s.end)))
            continue
        pieces = int(np.ceil(arc_angles(s)[1] / (np.pi / 2) - 1e-9))
        stops = [s.start, *(point_on(s, k / pieces) for k in range(1, pieces)), s.end]
        centre = point(s.centre)
        lines += [occ.addCircleArc(point(a), centre, point(b)) for a, b in zip(stops, stops[1:], strict=False)]
    film = [(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))]
    if wedge < FULL:
        film, _ = occ.intersect(film, [(2, _wedge_surface(wedge))])
    near = model.holes.centres[_outside(model.holes.centres, wedge) < model.holes.radius]
    if len(near):
        radius = model.holes.radius * unit
        discs = [(2, occ.addDisk(x * unit, y * unit, 0, radius, radius)) for x, y in near]
        film, _ = occ.cut(film, discs)
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
    occ, far = gmsh.model.occ, 10 * SCALE
    if wedge == HALF:
        corners = [(far, 0.0), (far, far), (-far, far), (-far, 0.0)]
    else:
        corners = [(0.0, 0.0), (far, 0.0), (far * np.cos(wedge), far * np.sin(wedge))]
    tags = [occ.addPoint(*c, 0) for c in corners]
    return int(occ.addPlaneSurface([occ.addCurveLoop([occ.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1], strict=True)])]))


def _classify(model: Model, wedge: float, unit: float) -> _Curves:
    """Tell curves apart by where they lie."""
    curves = _Curves([], [], [], ([], []))
    holes = cKDTree(model.holes.centres * unit) if len(model.holes.centres) else None
    for _, tag in gmsh.model.getEntities(1):
        low, high = gmsh.model.getParametrizationBounds(1, tag)
        where = np.array(gmsh.model.getValue(1, tag, list(np.linspace(low[0], high[0], 5)[1:4]))).reshape(-1, 3)[:, :2]
        if wedge < FULL and np.all(np.abs(where[:, 1]) < TOLERANCE):
            curves.mirrors[0].append(tag)
        elif wedge < HALF and np.all(np.abs(where @ [np.sin(wedge), -np.cos(wedge)]) < TOLERANCE):
            curves.mirrors[1].append(tag)
        elif holes is not None and np.all(np.abs(holes.query(where)[0] - model.holes.radius * unit) < TOLERANCE):
            curves.holes.append(tag)
        else:
            distances = [np.abs(distance_from(s, where / unit)).max() for s in model.outline.segments]
            (curves.clamped if model.outline.segments[int(np.argmin(distances))].clamped else curves.free).append(tag)
    return curves


def _grade(model: Model, curves: _Curves, unit: float, resolution: float) -> None:
    """Element size: growing linearly with the distance from clamped edges, arcs, corners and holes."""
    film, field = model.film, gmsh.model.mesh.field
    layer = np.sqrt(film.young * film.thickness**2 / 12 / (1 - film.poisson**2) / film.stress) if model.bending else 0.0
    largest = SCALE / ELEMENTS_PER_LENGTH / resolution
    wanted = []

    def grow(size: float, **entities: list[float]) -> None:
        distance = field.add("Distance")
        for name, value in entities.items():
            field.setNumbers(distance, name, value)
        field.setNumber(distance, "Sampling", 200 if len(entities.get("CurvesList", [])) < 20 else 30)
        wanted.append(field.add("MathEval"))
        field.setString(wanted[-1], "F", f"min({largest}, {size} + {GROWTH} * F{distance})")

    if curves.holes:
        grow(2 * np.pi * model.holes.radius * unit / HOLE_SEGMENTS / resolution, CurvesList=curves.holes)
    if model.bending and curves.clamped:
        grow(LAYER_SIZE * layer * unit / resolution, CurvesList=curves.clamped)
    for radius in {arc_radius(s) for s in model.outline.segments if s.centre is not None}:
        arcs = [t for t in curves.clamped + curves.free if gmsh.model.getType(1, t) != "Line"]
        grow(2 * np.pi * radius * unit / ARC_SEGMENTS / resolution, CurvesList=arcs)
    for corner, size in singular_corners(model.outline, resolution):
        near = [
            t for _, t in gmsh.model.getEntities(0) if np.hypot(*(np.array(gmsh.model.getValue(0, t, []))[:2] - corner * unit)) < TOLERANCE
        ]
        if near:
            grow(max(size, layer / 10) * unit, PointsList=near)
    wanted.append(field.add("MathEval"))
    field.setString(wanted[-1], "F", str(largest))
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", wanted)
    field.setAsBackgroundMesh(smallest)
