"""Mode shapes as functions: their largest value, canonical pairs, labels."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from femnl.core.domain import Domain
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import CHUNK
from femnl.mechanics.fem.reference import EDGES, VERTICES, reference_basis
from femnl.mechanics.fem.sheet import Sheet

Array = NDArray[np.float64]

SAMPLES = 6  # points along an edge of a triangle at which shapes are searched for their maximum
LATTICE = np.array([(a, b) for a in range(SAMPLES + 1) for b in range(SAMPLES + 1 - a)]) / SAMPLES
BETWEEN = 0.05  # relative height by which the samples of the triangle with the maximum may miss it
RIM = 3.0
TOP = 1e-3  # relative height below the maximum up to which triangles count as holding it
STEPS = 8  # of Newton's method towards a maximum


def largest_value(space: Space, shape: Array) -> float:
    """Return value of largest magnitude that a shape takes, with its sign; see `largest_values`."""
    return float(largest_values(space, shape[None])[0])


def largest_values(space: Space, shapes: Array) -> Array:
    """Return the values (n,) of largest magnitude that shapes (n, size) take, with their signs.

    The first in the mesh's order among equals.

    A lattice of points finds the triangles that may hold it, Newton's method in them and along
    their edges the extremum, of all shapes at once.
    """
    lattice = reference_basis(space.degree, LATTICE).T
    bends = [reference_basis(space.degree, LATTICE, d).T for d in ((2, 0), (1, 1), (0, 2))]
    highest = [_highest_triangles(space, shape, lattice, bends) for shape in shapes]
    local = np.concatenate(highest)
    sampled = local @ lattice
    start = np.argmax(np.abs(sampled), axis=1)
    each = np.arange(len(local))
    height = np.abs(sampled[each, start])
    sign = np.sign(sampled[each, start])
    local = local * sign[:, None]
    found = [height, _climb(space.degree, local, LATTICE[start], np.eye(2))]
    found += [
        _climb(
            space.degree, local, (VERTICES[a] + VERTICES[b]) / 2, (VERTICES[b] - VERTICES[a])[None]
        )
        for a, b in EDGES
    ]
    ends = np.cumsum([len(own) for own in highest])[:-1]
    result = np.empty(len(shapes))
    peaks = np.split(np.max(found, axis=0), ends)
    for k, (peak, signs) in enumerate(zip(peaks, np.split(sign, ends), strict=True)):
        result[k] = np.max(peak) * signs[np.argmax(peak >= np.max(peak) * (1 - 1e-6))]
    return result


def _highest_triangles(space: Space, shape: Array, lattice: Array, bends: list[Array]) -> Array:
    """Values (m, n_basis) at the nodes of the triangles that may hold the largest value of a shape.

    Args: lattice (n_basis, p): the basis at points. bends: its second derivatives there.
    """
    heights = np.abs(shape[space.dofs] @ lattice).max(axis=1)
    near = np.flatnonzero(heights >= heights.max() * (1 - BETWEEN))
    local = shape[space.dofs[near]]
    bend = sum(np.abs(local @ second).max(axis=1) for second in bends)
    # From the nearest point of the lattice to the maximum the value rises by half the bend times
    # the distance squared, at most.
    may = heights[near] + bend / (2 * SAMPLES) ** 2 >= heights.max()
    return np.asarray(local[may])


def largest_departure(space: Space, shape: Array, other: Array) -> float:
    """Return the largest difference of two shapes in the triangles where the first is largest.

    Relative to its largest value.

    At a free edge the elements converge more slowly than the difference of two degrees shows: there
    it counts `RIM` times.
    """
    basis = reference_basis(space.degree, LATTICE).T
    sampled = np.abs(shape[space.dofs] @ basis).max(axis=1)
    highest = np.flatnonzero(sampled >= sampled.max() * (1 - TOP))
    touching = np.isin(space.mesh.t2f[:, highest], space.boundary_facets("free"))
    largest = float(np.abs((shape - other)[space.dofs[highest]] @ basis).max() / sampled.max())
    return RIM * largest if np.any(touching) else largest


def _climb(degree: int, local: Array, start: Array, directions: Array) -> Array:
    """Climb functions (n, n_basis) of triangles along directions (d, 2) by Newton's method.

    Return the values (n,) where it ends.

    Points stay in their triangle: a step that leaves it ends at its border.
    """
    place = np.broadcast_to(start, (len(local), 2))
    highest = np.full(len(local), -np.inf)
    # Of a bend, which vanishes along edges where the function does
    least = 1e-9 * np.abs(local).max(axis=1, keepdims=True)
    for _ in range(STEPS):
        value, gx, gy, xx, xy, yy = (
            np.einsum("nj,nj->n", reference_basis(degree, place, d), local)
            for d in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        )
        highest = np.maximum(highest, value)
        slope = directions @ np.stack([gx, gy])
        bend = directions @ np.stack([xx, xy, xy, yy], -1).reshape(-1, 2, 2) @ directions.T
        values, vectors = np.linalg.eigh(bend)
        rise = np.einsum("nij,in->nj", vectors, slope)
        step = (
            np.einsum("nij,nj->ni", vectors, rise / np.maximum(np.abs(values), least)) @ directions
        )
        place = place + step * _within(place, step)[:, None]
    return highest


def _within(place: Array, step: Array) -> Array:
    """Return the part (n,) of each step, at most 1, that stays in the reference triangle."""
    room = np.concatenate([place, 1 - place.sum(axis=1, keepdims=True)], axis=1)
    fall = -np.concatenate([step, -step.sum(axis=1, keepdims=True)], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(fall > 0, room / fall, np.inf)
    return np.asarray(np.clip(reach.min(axis=1), 0, 1))


def walk(space: Space, shapes: Array, order: int) -> Iterator[tuple[slice, Array, Array, Array]]:
    """Yield the triangles of a mesh, chunk by chunk, at points of quadrature.

    Each chunk: which triangles, where (e, q, 2), dx (e, q) and values (n, e, q) of shapes.
    """
    points, weights = space.quadrature(order)
    value = reference_basis(space.degree, points).T
    for start in range(0, len(space.dofs), CHUNK):
        some = slice(start, min(start + CHUNK, len(space.dofs)))
        place, area = space.measure(some, points)
        yield some, place, area * weights, shapes[:, space.dofs[some]] @ value


def canonical_turn(
    domain: Domain, space: Space, shapes: Array, parity: tuple[tuple[int, ...], ...]
) -> Array:
    """Turn a degenerate set of shapes so that ∫ h ξᵢ ξⱼ cosh(4x/R) is diagonal, R the film's reach.

    Largest first. x counts from the film's middle.

    A weight of x alone gives sin·sin on a rectangle, and shapes even or odd in x and y where the
    film has those mirrors. Its angular harmonics never end, so that it tells cos mθ from sin mθ on
    a circle too.

    Args: shapes (n, size), mass-normalised, and their parities. Returns: orthogonal (n, n), the new
    shapes from the old ones.
    """
    # What mirrors leave of a film lies beside its middle
    middle = _middle_of(space) if domain.copies == 1 else np.array(domain.middle)
    reach = np.abs(space.location - middle).max()
    spread = np.zeros((len(shapes), len(shapes)))
    # A label needs no accuracy
    for triangles, point, dx, values in walk(space, shapes, space.degree + 2):
        along = (point[..., 0] - middle[0]) / reach
        weight = dx * Sheet(domain).inertia(triangles, point) * np.cosh(4 * along)
        spread += (values * weight).reshape(len(shapes), -1) @ values.reshape(len(shapes), -1).T
    width = np.zeros(len(shapes))
    turn = np.zeros_like(spread)
    for sector in set(parity):
        members = [k for k, p in enumerate(parity) if p == sector]
        width[members], vectors = np.linalg.eigh(spread[np.ix_(members, members)])
        turn[np.ix_(members, members)] = vectors.T
    return turn[np.argsort(-width, kind="stable")]


def _middle_of(space: Space) -> Array:
    """Return the middle (2,) [m] of the box around a mesh."""
    low = space.location.min(axis=0)
    return np.asarray(low + np.ptp(space.location, axis=0) / 2)


def label_shapes(
    domain: Domain, space: Space, shapes: Array, parity: tuple[tuple[int, ...], ...], first: int = 1
) -> tuple[str | None, ...]:
    """Name shapes by their overlap with the ideal modes of the outline's box.

    These are sin(mπx/Lx + mπ/2) sin(nπy/Ly + nπ/2).

    A shape is "(m,n)" where one of them holds three quarters of its norm, "(m,n)+(p,q)" or
    "(m,n)−(p,q)" where two share it evenly, as symmetry makes them do when they couple; otherwise,
    and where the outline has no such box, None.

    Args: first: number of the first shape among all modes, which with the aspect of the box tells
        how high orders may be.
    """
    if domain.model.outline.size is None or domain.copies > 4:
        return (None,) * len(shapes)
    size = domain.model.outline.size
    last = first + len(shapes) - 1
    highest = [
        3 + min(last, int(np.ceil(1.5 * np.sqrt(2 * last * one / other))))
        for one, other in (size, size[::-1])
    ]
    overlap = np.zeros((len(shapes), *highest))
    norms = np.zeros(len(shapes))
    ideal_norms = np.zeros(highest)
    for _, point, dx, values in walk(space, shapes, space.degree + 2):  # a label needs no accuracy
        x, y = (point - domain.middle).reshape(-1, 2).T
        along_x, along_y = (
            np.sin(np.pi * np.arange(1, count + 1)[:, None] * (z / extent + 0.5))
            for z, extent, count in zip((x, y), size, highest, strict=True)
        )
        weighted = values.reshape(len(shapes), -1) * dx.ravel()
        for k, weight in enumerate(weighted):
            overlap[k] += (along_x * weight) @ along_y.T
        norms += np.sum(weighted * values.reshape(len(shapes), -1), axis=1)
        ideal_norms += (along_x**2 * dx.ravel()) @ (along_y**2).T
    return tuple(
        _label(o, n, ideal_norms, p) for o, n, p in zip(overlap, norms, parity, strict=True)
    )


def _label(overlap: Array, norm: float, ideal: Array, parity: tuple[int, ...]) -> str | None:
    cosines = overlap / np.sqrt(norm * ideal)
    # sin is even about the centre for odd orders
    odd_x, odd_y = (np.arange(1, count + 1) % 2 == 1 for count in overlap.shape)
    if len(parity) > 0:
        cosines[:, odd_y != (parity[0] > 0)] = 0
    if len(parity) > 1:
        cosines[odd_x != (parity[1] > 0), :] = 0
    first, second = np.argsort(-np.abs(cosines), axis=None)[:2]
    orders = np.stack(np.unravel_index([first, second], overlap.shape), axis=1) + 1
    names = [f"({m},{n})" for m, n in orders]
    a = cosines.flat[first]
    b = cosines.flat[second]
    if a**2 > 0.75:
        return names[0]
    if a**2 + b**2 > 0.75 and b**2 > 0.25:
        pair = sorted(names)
        return f"{pair[0]}{'+' if a * b > 0 else '−'}{pair[1]}"
    return None
