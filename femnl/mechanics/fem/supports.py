"""Unknowns that an edge or a mirror line leaves free, and springs of a yielding edge."""

from collections.abc import Iterator
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix

from femnl.core.device import Clamp, Edge
from femnl.core.errors import ParameterError
from femnl.mechanics.fem.elements import STRAIGHT, Jet, Space
from femnl.mechanics.fem.forms import Assembly, deflection, local_matrices, slope, vector_dofs
from femnl.mechanics.fem.interior_penalty import edges_by_local_number, side_of_edge

Array = NDArray[np.float64]

RIGID_CLAMP = Clamp()
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])  # of a normal to the tangent


def free_deflections(
    space: Space, parity: tuple[int, ...], clamp: Clamp = RIGID_CLAMP
) -> NDArray[np.int64]:
    """Return the unknowns of w that are free.

    They lie neither on edges held rigidly, nor on mirror lines about which w is odd (parity −1).
    """
    held = (
        [space.boundary_dofs("clamped")]
        if np.isinf(clamp.deflection)
        else [np.empty(0, dtype=np.int64)]
    )
    held += [space.boundary_dofs(f"mirror-{k}") for k, sign in enumerate(parity) if sign < 0]
    return np.setdiff1d(np.arange(space.size), np.concatenate(held))


def slope_held_facets(space: Space, parity: tuple[int, ...]) -> NDArray[np.int64]:
    """Return facets on which ∂ₙw = 0: clamped edges, and mirror lines of even parity (+1)."""
    names = ["clamped"] + [f"mirror-{k}" for k, sign in enumerate(parity) if sign > 0]
    return np.concatenate([space.boundary_facets(name) for name in names])


def deflection_springs(space: Space, clamp: Clamp) -> csc_matrix:
    """Return ∫ k w v along the edge, (size, size) [N/m].

    An edge where k is infinite is held, and gives nothing.
    """
    springs = Assembly(space.size)
    if np.isfinite(clamp.deflection):
        for triangles, _, jet, ds in _edge(space):
            springs.add(
                local_matrices(deflection(jet), np.eye(1), clamp.deflection * ds),
                space.dofs[triangles],
            )
    return springs.matrix()


def slope_springs(space: Space, clamp: Clamp) -> csc_matrix:
    """Return ∫ k_θ ∂ₙw ∂ₙv along the edge, (size, size) [N/m].

    It is the energy of the springs of a solved mode. Edges where k_θ is infinite give nothing.
    """
    springs = Assembly(space.size)
    if np.isfinite(clamp.rotation):
        for triangles, normal, jet, ds in _edge(space):
            across = np.einsum("eqx,eqxj->eqj", normal, slope(jet))
            springs.add(
                local_matrices(across[:, :, None, :], np.eye(1), clamp.rotation * ds),
                space.dofs[triangles],
            )
    return springs.matrix()


def in_plane_springs(space: Space, clamp: Clamp) -> csc_matrix:
    """Return ∫ (kₙ u·n v·n + kₛ u·t v·t) along the edge, (2·size, 2·size) [N/m].

    A k that is infinite gives nothing: its direction is held.
    """
    springs = Assembly(2 * space.size)
    for stiffness, turn in ((clamp.normal, np.eye(2)), (clamp.shear, TURN)):
        if np.isfinite(stiffness):
            for triangles, normal, jet, ds in _edge(space):
                along = normal @ turn.T
                rows = np.concatenate(
                    [along[..., :1] * jet.value, along[..., 1:] * jet.value], axis=-1
                )[:, :, None, :]
                springs.add(
                    local_matrices(rows, np.eye(1), stiffness * ds), vector_dofs(space, triangles)
                )
    return springs.matrix()


