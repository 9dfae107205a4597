"""The whole film, mirrored out of its wedge, with shapes and stress at the nodes."""

import numpy as np
from numpy.typing import NDArray

from femnl.core.modes import Modes
from femnl.core.surface import Surface
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import in_plane_strain, vector_dofs
from femnl.mechanics.fem.reference import nodes as reference_nodes
from femnl.mechanics.fem.reference import reference_basis
from femnl.mechanics.fem.sheet import Sheet

Array = NDArray[np.float64]


def unfold(modes: Modes) -> Surface:
    """Evaluate modes and relaxed stress at the nodes, mirrored over the whole film.

    Thickness and stress at a node are means over the triangles that meet there.
    """
    domain = modes.domain
    space = Space(domain.mesh, modes.degree)
    plane = Space(domain.mesh, modes.prestress.degree)
    nodes = Space(domain.mesh, 2)
    local = reference_nodes(2)
    shapes = np.zeros((len(modes.shapes), nodes.size))
    shapes[:, nodes.dofs] = modes.shapes[:, space.dofs] @ reference_basis(modes.degree, local).T
    stress, in_plane, thickness = _in_plane(modes, nodes, plane, local)
    copies = _copies(domain.wedge, domain.copies)
    middle = np.array(domain.middle)
    about = nodes.location - middle
    points = middle + np.concatenate([about @ turn.T for turn, _, _ in copies])
    signs = [
        [_sign(parity, steps, mirrored) for parity in modes.parity] for _, steps, mirrored in copies
    ]
    return Surface(
        points,
        _counter_clockwise(
            points, np.concatenate([nodes.dofs + k * nodes.size for k in range(len(copies))])
        ),
        np.concatenate([shapes * np.array(sign)[:, None] for sign in signs], axis=1),
        np.tile(thickness, len(copies)),
        np.concatenate([_turn_stress(stress, turn) for turn, _, _ in copies]),
        np.concatenate([in_plane @ turn.T for turn, _, _ in copies]),
    )


def _in_plane(modes: Modes, nodes: Space, plane: Space, local: Array) -> tuple[Array, Array, Array]:
    """Return relaxed stress (n, 3), in-plane displacement (n, 2) and thickness (n,) at nodes."""
    sheet = Sheet(modes.domain)
    every = slice(None)
    jet = plane.jet(every, local)
    unknowns = modes.prestress.displacement[vector_dofs(plane, every)]
    strain = np.einsum("eqcj,ej->eqc", in_plane_strain(jet), unknowns)
    values = sheet.stress(every) + (strain[..., None, :] @ sheet.moduli(every))[..., 0, :]
    total = np.zeros((nodes.size, 4))
    count = np.zeros(nodes.size)
    np.add.at(
        total,
        nodes.dofs,
        np.concatenate([values, sheet.total_thickness(every, jet.point)[..., None]], -1),
    )
    np.add.at(count, nodes.dofs, 1)
    half = plane.dofs.shape[1]
    displacement = np.zeros((nodes.size, 2))
    displacement[nodes.dofs] = np.stack(
        [unknowns[:, :half] @ jet.value[0].T, unknowns[:, half:] @ jet.value[0].T], -1
    )
    mean = total / count[:, None]
    return mean[:, :3], displacement, mean[:, 3]


def _copies(wedge: float, copies: int) -> list[tuple[Array, int, bool]]:
    """Return turns of the wedge that cover the film.

    (matrix, steps of rotation by twice the wedge, whether mirrored first).
    """
    if copies == 1:
        return [(np.eye(2), 0, False)]
    result = []
    for steps in range(copies // 2):
        c = np.cos(2 * wedge * steps)
        s = np.sin(2 * wedge * steps)
        rotation = np.array([[c, -s], [s, c]])
        result += [(rotation, steps, False), (rotation @ np.diag([1.0, -1.0]), steps, True)]
    return result


def _sign(parity: tuple[int, ...], steps: int, mirrored: bool) -> int:
    """Sign of a shape on a copy: a rotation by twice the wedge is one mirror after the other."""
    if not parity:
        return 1
    return int(np.prod(parity) ** steps * (parity[0] if mirrored else 1))


def _turn_stress(stress: Array, turn: Array) -> Array:
    """Return (xx, yy, xy) of R S Rᵀ."""
    full = turn @ np.stack([stress[:, [0, 2]], stress[:, [2, 1]]], 1) @ turn.T
    return np.stack([full[:, 0, 0], full[:, 1, 1], full[:, 0, 1]], -1)


def _counter_clockwise(points: Array, triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return triangles (m, 6) all in the same sense: corners, then middles of edges 01, 12, 20."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    clockwise = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    return np.where(clockwise[:, None], triangles[:, [0, 2, 1, 5, 4, 3]], triangles)
