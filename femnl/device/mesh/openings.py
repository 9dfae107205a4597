"""Element sizes along the rims of openings of any shape."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import gmsh
import numpy as np
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.core.outline import Outline
from femnl.device.geometry import curves as exact
from femnl.device.geometry.openings import polygon
from femnl.device.mesh.kernel import least_radius

Array = NDArray[np.float64]

ROUND = ("circle", "ellipse")
SEGMENTS = 12  # curved edges around a hole or opening
# The same of rims that are no circles or ellipses: where a line meets an arc the curvature jumps,
# and the error falls more slowly with the degree, measured at slots
JUMPS = 28
STEP = 1.2
"""Sizes within this factor share one field, since gmsh looks at every field at every place."""
FINE = 64
"""Pieces of a quarter of a circle by which sizes along an ellipse are found; as many times the
aspect of an ellipse, whose tips turn faster."""
AWAY = 0.5
"""Distance between edges and ellipse away from the tips, to the power 1/3, over that which edges of
the size of the tip would reach. At 1, elements leave masses and α of slender ellipses five times as
uncertain."""
AN_ELEMENT = 2
"""Places an element along an ellipse, which hide the gaps between them."""


@dataclass(frozen=True)
class Sized:
    """Curves (gmsh's tags) and places (n, 2) [m] that ask for elements of one size [gmsh's]."""

    size: float
    curves: list[int]
    places: Array


NOWHERE = np.empty((0, 2))


def rim_sizes(
    model: Model, rims: dict[int, int], free: set[int], unit: float, largest: float
) -> Iterator[Sized]:
    """Yield element sizes along the rims of openings.

    Free arcs ask for SEGMENTS or JUMPS a full turn of their circle of least radius, or for what
    `along_ellipse` says. Rims that are no circles or ellipses ask for JUMPS all around, whatever
    they are made of.

    Sizes that are alike become the least of them, but those of arcs of SEGMENTS the largest: gmsh
    rounds the number of elements on an arc up, and a little less would make four of three.

    Args:
        model: the device.
        rims: gmsh's curve tags, and the opening that each is part of the rim of.
        free: tags of the curves among them that are not clamped.
        unit: of gmsh's lengths in 1 m.
        largest: element size far from everything, in gmsh's lengths.
    """
    asked: list[Sized] = []
    jumping: list[int] = []
    smooth: dict[float, list[int]] = {}
    elliptical: set[int] = set()
    around: dict[int, float] = {}
    for tag, k in rims.items():
        rim = model.openings[k]
        if rim.kind not in ROUND:
            if k not in around:
                around[k] = polygon(rim).exterior.length * unit / JUMPS
            if around[k] < largest:
                asked.append(Sized(around[k], [tag], NOWHERE))
            if tag in free:
                jumping.append(tag)
        elif tag in free and _follows_tips(model, rim):
            elliptical.add(k)
        elif tag in free:
            radius = round(exact.radius(rim.segments[0]) * unit, 6)
            smooth.setdefault(radius, []).append(tag)
    for radius, arcs in arcs_by_radius(jumping).items():
        asked.append(Sized(2 * np.pi * radius / JUMPS, arcs, NOWHERE))
    for k in sorted(elliptical):
        sizes, places = along_ellipse(model.openings[k])
        octave = np.floor(np.log(sizes) / np.log(STEP))
        for each in np.unique(octave):
            within = octave == each
            asked.append(Sized(float(sizes[within].min()) * unit, [], places[within]))
    yield from (_joined(alike, alike[0].size) for alike in _groups(asked))
    circles = [Sized(2 * np.pi * r / SEGMENTS, tags, NOWHERE) for r, tags in smooth.items()]
    yield from (_joined(alike, alike[-1].size) for alike in _groups(circles))


def _follows_tips(model: Model, rim: Outline) -> bool:
    """Whether elements may grow along a round rim, away from the tips of an ellipse.

    Not without bending: across the flat sides of a slender ellipse nothing but a tension that
    falls to zero at the rim holds the film, and elements of every size leave modes that are none.
    """
    return model.bending and rim.segments[0].semi_axes is not None


def along_ellipse(rim: Outline) -> tuple[Array, Array]:
    """Return the sizes (n,) [m] of elements along an ellipse, and the places (n, 2) [m] of them.

    At a tip an element is 2π/SEGMENTS of the radius of curvature R = B²/A. An edge of length h is
    an arc of a circle through its ends and its middle, which leaves the ellipse by
    |dκ/ds| h³ / 72√3. Away from the tips elements grow so that each edge leaves the ellipse by
    AWAY³ of what one of the size of the tip would where dκ/ds is largest. They stay below
    2π/SEGMENTS of the local radius of curvature and of the longer half axis.
    """
    frame = rim.segments[0].frame
    short, long = sorted(np.linalg.norm(frame, axis=0))
    sizes, from_tip = _quarter(float(short / long))
    tip = np.argmax(np.linalg.norm(frame, axis=0)) * np.pi / 2
    angles = np.concatenate([from_tip, np.pi - from_tip, np.pi + from_tip, -from_tip]) + tip
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return long * np.tile(sizes, 4), np.asarray(rim.segments[0].centre) + circle @ frame.T


@cache
def _quarter(ratio: float) -> tuple[Array, Array]:
    """Sizes (n,) along a quarter of an ellipse of half axes 1 and `ratio`, and eccentric angles.

    The angles [rad] are counted from the tip; AN_ELEMENT of them stand for each element.
    """
    angle = np.linspace(0, np.pi / 2, int(np.ceil(FINE / ratio)) + 1)
    speed = np.sqrt(np.sin(angle) ** 2 + (ratio * np.cos(angle)) ** 2)  # ds/dφ
    change = 3 * ratio * (1 - ratio**2) * np.sin(angle) * np.cos(angle) / speed**6  # |dκ/ds|
    local = np.minimum(speed**3 / ratio, 1.0)
    worst = change.max() / np.maximum(change, 1e-9 * change.max())
    sizes = 2 * np.pi / SEGMENTS * np.minimum(local, AWAY * ratio**2 * np.cbrt(worst))
    density = speed / sizes
    number = np.append(0.0, np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(angle)))
    stops = np.linspace(0, number[-1], int(np.ceil(AN_ELEMENT * number[-1])) + 1)
    return np.interp(stops, number, sizes), np.interp(stops, number, angle)


def _groups(asked: list[Sized]) -> Iterator[list[Sized]]:
    """Part what asks for sizes, in their order, into groups within STEP."""
    ordered = sorted(asked, key=lambda one: one.size)
    while ordered:
        number = bisect_right(ordered, STEP * ordered[0].size, key=lambda one: one.size)
        yield ordered[:number]
        ordered = ordered[number:]


def _joined(alike: list[Sized], size: float) -> Sized:
    """Let all ask for one size."""
    curves = sorted({tag for one in alike for tag in one.curves})
    return Sized(size, curves, np.concatenate([one.places for one in alike]))


def arcs_by_radius(tags: list[int]) -> dict[float, list[int]]:
    """Return the arcs among gmsh's curves, by their least radius of curvature in scaled units."""
    arcs: dict[float, list[int]] = {}
    for tag in tags:
        if gmsh.model.getType(1, tag) != "Line":
            arcs.setdefault(round(least_radius(tag), 6), []).append(tag)
    return arcs