def in_plane_draw(space: Space, clamp: Clamp) -> Array:
    """Return −∫ kₙ d v·n along the edge, (2·size,) [N], the pull of springs that rest d inwards."""
    load = np.zeros(2 * space.size)
    for triangles, normal, jet, ds in _edge(space) if clamp.draw != 0 else ():
        rows = np.concatenate([normal[..., :1] * jet.value, normal[..., 1:] * jet.value], axis=-1)
        np.add.at(
            load,
            vector_dofs(space, triangles),
            -clamp.normal * clamp.draw * np.einsum("eq,eqj->ej", ds, rows),
        )
    return load


def _edge(space: Space) -> Iterator[tuple[NDArray[np.int64], Array, Jet, Array]]:
    """The edge's triangles (e,), outward normals (e, q, 2), basis and ds (e, q) [m]."""
    for edges in edges_by_local_number(space, space.boundary_facets("clamped")):
        jet, normal, ds = side_of_edge(space, edges.triangles[0], edges.local[0], 2 * space.degree)
        yield edges.triangles[0], normal, jet, ds


def in_plane_supports(
    space: Space, wedge: float, edge: Edge, even: tuple[bool, ...], clamp: Clamp = RIGID_CLAMP
) -> csc_matrix:
    """Return columns that span the admissible in-plane displacements, (2·size, n_free).

    Clamped outline: u = 0, or with `sliding` only u·n = 0, and nothing in a direction in which
    springs hold it. Mirror k: u·n = 0 where the load is even under it, else u·t = 0. A film that
    could still move as a whole, as a disc turns on a sliding edge, is held at one point: no load of
    ours pushes it.
    Raises: ParameterError where there is no such edge, or where the edge is elastic and asked to be
    another.
    """
    if edge not in get_args(Edge):
        raise ParameterError(f'edge = "{edge}": expected {", ".join(get_args(Edge))}')
    if edge != "clamped" and not clamp.rigid_in_plane:
        raise ParameterError(
            f'edge = "{edge}": the geometry\'s table [clamp] says how the edge gives way in '
            'plane; use edge = "clamped"'
        )
    held, sprung = _held_in_plane(space, wedge, edge, even, clamp)
    _hold_rigid_motion(space, held, sprung)
    return _admissible_columns(space, held)


Held = dict[int, list[Array]]
"""Directions in which each unknown point is held."""
Sprung = list[tuple[NDArray[np.int64], Array]]
"""Points that springs hold, and the directions in which they do."""


def _held_in_plane(
    space: Space, wedge: float, edge: Edge, even: tuple[bool, ...], clamp: Clamp
) -> tuple[Held, Sprung]:
    """Return what mirrors, a rigid edge and springs hold.

    Args: as for `in_plane_supports`.
    """
    held: Held = {}
    sprung: Sprung = []
    for k, angle in enumerate((0.0, wedge)):
        along = np.array([np.cos(angle), np.sin(angle)])
        normal = np.array([-along[1], along[0]])
        if k < len(even):
            _hold(held, space.boundary_dofs(f"mirror-{k}"), normal if even[k] else along)
    if edge != "sliding" and clamp.rigid_in_plane:
        for direction in np.eye(2):
            _hold(held, space.boundary_dofs("clamped"), direction)
        return held, sprung
    shear = 0.0 if edge == "sliding" else clamp.shear
    for stiffness, turn in ((clamp.normal, np.eye(2)), (shear, TURN)):
        if stiffness == 0:
            continue
        for dofs, normals in _edge_normals(space):
            if np.isinf(stiffness):
                _hold(held, dofs, normals @ turn.T)
            else:
                sprung.append((dofs, normals @ turn.T))
    return held, sprung


def _hold(held: Held, dofs: NDArray[np.int64], directions: Array) -> None:
    """Add directions (2,) or (n, 2) in which points (n,) are held."""
    for dof, direction in zip(dofs, np.broadcast_to(directions, (len(dofs), 2)), strict=True):
        held.setdefault(int(dof), []).append(direction)


