"""A perforated rectangle as tiles.

Cells of its lattice and pieces of the margin, one mesh for each kind of them.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from femnl.core.device import Model
from femnl.core.domain import Domain
from femnl.core.errors import ParameterError
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.geometry.placing import moved
from femnl.device.mesh import bending_length, distinct, film_middle, from_patches, mesh

Array = NDArray[np.float64]

QUARTER = np.pi / 2
EVEN = 1e-6  # of the pitch, to which the holes must lie on their lattice
# elements at the edge in bending lengths, and what they gain per distance
LAYER_SIZE = 1.5
GROWTH = 0.7
# Of the cells' own mesh, at least, and at small holes: large ones leave narrow necks
FINENESS = (0.7, 0.5)
WIDEST = 2.0  # pitches that a margin may be wide: it is one piece from the cells to the edge
# Pitches that the mesher takes for the outline's length, so that holes alone decide on the size of
# elements
SIZE = 12.5


@dataclass(frozen=True)
class Kind:
    """Tiles that are copies of each other.

    patches: the mesh of the first, where it lies; shifts (n, 2) [m]: those of all from there.
    """

    patches: Array
    shifts: Array

    @cached_property
    def mesh(self) -> MeshTri2:
        """The first tile, with the boundaries `free` (of a hole) and `side` (all else)."""
        found = from_patches(self.patches)
        low = found.p.min(axis=1)
        high = found.p.max(axis=1)
        outer = np.flatnonzero(found.f2t[1] < 0)
        ends = found.p[:, found.facets[:, outer]]
        side = np.zeros(len(outer), dtype=bool)
        for axis, places in enumerate(zip(low, high, strict=True)):
            for place in places:
                side |= np.all(np.abs(ends[axis] - place) < 1e-9 * (high - low).max(), axis=0)
        return replace(found, _boundaries={"side": outer[side], "free": outer[~side]})


@dataclass(frozen=True)
class Tiling:
    """A quarter of the film, x > 0 and y > 0 from its middle, in tiles of the given resolution.

    model: the film, moved so that its middle is the origin. device: the film where it lies. `half`
    (2,) [m] are half its sides.
    """

    model: Model
    device: Model
    resolution: float
    half: Array
    kinds: tuple[Kind, ...]

    @cached_property
    def domain(self) -> Domain:
        """The mesh of all tiles, kind by kind, tile by tile."""
        patches = [
            (kind.patches[None] + kind.shifts[:, None, None]).reshape(-1, 6, 2)
            for kind in self.kinds
        ]
        whole = from_patches(np.concatenate(patches))
        outer = np.flatnonzero(whole.f2t[1] < 0)
        x, y = whole.p[:, whole.facets[:, outer]]
        near = 1e-9 * self.half.max()
        on = {
            "mirror-0": np.all(np.abs(y) < near, axis=0),
            "mirror-1": np.all(np.abs(x) < near, axis=0),
            "clamped": np.all(np.abs(x - self.half[0]) < near, axis=0)
            | np.all(np.abs(y - self.half[1]) < near, axis=0),
        }
        on["free"] = ~np.any(list(on.values()), axis=0)
        named = replace(whole, _boundaries={name: outer[found] for name, found in on.items()})
        return Domain(self.model, named, QUARTER, tiles=self.resolution)


def _is_box(outline: Outline) -> bool:
    """Return whether an outline is four straight lines along x and y, however it was written."""
    steps = [np.subtract(s.end, s.start) for s in outline.segments if s.centre is None]
    upright = [np.min(np.abs(step)) < EVEN * outline.length for step in steps]
    return len(outline.segments) == 4 and len(steps) == 4 and all(upright)


def placed_domain(tiling: Tiling) -> Domain:
    """Return the mesh of all tiles where the device lies."""
    x, y = film_middle(tiling.device)
    if x == 0 and y == 0:
        return tiling.domain
    found = tiling.domain.mesh
    mesh = replace(found, doflocs=found.doflocs + np.array([[x], [y]]))
    return replace(tiling.domain, model=tiling.device, mesh=mesh, middle=(float(x), float(y)))


def _centred(model: Model) -> Model:
    """Return the film moved so that its middle is the origin."""
    middle = film_middle(model)
    return moved(model, -middle) if middle.any() else model


def array(model: Model, what: str) -> tuple[float, tuple[int, int]]:
    """Return the pitch [m] and the numbers of holes along x and y of a rectangular array of holes.

    The array lies in the centre of a rectangle about the origin.

    Args: what: needs it, for the message. Raises: ParameterError where the device is no such thing.
    """
    outline = model.outline
    centres = model.holes.centres
    if not _is_box(outline):
        raise ParameterError(
            f'{model.name}: outline.kind = "{outline.kind}": {what} needs a square or rectangle '
            "along x and y, with sharp corners"
        )
    if model.openings:
        raise ParameterError(
            f"{model.name}: {what} needs holes that are all round, free and of one radius"
        )
    columns = [_columns(places, EVEN * outline.length) for places in centres.T]
    steps = np.concatenate([np.diff(c) for c in columns])
    if len(steps) == 0 or len(centres) != len(columns[0]) * len(columns[1]):
        raise ParameterError(
            f"{model.name}: holes: {what} needs a rectangular array of at least two of them"
        )
    pitch = float(steps.mean())
    if np.abs(steps - pitch).max() > EVEN * pitch or any(
        abs(c[0] + c[-1]) > EVEN * pitch for c in columns
    ):
        raise ParameterError(
            f"{model.name}: holes: {what} needs one pitch along x and y, and the array in "
            "the centre"
        )
    return pitch, (len(columns[0]), len(columns[1]))


def _columns(places: Array, apart: float) -> Array:
    """Return the places (n,) rising, the mean of those that differ by less than `apart` as one."""
    number = distinct(places, apart)
    return np.asarray(np.bincount(number, places) / np.bincount(number))


def obstacle(model: Model) -> str:
    """Return the why a device cannot be cut into tiles; empty where it can."""
    model = _centred(model)
    try:
        pitch, counts = array(model, "a tiled film")
    except ParameterError as error:
        return str(error)
    if model.layers:
        return f"{model.name}: a tiled film carries no layers"
    margin = _half(model) - np.array(counts) * pitch / 2
    if np.any(margin <= EVEN * pitch) or np.any(margin > WIDEST * pitch):
        return (
            f"{model.name}: a tiled film needs a margin around the cells of its holes, of "
            f"{WIDEST:g} pitches at most"
        )
    if (
        not (model.clamp.rigid and all(s.clamped for s in model.outline.segments))
        or model.overhang
        or any(model.film.gradient)
    ):
        return (
            f"{model.name}: a tiled film needs a rigid edge all around without overhang, and "
            "a film without gradient"
        )
    return ""


def _half(model: Model) -> Array:
    return np.asarray(np.abs([s.start for s in model.outline.segments]).max(axis=0))


def tile(model: Model, resolution: float = 1.0) -> Tiling:
    """Cut a quarter of the film into tiles.

    Args: resolution: factor on the number of elements per length. Raises: ParameterError for
    devices that have no such tiles.
    """
    if why := obstacle(model):
        raise ParameterError(why)
    device = model
    model = _centred(device)
    pitch, counts = array(model, "a tiled film")
    half = _half(model)
    fineness = resolution * max(FINENESS[0], FINENESS[1] + 2 * model.holes.radius / pitch)
    quarter = _quarter(model, pitch, fineness)
    corners = quarter[:, :3].reshape(-1, 2)
    side = np.unique(np.round(corners[np.abs(corners[:, 0] - pitch / 2) < 1e-9 * pitch, 1], 15))
    along = [_stretches(pitch, n, edge) for n, edge in zip(counts, half, strict=True)]
    layer = bending_length(model)
    kinds = []
    for (name_x, starts_x), (name_y, starts_y) in product(along[0].items(), along[1].items()):
        first = np.array([starts_x[0], starts_y[0]])
        if "margin" in (name_x, name_y):
            lines = [
                _margin(half[k] - starts[0], layer, fineness, side[-1] / max(len(side) - 1, 1))
                if name == "margin"
                else _whole(side, pitch)
                if name == "whole"
                else side
                for k, (name, starts) in enumerate(((name_x, starts_x), (name_y, starts_y)))
            ]
            patches = _grid(*lines)
        else:
            patches = _cell(quarter, pitch, name_x, name_y)
        shifts = np.stack(np.meshgrid(starts_x, starts_y, indexing="ij"), -1).reshape(-1, 2) - first
        kinds.append(Kind(patches + first, shifts))
    return Tiling(model, device, resolution, half, tuple(kinds))


def _stretches(pitch: float, n: int, edge: float) -> dict[str, Array]:
    """Return where tiles start along one axis, by what they are.

    Half a cell at the centre if n is odd, whole cells, the margin.
    """
    found: dict[str, Array] = {"half": np.zeros(1)} if n % 2 else {}
    wholes = pitch * ((n % 2) / 2 + np.arange(n // 2, dtype=float))
    if len(wholes):
        found["whole"] = wholes
    return found | {"margin": np.array([n * pitch / 2])}


def _quarter(model: Model, pitch: float, resolution: float) -> Array:
    """Triangles (m, 6, 2) of a quarter of a cell, x > 0 and y > 0, its own image under x ↔ y."""
    reach = pitch / 2
    corners = [(-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)]
    sides = tuple(Segment(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True))
    outline = Outline("rectangle", sides, None, SIZE * pitch)
    cell = replace(
        model, outline=outline, holes=Holes(np.zeros((1, 2)), model.holes.radius), bending=False
    )
    found = mesh(cell, "quarter", resolution).mesh
    places = np.asarray(found.doflocs).T.copy()
    for line in (0.0, reach):  # so that tiles meet exactly
        places[np.abs(places - line) < 1e-9 * pitch] = line
    return np.concatenate([places[found.t.T], places[found.nvertices + found.t2f.T]], axis=1)


def _cell(quarter: Array, pitch: float, name_x: str, name_y: str) -> Array:
    """Return a whole cell, or the half or quarter beside mirrors, from its corner at the origin."""
    patches = quarter
    for axis, name in enumerate((name_x, name_y)):
        if name == "whole":
            flip = np.ones(2)
            flip[axis] = -1
            patches = np.concatenate([patches, patches * flip])
    return np.asarray(
        patches + np.array([pitch / 2 if name == "whole" else 0.0 for name in (name_x, name_y)])
    )


def _whole(side: Array, pitch: float) -> Array:
    return np.concatenate([pitch / 2 - side[::-1], pitch / 2 + side[1:]])


def _margin(width: float, layer: float, resolution: float, size: float) -> Array:
    """Return places from 0 to the width, closer towards the clamped edge there."""
    places = [0.0]
    while places[-1] < width:
        finest = LAYER_SIZE * layer / resolution if layer else size
        places.append(places[-1] + min(size, finest + GROWTH / resolution * places[-1]))
    found = width - np.array(places[::-1]) * width / places[-1]
    return np.asarray(found)


def _grid(x: Array, y: Array) -> Array:
    """Return triangles (m, 6, 2) of rows and columns between the given places.

    Each rectangle is cut along its rising diagonal.
    """
    corner = np.stack(np.meshgrid(x, y, indexing="ij"), -1)
    a = corner[:-1, :-1]
    b = corner[1:, :-1]
    c = corner[1:, 1:]
    d = corner[:-1, 1:]
    triangles = np.concatenate([np.stack(t, -2).reshape(-1, 3, 2) for t in ((a, b, c), (a, d, c))])
    middles = (triangles + np.roll(triangles, -1, axis=1)) / 2
    return np.concatenate([triangles, middles[:, [0, 1, 2]]], axis=1)
