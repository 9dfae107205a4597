"""Inner edges of the film beyond a lattice of like holes: ellipses, mixed radii, clamped rims."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Holes, Outline
from femnl.core.errors import GeometryError
from femnl.device.geometry import curves
from femnl.device.geometry.holes import TOUCHING, HolesTable, name, place
from femnl.device.geometry.outlines import ellipse

Array = NDArray[np.float64]

PER_TURN = 720
"""Points along an ellipse at which its distance from other curves is looked at."""
NARROWEST = 1e-4
"""A web of film beside an ellipse narrower than this part of its length counts as none: between
two of the points along it the distance is unknown to (π/720)²/2 of it."""


def openings(groups: Sequence[HolesTable]) -> tuple[Outline, ...]:
    """Return the rims of all holes of the groups, in their order."""
    found = []
    for group in groups:
        centres = group.positions()
        number = len(centres)
        rows = zip(centres, group.axes(number), group.angles(number), strict=True)
        for centre, axes, angle in rows:
            semi_axes = (float(axes[0]), float(axes[1]))
            at = (float(centre[0]), float(centre[1]))
            rim = ellipse(at, semi_axes, float(angle), group.clamped)
            kind = "circle" if semi_axes[0] == semi_axes[1] else "ellipse"
            found.append(Outline(kind, rim, None, 2 * max(semi_axes)))
    return tuple(found)


def middle(opening: Outline) -> Array:
    """Return the middle (2,) [m] of the box around an opening."""
    x0, y0, x1, y1 = curves.box(opening)
    return np.array([x0 + x1, y0 + y1]) / 2


def refuse_misplaced(rims: Sequence[Outline], holes: Holes, outline: Outline) -> None:
    """Refuse openings that meet the outline, lie outside of it, or meet each other or a hole.

    Raises:
        GeometryError: naming the first such opening.
    """
    for k, rim in enumerate(rims):
        gap = _gap(rim, outline)
        inside = bool(curves.contains(outline, middle(rim)[None])[0])
        if not inside or gap <= _narrowest(rim):
            verb = "cuts or touches" if gap <= _narrowest(rim) else "lies outside"
            raise GeometryError(
                f"[holes] {_called(rims, k)} {verb} the outline; move it, make it smaller or "
                "enlarge the outline"
            )
    for first, second in _near_pairs(rims):
        _refuse_meeting(rims[first], rims[second], _called(rims, first), _called(rims, second))
    if not len(holes.centres):
        return
    for k, rim in enumerate(rims):
        gaps = curves.distance(rim, holes.centres)
        gaps = np.where(curves.contains(rim, holes.centres), -gaps, gaps) - holes.radius
        nearest = int(np.argmin(gaps))
        if gaps[nearest] <= TOUCHING * holes.radius:
            raise GeometryError(
                f"[holes] {_called(rims, k)} and the round {name(holes, nearest)} overlap or "
                "touch; move them apart or make one smaller"
            )


def _refuse_meeting(one: Outline, other: Outline, first: str, second: str) -> None:
    nested = (
        curves.contains(one, middle(other)[None])[0] or curves.contains(other, middle(one)[None])[0]
    )
    if nested or _gap(one, other) <= _narrowest(one):
        raise GeometryError(
            f"[holes] {first} and {second} overlap or touch; move them apart or make one smaller"
        )


def _near_pairs(rims: Sequence[Outline]) -> Iterator[tuple[int, int]]:
    """Pairs of openings whose boxes meet."""
    boxes = np.array([curves.box(rim) for rim in rims]).reshape(-1, 4)
    for k in range(len(rims) - 1):
        after = boxes[k + 1 :]
        meets = np.all((after[:, :2] <= boxes[k, 2:]) & (boxes[k, :2] <= after[:, 2:]), axis=1)
        for other in np.flatnonzero(meets):
            yield k, k + 1 + int(other)


def _gap(rim: Outline, other: Outline) -> float:
    """The least distance [m] between two closed curves; 0 or less where they cross.

    From the middle of a circle, else from points along the rim.
    """
    if rim.kind == "circle":
        centre = middle(rim)[None]
        return float(curves.distance(other, centre)[0]) - rim.length / 2
    points = curves.polyline(rim, PER_TURN)
    within = curves.contains(other, points)
    if within.any() and not within.all():
        return 0.0
    return float(curves.distance(other, points).min())


def _narrowest(rim: Outline) -> float:
    """The least web of film [m] that counts as one."""
    return (TOUCHING if rim.kind == "circle" else NARROWEST) * rim.length


def _called(rims: Sequence[Outline], index: int) -> str:
    """Return what messages call an opening: its number, counted from 1, its place and its size."""
    rim = rims[index]
    axes = rim.segments[0].semi_axes
    what = f"of {rim.length * 1e6:.4g} um"
    if rim.kind == "circle":
        what = f"of radius {rim.length / 2 * 1e6:.4g} um"
    elif axes is not None:
        what = f"with semi-axes {axes[0] * 1e6:.4g} and {axes[1] * 1e6:.4g} um"
    return f"opening {index + 1} at {place(middle(rim))} {what}"
