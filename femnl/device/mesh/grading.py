"""Where elements are small: at clamped edges, corners, arcs, holes and webs."""

from dataclasses import dataclass
from itertools import compress

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from femnl.core.device import Model
from femnl.core.outline import CELL
from femnl.device.geometry import curves as exact
from femnl.device.mesh.corners import singular_corners
from femnl.device.mesh.kernel import kernel_of
from femnl.device.mesh.openings import SEGMENTS as HOLE_SEGMENTS
from femnl.device.mesh.openings import STEP, arcs_by_radius, rim_sizes
from femnl.device.mesh.sizes import Sizes
from femnl.device.mesh.symmetry import FULL, beyond_mirrors
from femnl.device.mesh.waves import elements_a_wave
from femnl.device.mesh.webs import Pieces, narrow_webs, pieces_of

Array = NDArray[np.float64]

# gmsh's geometry kernel has absolute tolerances near 1e-7: it works on coordinates scaled to this
# many units per outline length.
SCALE = 100.0
TOLERANCE = 1e-6  # of a point lying on a curve, in scaled units

# Element size gained per distance from the feature that asks for small elements, at resolution 1.
# Coarser meshes grade no more steeply: what fades as a power of the distance is resolved by the
# ratio of distances across an element, and gmsh cannot follow a size that grows faster than the
# distance.
GROWTH = 0.7
# The same away from holes, whose fields fade faster than those of edges and corners
HOLE_GROWTH = 1.0
ALIKE = 1.05  # sizes at corners within this factor share one field, of the least of them
ELEMENTS_ACROSS = 3  # elements across the narrowest place of a strip, such as a tether
ARC_SEGMENTS = 64  # curved edges per full turn of an outline arc
ELEMENTS_PER_LENGTH = 12  # elements across the outline far from every feature
# Times the triangles along a straight line as long, measured: the film widens away from a hole
AROUND_HOLES = 3
AROUND_OPENINGS = 2.2  # the same of mixed shapes
BESIDE_LAYERS = 12  # elements along the length of a layer, at its rim
ROUNDED = 0.01  # part of an element that gmsh leaves out where it rounds their number up
LAYER_SIZE = 1.5  # element size at clamped edges in units of the bending length ℓ = √(D/σh)


@dataclass(frozen=True)
class Curves:
    """gmsh's curve tags by what they are."""

    clamped: list[int]
    free: list[int]
    holes: list[int]
    mirrors: tuple[list[int], list[int]]
    rim: list[int]  # between film and overhang
    segment: dict[int, int]  # the edge's segment that a clamped or free curve is part of
    openings: list[int]  # free rims of openings; clamped ones are among the clamped curves
    rims: dict[int, int]  # the opening on whose rim a curve lies

    def add_to_rim(self, tag: int, index: int, model: Model) -> None:
        """Add a curve of the rim of one of the model's openings."""
        self.rims[tag] = index
        (self.clamped if model.openings[index].segments[0].clamped else self.openings).append(tag)


@dataclass(frozen=True)
class Fineness:
    """How fine a mesh shall be: resolution, degree and wave as of `mesh`."""

    resolution: float
    degree: int
    wave: float


