"""Devices that no model of femnl holds for; docs/reference/limits.md lists the limits."""

import numpy as np

from femnl.core.device import Film
from femnl.core.errors import GeometryError
from femnl.core.outline import Outline
from femnl.device.geometry import curves

THINNEST = 20.0
"""Width over thickness from which on a film is thin. Below, the shear that Kirchhoff's plate leaves
out changes frequencies by more than 1 %: Mindlin's plate, simply supported, by 3.4 (h/L)².
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


def narrowest(outline: Outline) -> float:
    """Return the least width [m] of an outline between parallel lines, over DIRECTIONS of them."""
    points = curves.polyline(outline)
    angle = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    across = points @ np.stack([np.cos(angle), np.sin(angle)])
    return float(np.ptp(across, axis=0).min())
