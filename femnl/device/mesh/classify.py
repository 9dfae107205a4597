"""What bounds a film: which curves of its surface are clamped, free, mirrors, or rims of holes."""

from dataclasses import replace

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.device import Model
from femnl.core.outline import Outline, Segment
from femnl.device.geometry import curves as exact
from femnl.device.mesh.grading import TOLERANCE, Curves
from femnl.device.mesh.symmetry import FULL, HALF

Array = NDArray[np.float64]


def classify(model: Model, rims: dict[int, int | None], wedge: float, unit: float) -> Curves:
    """Tell the curves of a film's surface apart by where they lie.

    rims: of those that are known already, the opening on whose rim they lie, None for a round hole.
    """
    curves = Curves([], [], [], ([], []), [], {}, [], {})
    for tag, index in rims.items():
        if index is None:
            curves.holes.append(tag)
        else:
            curves.add_to_rim(tag, index, model)
    outline = model.edge_outline
    holes = cKDTree(model.holes.centres * unit) if len(model.holes.centres) else None
    known = {index for index in rims.values() if index is not None}
    sought = [k for k in range(len(model.openings)) if k not in known]
    boxes = np.array([exact.box(model.openings[k]) for k in sought]).reshape(-1, 4) * unit
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
        elif (found := _opening(model, sought, boxes, where, unit)) is not None:
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


def _opening(
    model: Model, sought: list[int], boxes: Array, where: Array, unit: float
) -> int | None:
    """Return the opening on whose rim points (n, 2) of a curve lie, in scaled units, or None.

    boxes (m, 4): around the openings (m) that are looked at, outside of which none is looked for.
    """
    within = np.all(
        (boxes[:, None, :2] - TOLERANCE <= where) & (where <= boxes[:, None, 2:] + TOLERANCE),
        axis=(1, 2),
    )
    for k in np.flatnonzero(within):
        opening = sought[k]
        if exact.distance(model.openings[opening], where / unit).max() * unit < TOLERANCE:
            return opening
    return None