def grade(model: Model, curves: Curves, wedge: float, unit: float, fineness: Fineness) -> float:
    """Set the element size h.

    It grows linearly with the distance from clamped edges, arcs, corners, holes and narrow webs.

    Args: curves: of the model that gmsh holds, scaled by `unit`. wedge: the part of it that is
        meshed.
    Returns: about how many triangles that makes: ∫ dA / (h²√3/4), where every curve of length l
        adds ∫ l dx / (s + g x)² = l / (s g), and every corner of angle β ∫ βr dr / (s + g r)² = β
        (ln h/s − 1) / g².
    """
    far = SCALE / ELEMENTS_PER_LENGTH / fineness.resolution
    following = fineness.wave * unit / elements_a_wave(fineness.resolution)
    kernel = kernel_of(model, wedge)
    sizes = Sizes(fineness.resolution, min(far, following), kernel, [], [], {})
    rounds = {} if kernel is gmsh.model.occ else _round_rims(model, curves)
    for k, tags in rounds.items():
        around = 2 * np.pi * exact.radius(model.openings[k].segments[0]) * unit
        sizes.lengths.update(dict.fromkeys(tags, around / len(tags)))
    area = _area(model) * unit**2 * wedge / FULL
    sizes.inverse_square.append(area / sizes.largest**2)
    _grade_rims(sizes, model, curves, wedge, unit)
    if model.outline.kind != CELL:
        _grade_edges(sizes, model, curves, unit)
        _grade_corners(sizes, model, unit, fineness.degree)
    if not model.pierced:
        return sizes.set()
    rim = _size_along_rims(sizes, model, unit)
    pieces = pieces_of(model, rim / 2)
    _grade_webs(sizes, narrow_webs(pieces, rim), wedge, unit)
    triangles = sizes.set()
    if rounds:
        _space_evenly(sizes, model, rounds, pieces, unit)
    return triangles


def _area(model: Model) -> float:
    """Return the area of the film [m²]."""
    open_area = sum(exact.area(opening) for opening in model.openings)
    holes = len(model.holes.centres) * np.pi * model.holes.radius**2
    return float(exact.area(model.edge_outline) - open_area - holes)


def _grade_rims(sizes: Sizes, model: Model, curves: Curves, wedge: float, unit: float) -> None:
    if curves.holes:
        rim = 2 * np.pi * model.holes.radius * unit / HOLE_SEGMENTS / sizes.grading
        sizes.grow_from_curves(rim, curves.holes, HOLE_GROWTH, AROUND_HOLES)
    free = set(curves.openings)
    for sized in rim_sizes(model, curves.rims, free, unit, SCALE / ELEMENTS_PER_LENGTH):
        size = sized.size / sizes.grading
        within = sized.places[beyond_mirrors(sized.places, wedge) < size / unit]
        points = sizes.points(within * unit)
        sizes.grow_from_curves(size, sized.curves, HOLE_GROWTH, AROUND_OPENINGS, points)


def _size_along_rims(sizes: Sizes, model: Model, unit: float) -> float:
    """Return the largest size [m] of elements along a rim: of the widest arc, and of any line."""
    segments = [s for opening in model.openings for s in opening.segments]
    radii = [model.holes.radius, *(exact.radius(s) for s in segments)]
    largest = sizes.largest / unit
    if any(s.centre is None for s in segments):  # which may ask for no size themselves
        return largest
    return min(2 * np.pi * max(radii) / HOLE_SEGMENTS, largest)


def _grade_webs(sizes: Sizes, webs: dict[float, Array], wedge: float, unit: float) -> None:
    for size, places in webs.items():
        within = places[beyond_mirrors(places, wedge) < size]
        if len(within):
            grown = size * unit / sizes.grading
            sizes.grow_from_points(grown, sizes.points(within * unit), HOLE_GROWTH)
            # Each place stands for a square of its size
            sizes.inverse_square.append(len(within) * sizes.grading**2)


def _round_rims(model: Model, curves: Curves) -> dict[int, list[int]]:
    """Return the arcs on the rim of each free round opening of a film that is not cut."""
    arcs: dict[int, list[int]] = {}
    free = set(curves.openings)
    for tag, k in curves.rims.items():
        if tag in free and model.openings[k].kind == "circle":
            arcs.setdefault(k, []).append(tag)
    return arcs