def _admissible_columns(space: Space, held: Held) -> csc_matrix:
    """Return columns that span the motions which `held` admits, (2·size, n_free)."""
    anywhere = np.setdiff1d(np.arange(space.size), np.fromiter(held, dtype=np.int64))
    rows = [anywhere, anywhere + space.size]
    columns = [np.arange(len(anywhere)), np.arange(len(anywhere)) + len(anywhere)]
    values = [np.ones(2 * len(anywhere))]
    n = 2 * len(anywhere)
    for dof, directions in held.items():
        for direction in _admissible(directions):
            rows.append(np.array([dof, dof + space.size]))
            columns.append(np.array([n, n]))
            values.append(direction)
            n += 1
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csc_matrix(coo_matrix(entries, shape=(2 * space.size, n)))


def _hold_rigid_motion(space: Space, held: Held, sprung: Sprung) -> None:
    """Hold one point in the direction of each rigid motion that nothing else resists."""
    if not held and not sprung:
        return
    # About a far origin, a turn would look like a shift
    place = space.location - space.location.mean(axis=0)
    reach = np.abs(place).max()
    dofs = np.concatenate(
        [np.repeat(dof, len(d)) for dof, d in held.items()] + [dofs for dofs, _ in sprung]
    )
    directions = np.concatenate([*map(np.asarray, held.values()), *(d for _, d in sprung)])
    x, y = place[dofs].T / reach
    rows = np.stack(
        [directions[:, 0], directions[:, 1], x * directions[:, 1] - y * directions[:, 0]], 1
    )
    values, vectors = np.linalg.eigh(rows.T @ rows)
    for a, b, turn in vectors.T[values < RIGID**2 * values[-1]]:
        motion = np.stack([a - turn * place[:, 1] / reach, b + turn * place[:, 0] / reach], 1)
        most = int(np.argmax(np.linalg.norm(motion, axis=1)))
        held.setdefault(most, []).append(motion[most] / np.linalg.norm(motion[most]))


# How far a rigid motion may go along held directions, over its length, and still count as free
RIGID = 1e-6
# Sine of the angle between neighbouring normals from which their point is a corner and held fast
CORNER = 0.05


def _admissible(held: list[Array]) -> list[Array]:
    """Return the directions in which a point may still move while its held ones are at zero.

    There is one such direction, or none at a corner.
    """
    first = held[0]
    if any(abs(first[0] * d[1] - first[1] * d[0]) > CORNER for d in held[1:]):
        return []
    mean = np.sum([d * np.sign(d @ first) for d in held], axis=0)
    return [np.array([-mean[1], mean[0]]) / np.linalg.norm(mean)]


def _edge_normals(space: Space) -> list[tuple[NDArray[np.int64], Array]]:
    """Return unit normals of the clamped outline at its unknowns, facet by facet.

    A corner appears once for each side.
    """
    facets = space.boundary_facets("clamped")
    result = []
    ends = space.mesh.doflocs[:, space.mesh.facets[:, facets]]
    middle = space.mesh.doflocs[:, space.mesh.nvertices + facets]
    for k in range(len(facets)):
        dofs = space.facet_unknowns(int(facets[k]))
        a = ends[:, 0, k]
        b = ends[:, 1, k]
        c = middle[:, k]
        chord = b - a
        sagitta = c - (a + b) / 2
        along = np.linalg.norm(chord)
        rise = np.linalg.norm(sagitta)
        # Half the angle of the arc
        half = 2 * np.arctan(2 * rise / along) if rise > STRAIGHT * along else 0.0
        angle = half * (2 * np.array([0.0, 1.0, *np.linspace(0, 1, space.degree + 1)[1:-1]]) - 1)
        tangent = np.outer(np.cos(angle), chord / along) - np.outer(
            np.sin(angle), sagitta / max(rise, 1e-300)
        )
        result.append((dofs, np.stack([-tangent[:, 1], tangent[:, 0]], 1)))
    return result
