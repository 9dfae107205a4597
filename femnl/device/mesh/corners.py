"""Corners of the film that make the deflection singular."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.device.mesh.openings import ROUND

Array = NDArray[np.float64]

# Energy left unresolved at a singular corner, relative to that around it, by elements of degree 4
CORNER_ERROR = 1e-8
# By which it falls a degree, as the rest does: a corner's part falls slowly with the degree, so
# that it would be left, and three degrees would not show it. At corners beyond 180° bars count it.
CORNER_FALL = 0.1
# Element size over ℓ: the bending stiffness of smaller ones drowns that of the film in rounding
# errors
SMALLEST = 1e-2
# rad: a turn by less, as where an arc is rounded to a drawing's grid, makes a singularity whose
# strength goes as the turn and whose energy as its square, 1e-5 of that of a corner
KINK = 3e-3
# Element size over the film's length, which gmsh's tolerances allow: smaller ones fold over
LEAST = 1e-7
RIM_CORNER = 1e-3  # element size over side where film and overhang meet in a corner
# The same of the plate within the bending length, whose energy is a small part of all
PLATE_ERROR = 1e-5

# The same where the edge passes from clamped to free, within the film around that corner, which is
# a small part of most
PASSING_ERROR = 1e-5


def singular_corners(
    model: Model, resolution: float, layer: float, degree: int
) -> Iterator[tuple[Array, float, float]]:
    """Yield corners of the edges wider than 90°, the film's angle [rad] and element size [m].

    And all corners where two films meet.

    Near a corner of inner angle β the deflection goes as r^(π/β), so that elements of size s leave
    an energy s^(2π/β). Within the bending length ℓ of a corner the film is a plate, whose
    deflection goes as r^(1 + λ) with λ ≥ π/β, or ½ where β > π: there elements need not be smaller
    than what leaves (s/ℓ)^(2λ). Where film and overhang meet, the corner is only as strong as the
    two differ.

    Where an edge passes from clamped to free, the deflection goes as r^(π/2β), and the displacement
    in the plane as r^λ with λ about 3π/8β or more (0.79 at 90° and ν = 0.23: Williams, J. Appl.
    Mech. 19, 526 (1952)), also within the bending length.
    """
    yield from _passing_corners(model, resolution, layer, degree)
    least = LEAST * model.outline.length
    corners = [(model.edge_outline.segments[k], angle) for k, angle in model.edge_outline.corners]
    for rim in model.openings:
        if rim.kind in ROUND:
            continue
        corners += [(rim.segments[k], 2 * np.pi - angle) for k, angle in rim.corners]
    for segment, angle in corners:
        if angle > np.pi / 2 + 1e-6 and abs(angle - np.pi) > KINK:
            side = float(np.linalg.norm(np.subtract(segment.end, segment.start)))
            fall = CORNER_FALL ** max(degree - 4, 0) if angle <= np.pi else 1.0
            film = side * (CORNER_ERROR * fall / resolution**8) ** (angle / (2 * np.pi))
            plate = layer * max(
                (PLATE_ERROR / resolution**8) ** (angle / (2 * np.pi) if angle <= np.pi else 1.0),
                SMALLEST,
            )
            yield np.array(segment.start), angle, float(max(film, plate, least))
    for k, angle in model.outline.corners if model.overhang is not None else ():
        segment = model.outline.segments[k]
        side = float(np.linalg.norm(np.subtract(segment.end, segment.start)))
        yield np.array(segment.start), angle, max(RIM_CORNER * side, layer / 10) / resolution


def _passing_corners(
    model: Model, resolution: float, layer: float, degree: int
) -> Iterator[tuple[Array, float, float]]:
    """Yield where an edge passes from clamped to free, the film's angle and the element size."""
    segments = model.edge_outline.segments
    for k, angle in model.edge_outline.passing_corners:
        chords = [np.subtract(each.end, each.start) for each in (segments[k - 1], segments[k])]
        side = min(float(np.linalg.norm(chord)) for chord in chords)
        left = PASSING_ERROR * CORNER_FALL ** max(degree - 4, 0) / resolution**8
        size = side * left ** (4 * angle / (3 * np.pi))
        yield np.array(segments[k].start), angle, float(max(size, SMALLEST * layer))
