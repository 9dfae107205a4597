"""Integrals of the base modes over the film: changes of tension and mass as small matrices."""

from itertools import repeat

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from femnl.core.device import Model
from femnl.core.domain import Domain
from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.core.operators import DIRECTIONS, WEIGHTS, Projection, Units, weights
from femnl.device.geometry import curves
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import as_matrix, cells, quadrature_order
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.stress import unit_stress
from femnl.mechanics.modes.points import shapes_at

Array = NDArray[np.float64]

# Of a stress, that the integrals of its direction stand for: of a shear, half in xy and half in yx
SHARE = np.array([1.0, 1.0, 0.5])
NEIGHBOURS = 40  # points around one over a hole, from which it is bridged
POINTS = 129  # of the grid along each axis on which shapes are tabulated


def project(modes: Modes, units: Units | None = None) -> Projection:
    """Project weighted slopes and masses onto the modes.

    Args: modes: of any wedge; the copies that make up the film are summed with the signs that the
        modes take there. units: how the film relaxes under each film stress; None takes the
        stresses as they are given, in equilibrium or not.
    Returns: integrals over the whole film, see `Projection`; shapes on the grid go on smoothly over
    holes.
    Valid: changes of the film that leave the new modes within the span of these ones.
    """
    domain = modes.domain
    x, y = domain.middle
    if (domain.copies > 1 and y != 0) or (domain.copies > 2 and x != 0):
        raise ParameterError(
            f"{domain.model.name}: changes of a film are projected about the origin, and its "
            "mirrors cross elsewhere; solve its modes with symmetry full"
        )
    space = Space(modes.domain.mesh, modes.degree)
    sheet = Sheet(modes.domain)
    order = quadrature_order(domain.model, 2 * modes.degree - 2)
    stresses = repeat(None) if units is None else unit_stress(domain, units, order)
    n = len(modes.frequency)
    reach = float(np.abs(modes.domain.mesh.p).max())
    slopes = np.zeros((len(WEIGHTS), 3, n, n))
    masses = np.zeros((len(WEIGHTS), n, n))
    for cell, stress in zip(cells(space, order), stresses, strict=units is not None):
        local = modes.shapes[:, space.dofs[cell.triangles]].transpose(1, 2, 0)
        value = (cell.jet.value @ local).reshape(-1, n)
        slope = cell.jet.gradient @ local[:, None]
        volume = sheet.thickness(cell.triangles, cell.jet.point) * cell.dx
        mass = sheet.inertia(cell.triangles, cell.jet.point) * cell.dx
        pull = (SHARE * volume[..., None])[..., None, None]
        for k, weight in enumerate(weights(np.moveaxis(cell.jet.point, -1, 0) / reach)):
            masses[k] += value.T @ ((weight * mass).reshape(-1, 1) * value)
            left = weight[..., None] * np.eye(3)[:, None, None] if stress is None else stress[k]
            for direction, tensor in enumerate(as_matrix(left)):
                pulled = (pull[:, :, direction] * tensor) @ slope
                slopes[k, direction] += slope.reshape(-1, n).T @ pulled.reshape(-1, n)
    whole_slopes = np.zeros((len(WEIGHTS), len(DIRECTIONS), n, n))
    whole_masses = np.zeros_like(masses)
    for turn, sign in film_images(domain, modes.parity):
        signs = np.outer(sign, sign)
        turned = _turned_weights(turn)
        whole_masses += signs * np.tensordot(turned, masses, 1)
        (a, b), (c, d) = turn
        mix = np.array(
            [[a * a, b * b, 2 * a * b], [c * c, d * d, 2 * c * d], [a * c, b * d, a * d + b * c]]
        )
        whole_slopes += signs * np.einsum("kl,cm,lmij->kcij", turned, mix, slopes)
    # Dense at the edges, where the clamped film bends sharply
    cosine = -np.cos(np.linspace(0, np.pi, POINTS))
    grid_x, grid_y = (
        (half * cosine for half in np.abs(domain.mesh.p).max(axis=1))
        if domain.wedge < np.pi
        else (reach * cosine,) * 2
    )
    shapes = shapes_at(modes, grid_x[None, :], grid_y[:, None])
    if domain.model.pierced:
        shapes = _over_holes(domain.model, grid_x, grid_y, shapes)
    return Projection(whole_slopes, whole_masses, reach, grid_x, grid_y, shapes)


def _over_holes(model: Model, grid_x: Array, grid_y: Array, shapes: Array) -> Array:
    """Bridge holes by thin-plate splines through the nearest grid points on the film."""
    x, y = np.meshgrid(grid_x, grid_y)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    holes = model.holes
    missing = np.zeros(len(points), dtype=bool)
    if len(holes.centres):
        missing |= cKDTree(holes.centres).query(points)[0] <= holes.radius
    for opening in model.openings:
        missing |= curves.contains(opening, points) | (curves.distance(opening, points) == 0)
    values = shapes.reshape(len(shapes), -1).T.copy()
    if np.any(missing):
        values[missing] = RBFInterpolator(
            points[~missing], values[~missing], NEIGHBOURS, kernel="thin_plate_spline"
        )(points[missing])
    return values.T.reshape(shapes.shape)


def _turned_weights(turn: Array) -> Array:
    """Each weight at the image R(x, y) of a point as a sum of the weights at the point, (6, 6)."""
    probe = np.random.default_rng(0).uniform(-1, 1, (2, len(WEIGHTS)))
    return np.asarray(np.linalg.solve(weights(probe).T, weights(turn @ probe).T).T)


def film_images(domain: Domain, parity: tuple[tuple[int, ...], ...]) -> list[tuple[Array, Array]]:
    """Return the reflections and rotations (2, 2) that make the film of its wedge.

    Each comes with the signs (n,) that the modes take.
    """
    normals = [np.array([-np.sin(angle), np.cos(angle)]) for angle in (0.0, domain.wedge)][
        : len(parity[0])
    ]
    mirrors = [
        (np.eye(2) - 2 * np.outer(v, v), np.array([p[k] for p in parity], dtype=float))
        for k, v in enumerate(normals)
    ]
    found = [(np.eye(2), np.ones(len(parity)))]
    for turn, sign in found:  # grows while new images appear
        for mirror, flip in mirrors:
            image = mirror @ turn
            if not any(np.allclose(image, known) for known, _ in found):
                found.append((image, flip * sign))
    return found
