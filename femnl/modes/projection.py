"""Integrals of the base modes over the whole film, which carry changes of tension and mass to a small dense problem."""

import numpy as np
from numpy.typing import NDArray

from femnl.fem.elements import Space
from femnl.fem.forms import cells
from femnl.fem.sheet import Sheet
from femnl.modes.shapes import shape_at
from femnl.types.mechanics import Domain, Modes
from femnl.types.operators import DIRECTIONS, WEIGHTS, Projection

Array = NDArray[np.float64]

POINTS = 129  # of the grid along each axis on which shapes are tabulated


def project(modes: Modes) -> Projection:
    """Project weighted slopes and masses onto the modes.

    Args: modes: of any wedge; the copies that make up the film are summed with the signs that the modes take there.
    Returns: integrals over the whole film, see `Projection`.
    Valid: changes of the film that leave the new modes within the span of these ones.
    """
    domain, space, sheet = modes.domain, Space(modes.domain.mesh, modes.degree), Sheet(modes.domain)
    n, reach = len(modes.frequency), float(np.abs(modes.domain.mesh.p).max())
    slopes, masses = np.zeros((len(WEIGHTS), 4, n, n)), np.zeros((len(WEIGHTS), n, n))
    for cell in cells(space, 2 * modes.degree - 2):
        local = modes.shapes[:, space.dofs[cell.triangles]].transpose(1, 2, 0)
        value = (cell.jet.value @ local).reshape(-1, n)
        dx, dy = ((cell.jet.gradient[:, :, a] @ local).reshape(-1, n) for a in (0, 1))
        weights = sheet.thickness(cell.triangles, cell.jet.point) * cell.dx
        volume, mass = weights.ravel(), (sheet.density(cell.triangles) * weights).ravel()
        for k, weight in enumerate(_weights(cell.jet.point.reshape(-1, 2).T / reach)):
            factor = (weight * volume)[:, None]
            masses[k] += value.T @ ((weight * mass)[:, None] * value)
            mixed = dx.T @ (factor * dy)
            slopes[k] += np.stack([dx.T @ (factor * dx), dy.T @ (factor * dy), mixed, mixed.T])
    whole_slopes, whole_masses = np.zeros((len(WEIGHTS), len(DIRECTIONS), n, n)), np.zeros_like(masses)
    for turn, sign in _images(domain, modes.parity):
        signs = np.outer(sign, sign)
        weights = _turned_weights(turn)
        whole_masses += signs * np.tensordot(weights, masses, 1)
        (a, b), (c, d) = turn
        mix = np.array(
            [[a * a, b * b, a * b, a * b], [c * c, d * d, c * d, c * d], [a * c, b * d, (a * d + b * c) / 2, (a * d + b * c) / 2]]
        )
        whole_slopes += signs * np.einsum("kl,cm,lmij->kcij", weights, mix, slopes)
    cosine = -np.cos(np.linspace(0, np.pi, POINTS))  # dense at the edges, where the clamped film bends sharply
    grid_x, grid_y = (half * cosine for half in np.abs(domain.mesh.p).max(axis=1)) if domain.wedge < np.pi else (reach * cosine,) * 2
    shapes = np.stack([shape_at(modes, k, grid_x[None, :], grid_y[:, None]) for k in range(n)])
    return Projection(whole_slopes, whole_masses, reach, grid_x, grid_y, shapes)


def _weights(point: Array) -> Array:
    x, y = point
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def _turned_weights(turn: Array) -> Array:
    """Each weight at the image R(x, y) of a point as a sum of the weights at the point, (6, 6)."""
    probe = np.random.default_rng(0).uniform(-1, 1, (2, len(WEIGHTS)))
    return np.asarray(np.linalg.solve(_weights(probe).T, _weights(turn @ probe).T).T)


def _images(domain: Domain, parity: tuple[tuple[int, ...], ...]) -> list[tuple[Array, Array]]:
    """The reflections and rotations (2, 2) that make the film of its wedge, each with the signs (n,) that the modes take."""
    normals = [np.array([-np.sin(angle), np.cos(angle)]) for angle in (0.0, domain.wedge)][: len(parity[0])]
    mirrors = [(np.eye(2) - 2 * np.outer(v, v), np.array([p[k] for p in parity], dtype=float)) for k, v in enumerate(normals)]
    found = [(np.eye(2), np.ones(len(parity)))]
    for turn, sign in found:  # grows while new images appear
        for mirror, flip in mirrors:
            image = mirror @ turn
            if not any(np.allclose(image, known) for known, _ in found):
                found.append((image, flip * sign))
    return found
