"""Element sizes along the rims of openings of any shape."""

from collections.abc import Iterator

import gmsh
import numpy as np

from femnl.core.device import Model
from femnl.device.geometry.openings import polygon

ROUND = ("circle", "ellipse")
SEGMENTS = 12  # curved edges around a hole or opening
# The same of rims that are no circles or ellipses: where a line meets an arc the curvature jumps,
# and the error falls more slowly with the degree, measured at slots
JUMPS = 24
STEP = np.sqrt(2)  # sizes within this factor of each other count as one


def rim_sizes(
    model: Model, rims: dict[int, int], free: set[int], unit: float, largest: float
) -> Iterator[tuple[float, list[int]]]:
    """Yield element sizes along the rims of openings, and the curves that ask so.

    Free arcs ask for SEGMENTS or JUMPS a full turn of their circle. Rims that are no circles or
    ellipses ask for JUMPS all around, whatever they are made of.

    Args:
        model: the device.
        rims: gmsh's curve tags, and the opening that each is part of the rim of.
        free: tags of the curves among them that are not clamped.
        unit: of gmsh's lengths in 1 m.
        largest: element size far from everything, in gmsh's lengths.
    """
    drawn = {
        k: polygon(model.openings[k]).exterior.length * unit / JUMPS
        for k in set(rims.values())
        if model.openings[k].kind not in ROUND
    }
    jumping = [t for t in sorted(free) if rims[t] in drawn]
    smooth = [t for t in sorted(free) if rims[t] not in drawn]
    for curved, segments in ((smooth, SEGMENTS), (jumping, JUMPS)):
        for radius, arcs in arcs_by_radius(curved).items():
            yield 2 * np.pi * radius / segments, arcs
    around: dict[int, list[int]] = {}
    for tag, k in rims.items():
        if k in drawn and drawn[k] < largest:
            around.setdefault(round(np.log(drawn[k]) / np.log(STEP)), []).append(tag)
    for power, tags in around.items():
        yield float(STEP**power), tags


def arcs_by_radius(tags: list[int]) -> dict[float, list[int]]:
    """Return the arcs among gmsh's curves, by their least radius of curvature in scaled units."""
    arcs: dict[float, list[int]] = {}
    for tag in tags:
        if gmsh.model.getType(1, tag) != "Line":
            low, high = gmsh.model.getParametrizationBounds(1, tag)
            stops = np.linspace(low[0], high[0], 5)
            radius = 1 / np.max(gmsh.model.getCurvature(1, tag, list(stops)))
            arcs.setdefault(round(radius, 6), []).append(tag)
    return arcs
