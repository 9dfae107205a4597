"""Layouts drawn by gdstk for tests, as a designer draws them."""

from collections.abc import Sequence
from pathlib import Path

import gdstk
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Point = tuple[float, float]

CHORD = 1e-3  # µm, by which gdstk's chords may leave a curve: finer than any mask


def write(path: Path, *polygons: gdstk.Polygon, name: str = "DEVICE") -> Path:
    """Write polygons in µm on a grid of 1 nm into one cell."""
    library = gdstk.Library(unit=1e-6, precision=1e-9)
    library.new_cell(name).add(*polygons)
    library.write_gds(path, max_points=8190)
    return path


def circle(radius: float, at: Point = (0.0, 0.0), layer: int = 2) -> gdstk.Polygon:
    """Return a circle drawn as chords."""
    return gdstk.ellipse(at, radius, tolerance=CHORD, layer=layer)


def box(width: float, height: float, at: Point = (0.0, 0.0), layer: int = 1) -> gdstk.Polygon:
    """Return an upright rectangle about a point."""
    x, y = at
    low = (x - width / 2, y - height / 2)
    return gdstk.rectangle(low, (x + width / 2, y + height / 2), layer=layer)


def trampoline(fillet: float = 15.0, moved: Point = (0.0, 0.0)) -> list[gdstk.Polygon]:
    """Return pad and tethers with fillets on layer 1, a hole on 2 and the window on 3."""
    parts = [box(120, 120), box(500, 6), box(6, 500)]
    film = gdstk.boolean(parts[:1], parts[1:], "or", layer=1)[0]
    ends = [fillet if max(abs(x), abs(y)) < 249 else 0.0 for x, y in film.points]
    film.fillet(ends, tolerance=CHORD)
    drawn = [film, circle(5), box(500, 500, layer=3)]
    for polygon in drawn:
        polygon.translate(*moved)
    return drawn


def from_points(points: Sequence[Point] | Array, layer: int = 1) -> gdstk.Polygon:
    """Return a polygon."""
    return gdstk.Polygon(np.asarray(points).tolist(), layer=layer)
