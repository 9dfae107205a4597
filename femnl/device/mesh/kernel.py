"""Which of gmsh's two kernels draws a film, and measures of what it has drawn."""

from typing import Any

import gmsh
import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.device.mesh.symmetry import FULL

Array = NDArray[np.float64]

STOPS = np.linspace(0, 1, 9)
"""Parts of a curve between which its length is taken along chords, to 2e-3 of a quarter turn."""


def kernel_of(model: Model, wedge: float) -> Any:
    """Return the module of gmsh that draws a film.

    OpenCASCADE cuts and splits surfaces, and draws any ellipse. gmsh's own kernel does neither, but
    places the points of a surface in half the time: it draws what has only lines and circles and
    is not cut.
    """
    loops = (model.edge_outline, *model.openings)
    elliptical = any(s.semi_axes is not None for loop in loops for s in loop.segments)
    cut = wedge < FULL or model.overhang is not None or bool(model.layers)
    return gmsh.model.occ if cut or elliptical else gmsh.model.geo


def length(tag: int, kernel: Any) -> float:
    """Return the length of a curve, in gmsh's lengths; OpenCASCADE knows it."""
    if kernel is gmsh.model.occ:
        return float(kernel.getMass(1, tag))
    places = _places(tag, [0.0, 1.0] if gmsh.model.getType(1, tag) == "Line" else list(STOPS))
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def least_radius(tag: int) -> float:
    """Return the least radius of curvature of an arc of the model, in gmsh's lengths.

    Of a circle it is that of the circle through three places, since gmsh's own kernel has no exact
    curvature.
    """
    if gmsh.model.getType(1, tag) == "Circle":
        a, b, c = _places(tag, [0.0, 1 / 3, 2 / 3])
        sides = np.linalg.norm([b - a, c - b, a - c], axis=1)
        height = np.cross(b - a, c - a)[2]
        return float(np.prod(sides) / (2 * abs(height)))
    low, high = gmsh.model.getParametrizationBounds(1, tag)
    stops = np.linspace(low[0], high[0], 5)
    return float(1 / np.max(gmsh.model.getCurvature(1, tag, list(stops))))


def _places(tag: int, fractions: list[float]) -> Array:
    """Return the places (n, 3) at fractions of the range of a curve's parameter."""
    low, high = gmsh.model.getParametrizationBounds(1, tag)
    stops = [low[0] + fraction * (high[0] - low[0]) for fraction in fractions]
    return np.reshape(gmsh.model.getValue(1, tag, stops), (-1, 3))