def _space_evenly(
    sizes: Sizes, model: Model, arcs: dict[int, list[int]], pieces: Pieces, unit: float
) -> None:
    """Set the number of elements on the arcs of round rims that nothing is near to.

    gmsh has to know the fields of sizes before, and forgets these numbers with new ones. It
    would look at the sizes at more than a hundred places of each arc, to find one all along it.

    arcs: gmsh's curves on the rim of each of these openings.
    """
    circles = [model.openings[k].segments[0] for k in arcs]
    radii = np.array([exact.radius(circle) for circle in circles])
    rim = 2 * np.pi * radii
    # Beyond it, sizes that grow from elsewhere are larger than those along the rim
    reach = radii + STEP * rim / HOLE_SEGMENTS / GROWTH
    first = (model.outline.kind != CELL) + len(model.holes.centres)
    centres = np.array([circle.centre for circle in circles])
    alone = pieces.alone(first + np.array(list(arcs)), centres, reach)
    asked = np.minimum(rim * unit / HOLE_SEGMENTS / sizes.grading, sizes.largest)
    elements = rim * unit / asked
    for tags, around in zip(compress(arcs.values(), alone), elements[alone], strict=True):
        number = int(np.ceil(around / len(tags) - ROUNDED))
        for tag in tags:
            gmsh.model.mesh.setTransfiniteCurve(tag, number + 1)


def _grade_edges(sizes: Sizes, model: Model, curves: Curves, unit: float) -> None:
    layer = LAYER_SIZE * bending_length(model) * unit
    if model.bending and curves.clamped:
        sizes.grow_from_curves(layer / sizes.resolution, curves.clamped, GROWTH)
    if model.overhang is not None:
        rim = model.overhang.width * unit / ELEMENTS_ACROSS
        size = min(layer, rim) if model.bending else rim
        sizes.grow_from_curves(size / sizes.resolution, curves.rim, GROWTH)
    if model.layers and curves.rim:
        size = largest_beside_layers(model) * unit
        sizes.grow_from_curves(size / sizes.resolution, curves.rim, GROWTH)
    for radius, arcs in arcs_by_radius(curves.clamped + curves.free + curves.rim).items():
        size = 2 * np.pi * radius / ARC_SEGMENTS / sizes.resolution
        sizes.grow_from_curves(size, arcs, GROWTH)
    for index, width in enumerate(exact.widths(model.edge_outline)):
        tags = [t for t, k in curves.segment.items() if k == index]
        if tags and width * unit < ELEMENTS_ACROSS * sizes.largest:
            size = width * unit / ELEMENTS_ACROSS / sizes.resolution
            # The strip ends in its middle, where elements would grow on beyond
            grown = GROWTH / sizes.grading * width * unit / 2
            sizes.grow_from_curves(size, tags, GROWTH, grown / (size + grown))


def _grade_corners(sizes: Sizes, model: Model, unit: float, degree: int) -> None:
    layer = bending_length(model)
    corners = list(singular_corners(model, sizes.resolution, layer, degree))
    if not corners:
        return
    tags = [tag for _, tag in gmsh.model.getEntities(0)]
    ends = cKDTree([gmsh.model.getValue(0, tag, [])[:2] for tag in tags])
    alike: dict[int, list[tuple[float, int]]] = {}
    for corner, angle, size in corners:
        for k in ends.query_ball_point(corner * unit, TOLERANCE):
            step = int(np.floor(np.log(size * unit) / np.log(ALIKE)))
            alike.setdefault(step, []).append((size * unit, tags[k]))
            fan = max(np.log(sizes.largest / (size * unit)) - 1, 0.0)
            sizes.inverse_square.append(angle * (sizes.grading / GROWTH) ** 2 * fan)
    for group in alike.values():
        sizes.grow_from_points(min(size for size, _ in group), [tag for _, tag in group], GROWTH)


def largest_beside_layers(model: Model) -> float:
    """Return the size [m] of elements along the rims of layers: a twelfth of the longest rim."""
    rims = [rim for lamina in model.layers for rim in lamina.rims]
    return max(rim.length for rim in rims) / BESIDE_LAYERS


def bending_length(model: Model) -> float:
    """Return ℓ = √(D/σh) [m], the width of the layer that bending makes at a clamped edge.

    0 without bending, L at most.
    """
    film = model.film
    length = model.outline.length
    if not model.bending:
        return 0.0
    squared = film.young * film.thickness**2 / 12 / (1 - film.poisson**2)
    return float(length if film.stress * length**2 <= squared else np.sqrt(squared / film.stress))
