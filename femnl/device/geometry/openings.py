"""Inner edges of the film beyond a lattice of like holes: any shapes, mixed radii, clamped rims."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry import curves
from femnl.device.geometry.hole_faults import TOUCHING
from femnl.device.geometry.holes import HolesTable
from femnl.device.geometry.naming import name, place
from femnl.device.geometry.placing import placed

Array = NDArray[np.float64]

PER_TURN = 720
"""Chords of a full turn of a curve from which its distance from other curves is taken."""
NARROWEST = 1e-4
"""A web of film beside an opening narrower than this part of its length counts as none: chords
leave their curve by (π/720)²/2 of its radius. Beside round ones the distance is exact."""


@dataclass(frozen=True)
class Openings:
    """The rims of openings, and the same with their curves cut into short chords (n,)."""

    rims: tuple[Outline, ...]
    drawn: NDArray[np.object_]


def openings(groups: Sequence[HolesTable]) -> Openings:
    """Return the rims of all holes of the groups, in their order."""
    rims: list[Outline] = []
    shapes: list[shapely.Polygon] = []
    for group in groups:
        centres = group.positions()
        like, which = group.prototypes(len(centres))
        chords = curves.polylines(like, PER_TURN)
        rims += [placed(like[k], centre) for centre, k in zip(centres, which, strict=True)]
        shapes += [
            shapely.Polygon(chords[k] + centre) for centre, k in zip(centres, which, strict=True)
        ]
    return Openings(tuple(rims), np.array(shapes, dtype=object))


def drawn(rims: Sequence[Outline]) -> Openings:
    """Return openings of which the rims are known."""
    shapes = [shapely.Polygon(line) for line in curves.polylines(rims, PER_TURN)]
    return Openings(tuple(rims), np.array(shapes, dtype=object))


def joined(inner: Openings, rims: Sequence[Outline]) -> Openings:
    """Return openings followed by the rims of more."""
    more = drawn(rims)
    return Openings((*inner.rims, *rims), np.concatenate([inner.drawn, more.drawn]))


def middle(opening: Outline) -> Array:
    """Return the middle (2,) [m] of the box around an opening."""
    x0, y0, x1, y1 = curves.box(opening)
    return np.array([x0 + x1, y0 + y1]) / 2


def refuse_misplaced(inner: Openings, holes: Holes, outline: Outline) -> None:
    """Refuse openings that meet the outline, lie outside of it, or meet each other or a hole.

    Raises:
        GeometryError: naming the first such opening.
    """
    rims = inner.rims
    shapes = inner.drawn
    if not rims:
        return
    around = polygon(outline)
    shapely.prepare(around)
    room = np.array([_narrowest(rim) for rim in rims])
    inside = shapely.contains_properly(around, shapes)
    # A chord of the outline may hide what its arc leaves, so that near it all is looked at
    near = shapely.dwithin(around.exterior, shapes, 2 * room + 1e-4 * outline.length)
    for k in np.flatnonzero(near | ~inside):
        gap = _gap(rims[k], shapes[k], outline, around.exterior)
        within = bool(curves.contains(outline, np.array([rims[k].segments[0].start]))[0])
        if not within or gap <= room[k]:
            verb = "cuts or touches" if gap <= room[k] else "lies outside"
            raise GeometryError(
                f"[holes] {_called(rims, int(k))} {verb} the outline; move it, make it smaller or "
                "enlarge the outline",
                rims[k].segments[0].start,
            )
    pairs = shapely.STRtree(shapes).query(shapes, "dwithin", 2 * room)
    for first, second in sorted(pairs.T[pairs[0] < pairs[1]].tolist()):
        apart = _gap(rims[first], shapes[first], rims[second], shapes[second])
        if apart <= room[first]:
            raise GeometryError(
                f"[holes] {_called(rims, first)} and {_called(rims, second)} overlap or touch; "
                "move them apart or make one smaller",
                rims[first].segments[0].start,
            )
    within = shapely.STRtree(shapely.points(holes.centres)).query(
        shapes, "dwithin", holes.radius + 2 * room
    )
    for k, nearest in sorted(within.T.tolist()):
        centre = holes.centres[nearest : nearest + 1]
        gap = float(curves.distance(rims[k], centre)[0])
        if curves.contains(rims[k], centre)[0]:
            gap = -gap
        if gap - holes.radius <= TOUCHING * holes.radius:
            raise GeometryError(
                f"[holes] {_called(rims, int(k))} and the round {name(holes, nearest)} overlap or "
                "touch; move them apart or make one smaller",
                rims[k].segments[0].start,
            )


def polygon(outline: Outline) -> shapely.Polygon:
    """Return an outline with its curves cut into short chords."""
    return shapely.Polygon(curves.polyline(outline, PER_TURN))


def _gap(rim: Outline, shape: shapely.Polygon, other: Outline, drawn: shapely.Geometry) -> float:
    """The least distance [m] between a rim and another curve; 0 or less where they meet.

    Exact from the middle of a circle, else between chords.
    """
    if rim.kind == "circle" and other.kind == "circle" and drawn.geom_type == "Polygon":
        apart = float(np.hypot(*(middle(rim) - middle(other))))
        return apart - (rim.length + other.length) / 2
    if rim.kind == "circle" and drawn.geom_type != "Polygon":
        return float(curves.distance(other, middle(rim)[None])[0]) - rim.length / 2
    return float(shapely.distance(shape, drawn))


def _narrowest(rim: Outline) -> float:
    """The least web of film [m] that counts as one."""
    return (TOUCHING if rim.kind == "circle" else NARROWEST) * rim.length


def _called(rims: Sequence[Outline], index: int) -> str:
    """Return what messages call an opening: its number, counted from 1, its place and its size."""
    rim = rims[index]
    size = rim.segments[0].semi_axes or 2 * (rim.length / 2,)
    what = f"of {rim.length * 1e6:.4g} um"
    if rim.kind == "circle":
        what = f"of radius {size[0] * 1e6:.4g} um"
    elif rim.kind == "ellipse":
        what = f"with semi-axes {size[0] * 1e6:.4g} and {size[1] * 1e6:.4g} um"
    return f"opening {index + 1} at {place(middle(rim))} {what}"
