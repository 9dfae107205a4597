"""The lattice on which the holes of a device lie, and the cell that repeats on it.

Holes that break the lattice, such as those of a defect, are few and left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry import curves
from femnl.device.geometry.openings import polygon
from femnl.device.geometry.placing import placed
from femnl.mechanics.bands.cell_layers import Frame, film_frame, need_repeating
from femnl.mechanics.bands.lattice import Cell, Lattice
from femnl.mechanics.bands.mirrors import Candidate, no_mirrors, with_mirrors

Array = NDArray[np.float64]
Index = NDArray[np.int64]

EVEN = 1e-5
"""Of the distance between neighbours, to which holes must lie on their lattice: coordinates of
layouts are rounded to a nanometre."""
REACHES = (2.1, 4.2, 8.4)
"""Of the distance between neighbours, up to which a step of the lattice is looked for: farther
where none is near."""
MOST = 0.8
"""Share of the holes that have a like hole a step away, of those whose step ends among the holes.
Of a honeycomb, whose holes are of two kinds, half have one where there is no step."""
COMMON = 0.5
"""Of the most frequent place in the cell, how often another must be found to count as a hole of
the lattice and not of a defect."""


@dataclass(frozen=True)
class _Inner:
    """All holes and openings: places (n, 2) [m], what each looks like, and from where it came."""

    centres: Array
    look: Index
    shapes: tuple[float | Outline, ...]


def find_lattice(model: Model) -> Lattice:
    """Return the lattice on which the holes of a device lie; see `find_cell`."""
    return find_cell(model).lattice


def find_cell(model: Model) -> Cell:
    """Return the cell that repeats in a device, turned so that a row of its lattice runs along x.

    Raises: ParameterError where holes lie on no square or hexagonal lattice, are less than four,
    or make a cell without the mirror lines of a square or a hexagon, and where a layer does not
    repeat with the holes.
    """
    inner = _inner(model)
    if len(inner.centres) < 4:
        raise ParameterError(
            f"{model.name}: holes: {len(inner.centres)} of them make no lattice; give a device "
            "with four or more, or a lattice"
        )
    found = _steps(inner)
    if found is None:
        raise ParameterError(
            f"{model.name}: holes: they lie on no square or hexagonal lattice; bands need one"
        )
    lattice, angle = found
    basis = _basis(_turned(inner, -angle), lattice)
    if any(isinstance(s, Outline) and s.segments[0].clamped for s in basis.shapes):
        raise ParameterError(
            f"{model.name}: holes: bands need a lattice whose holes are all free; leave clamped out"
        )
    frame = film_frame(model, lattice, angle)
    centres = _turned(inner, -angle).centres
    need_repeating(model, frame, _spanned(model, frame, centres), single=False)
    for candidate in _cells(basis, lattice, frame):
        mirrored = with_mirrors(candidate.layered(model), model)
        if mirrored is not None:
            return mirrored
    raise no_mirrors(model, list(_cells(basis, lattice, frame)))


def given_cell(model: Model, lattice: Lattice) -> Cell:
    """Return the cell of a lattice that is given, with one of the device's holes in its middle.

    The hole nearest to the middle of the film, or none. Layers lie about it as they do on the film.

    Raises: ParameterError for a device with holes of several kinds, and for layers that do not
    repeat or lack the cell's mirror lines.
    """
    if model.openings:
        raise ParameterError(
            f"{model.name}: holes: a lattice that is given takes holes that are all round, free "
            "and of one radius"
        )
    centres = model.holes.centres
    if len(centres) > 0 and not 2 * model.holes.radius < lattice.pitch:
        raise ParameterError(
            f"pitch = {lattice.pitch:g} m: expected more than the diameter "
            f"{2 * model.holes.radius:g} m of the holes"
        )
    frame = film_frame(model, lattice, 0.0)
    if len(centres) > 0:
        nearest = np.argmin(np.hypot(*(centres - frame.origin).T))
        frame = replace(frame, origin=centres[nearest])
    need_repeating(model, frame, _spanned(model, frame, centres), single=True)
    holes = Holes(np.zeros((min(len(centres), 1), 2)), model.holes.radius)
    candidate = Candidate(Cell(lattice, holes), frame)
    mirrored = with_mirrors(candidate.layered(model), model)
    if mirrored is None:
        raise no_mirrors(model, [candidate])
    return mirrored


def _spanned(model: Model, frame: Frame, centres: Array) -> shapely.Geometry:
    """Return what holes at centres (n, 2) [m] of the turned device span, in a frame.

    The film, where it is less than a cell: beyond its outermost holes a lattice need not go on.
    """
    hull: shapely.Geometry = shapely.MultiPoint(centres - frame.origin).convex_hull
    cell = shapely.Polygon(frame.lattice.corners)
    if hull.area > (1 - EVEN) * cell.area:
        return hull
    return polygon(frame.of(model.outline))


def _inner(model: Model) -> _Inner:
    places = [*model.holes.centres]
    shapes: list[float | Outline] = [model.holes.radius] * len(places)
    look: list[tuple[object, ...]] = [(0,)] * len(places)
    for opening in model.openings:
        x0, y0, x1, y1 = curves.box(opening)
        middle = np.array([x0 + x1, y0 + y1]) / 2
        places.append(middle)
        shapes.append(opening)
        points = np.concatenate([curves.point_at(s, [0.0, 0.5]) for s in opening.segments]) - middle
        rounded = np.round(points / (EVEN * opening.length)).astype(int)
        look.append((1, *sorted(map(tuple, rounded.tolist()))))
    kinds = {key: k for k, key in enumerate(dict.fromkeys(look))}
    return _Inner(
        np.array(places).reshape(-1, 2), np.array([kinds[key] for key in look]), tuple(shapes)
    )


def _steps(inner: _Inner) -> tuple[Lattice, float] | None:
    """Return shortest step that is a lattice's, and the angle [rad] of the row that it starts."""
    tree = cKDTree(inner.centres)
    nearest = float(np.asarray(tree.query(inner.centres, k=2)[0])[:, 1].min())
    for reach in REACHES:
        pairs = tree.query_pairs(reach * nearest, output_type="ndarray")
        alike = pairs[inner.look[pairs[:, 0]] == inner.look[pairs[:, 1]]]
        steps = inner.centres[alike[:, 1]] - inner.centres[alike[:, 0]]
        # One of each direction, and of each length once
        steps = np.where((steps[:, :1] < -EVEN * nearest), -steps, steps)
        _, first = np.unique(np.round(steps / (100 * EVEN * nearest)), axis=0, return_index=True)
        steps = steps[first]
        for step in steps[np.argsort(np.hypot(*steps.T).round(12), kind="stable")]:
            lattice = _lattice_of(inner, step, EVEN * nearest)
            if lattice is not None:
                return lattice, float(np.arctan2(step[1], step[0]))
    return None


