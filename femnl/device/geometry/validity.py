"""Devices that no model of femnl holds for; docs/reference/limits.md lists the limits."""

import numpy as np

from femnl.core.device import Film, Overhang
from femnl.core.errors import GeometryError
from femnl.core.outline import Holes, Outline
from femnl.device.geometry import curves

THINNEST = 20.0
"""Width over thickness from which on a film is thin. Below, the shear that Kirchhoff's plate leaves
out changes frequencies by more than 1 %: Mindlin's plate, simply supported, by 3.4 (h/L)².
"""
FINEST = 1e-5
"""Least detail of a film over its length: a mesh that follows it along the whole edge is no larger
than a few million pieces, and the mesher tells places down to 1e-8 apart.
"""
DIRECTIONS = 180
"""Directions in which the width of an outline is measured."""


def refuse_thick(outline: Outline, film: Film) -> None:
    """Refuse a film that is too thick for its width to be a membrane or a thin plate.

    Source: Mindlin, J. Appl. Mech. 18, 31 (1951).
    Raises: GeometryError.
    """
    width = narrowest(outline)
    if width < THINNEST * film.thickness:
        raise GeometryError(
            f"[film] thickness = {film.thickness:.4g} m: the film is {width:.4g} m wide, and thin "
            f"films are at least {THINNEST:g} times as wide as thick; else shear, which femnl "
            "leaves out, counts by more than 1 %"
        )


def refuse_fine(
    outline: Outline, holes: Holes, openings: tuple[Outline, ...], overhang: Overhang | None
) -> None:
    """Refuse holes and overhangs that no mesh of the film can follow.

    Raises: GeometryError.
    """
    details = [(opening.length, "[holes]: a hole") for opening in openings]
    if len(holes.centres):
        details.append((2 * holes.radius, "[holes] radius: a hole"))
    if overhang is not None:
        details.append((overhang.width, "[overhang] width: a strip"))
    if not details:
        return
    size, what = min(details)
    if size < FINEST * outline.length:
        raise GeometryError(
            f"{what} of {size:.4g} m in a film of {outline.length:.4g} m is finer than "
            f"{FINEST:g} of its length, which no mesh follows; leave it out, or make it larger"
        )


def narrowest(outline: Outline) -> float:
    """Return the least width [m] of an outline between parallel lines, over DIRECTIONS of them."""
    points = curves.polyline(outline)
    angle = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    across = points @ np.stack([np.cos(angle), np.sin(angle)])
    return float(np.ptp(across, axis=0).min())
