"""Corners of an outline that make the deflection singular."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.types.device import Outline

Array = NDArray[np.float64]

CORNER_ERROR = 1e-8  # energy left unresolved at a singular corner, relative to that around it
PLATE_ERROR = 1e-5  # the same of the plate within the bending length, whose energy is a small part of all


def singular_corners(outline: Outline, resolution: float, layer: float) -> Iterator[tuple[Array, float, float]]:
    """Yield corners wider than 90°, their inner angle [rad] and the element size [m] there.

    Near a corner of inner angle β the deflection goes as r^(π/β), so that elements of size s leave an energy s^(2π/β). Within the
    bending length ℓ of a corner the film is a plate, whose deflection goes as r^(1 + λ) with λ ≥ π/β, or ½ where β > π: there
    elements need not be smaller than what leaves (s/ℓ)^(2λ).
    """
    for k, angle in outline.corners:
        if angle > np.pi / 2 + 1e-6:
            segment = outline.segments[k]
            side = np.linalg.norm(np.subtract(segment.end, segment.start))
            film = side * (CORNER_ERROR / resolution**8) ** (angle / (2 * np.pi))
            plate = layer * (PLATE_ERROR / resolution**8) ** (angle / (2 * np.pi) if angle <= np.pi else 1.0)
            yield np.array(segment.start), angle, float(max(film, plate))