def _lattice_of(inner: _Inner, step: Array, tolerance: float) -> Lattice | None:
    """Return lattice of a step and of its turns by 90° or 60°, or None if these are no steps."""
    if not _repeats(inner, step, tolerance):
        return None
    pitch = float(np.hypot(*step))
    for lattice in (Lattice("square", pitch), Lattice("hexagonal", pitch)):
        if _repeats(inner, _rotation(2 * np.pi / lattice.turns) @ step, tolerance):
            return lattice
    return None


def _repeats(inner: _Inner, step: Array, tolerance: float) -> bool:
    """Whether most holes have a like hole a step away, of those whose step ends among holes."""
    moved = inner.centres + step
    within = _among(inner.centres, moved, tolerance)
    gaps, other = cKDTree(inner.centres).query(moved)
    same = (np.asarray(gaps) < tolerance) & (inner.look[other] == inner.look)
    return bool(within.any()) and float(np.mean(same[within])) >= MOST


def _among(centres: Array, points: Array, tolerance: float) -> NDArray[np.bool_]:
    """Return which points (n, 2) lie in the convex hull of the holes."""
    try:
        hull = ConvexHull(centres).equations
    except QhullError:  # in one row, which has no inside
        return np.zeros(len(points), dtype=bool)
    return np.asarray(np.all(points @ hull[:, :2].T + hull[:, 2] <= tolerance, axis=1))


def _turned(inner: _Inner, angle: float) -> _Inner:
    turn = _rotation(angle)
    shapes = tuple(
        shape if isinstance(shape, float) else placed(shape, (0.0, 0.0), angle)
        for shape in inner.shapes
    )
    return _Inner(inner.centres @ turn.T, inner.look, shapes)


def _basis(inner: _Inner, lattice: Lattice) -> _Inner:
    """The holes of one cell: places of the lattice that most cells share, one example of each."""
    steps = lattice.steps[:2]
    part = np.linalg.solve(steps.T, (inner.centres - inner.centres[0]).T).T
    part -= np.floor(part + 100 * EVEN)
    key = np.concatenate([np.round(part / (1000 * EVEN)), inner.look[:, None]], axis=1)
    _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
    kept = np.sort(first[count >= COMMON * count.max()])
    return _Inner(inner.centres[kept], inner.look[kept], tuple(inner.shapes[k] for k in kept))


def _cells(basis: _Inner, lattice: Lattice, frame: Frame) -> Iterator[Candidate]:
    """Cells about the points that may be centres of symmetry: holes first, then points between."""
    steps = lattice.steps[:2]
    halves = [(0, 0), (1 / 2, 0), (0, 1 / 2), (1 / 2, 1 / 2)]
    thirds = [(1 / 3, 1 / 3), (2 / 3, 2 / 3)] if lattice.turns == 6 else []
    between = (basis.centres[:, None] + basis.centres[None]).reshape(-1, 2) / 2
    for offset in (*halves, *thirds):
        for place in (*basis.centres, *between):
            origin = place + offset @ steps
            yield Candidate(_cell_about(basis, lattice, origin), frame.about(origin))


def _cell_about(basis: _Inner, lattice: Lattice, origin: Array) -> Cell:
    """The cell with all holes that lie no farther from its middle than they reach from its rim."""
    rim = float(np.hypot(*lattice.corners[0]))
    reach = max(s if isinstance(s, float) else s.length for s in basis.shapes)
    number = int(np.ceil(2 * (rim + reach) / lattice.pitch)) + 1
    m, n = np.meshgrid(*2 * [np.arange(-number, number + 1)])
    shifts = np.stack([m.ravel(), n.ravel()], axis=1) @ lattice.steps[:2]
    radius = next((s for s in basis.shapes if isinstance(s, float)), 0.0)
    centres = []
    openings = []
    for centre, shape in zip(basis.centres, basis.shapes, strict=True):
        # Each place of the lattice as near to the origin as can be, and its neighbours
        away = (
            centre
            - origin
            - np.round(np.linalg.solve(lattice.steps[:2].T, centre - origin)) @ lattice.steps[:2]
        )
        places = away + shifts
        near = places[np.hypot(*places.T) < rim + reach]
        if isinstance(shape, float):
            centres.append(near)
        else:
            openings += [placed(shape, place - centre) for place in near]
    every = np.concatenate(centres) if centres else np.empty((0, 2))
    return Cell(lattice, Holes(every, radius), tuple(openings))


def _rotation(angle: float) -> Array:
    c = np.cos(angle)
    s = np.sin(angle)
    return np.array([[c, -s], [s, c]])
