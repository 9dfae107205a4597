"""Eigenvalues of a film's modal matrices."""

import numpy as np
from scipy.linalg import eigh

from femnl.core.readout import Array
from femnl.core.stages import ModalSystem

LEAST_MASS = 1e-6
"""Part of its mass that a mode keeps where a step of a fit takes away all of it."""


def eigen(system: ModalSystem) -> tuple[Array, Array]:
    """Return ω² and the vectors of M-norm 1.

    Most causes leave the masses alone, and then a plain problem is the faster one.
    """
    mass = system.mass
    own = np.diag(mass)
    if np.count_nonzero(mass) == len(own):
        square, turned = np.linalg.eigh(system.stiffness / np.sqrt(np.outer(own, own)))
        return square, turned / np.sqrt(own)[:, None]
    try:
        square, vectors = eigh(system.stiffness, mass, check_finite=False)
    except np.linalg.LinAlgError:
        square, vectors = eigh(system.stiffness, _positive(mass), check_finite=False)
    return np.asarray(square), np.asarray(vectors)


def squares(system: ModalSystem) -> tuple[Array, Array]:
    """Return ω² alone, and no vectors (n, 0).

    What has no labels goes by rank, and the vectors cost twice as much as the squares.
    """
    mass = system.mass
    root = np.sqrt(np.abs(np.diag(mass)))
    none = np.empty((len(root), 0))
    scaled = np.outer(root, root)
    if np.count_nonzero(mass) == len(root):
        return np.linalg.eigvalsh(system.stiffness / scaled), none
    try:
        found = eigh(system.stiffness, mass, eigvals_only=True, check_finite=False)
    except np.linalg.LinAlgError:
        found = eigh(system.stiffness, _positive(mass), eigvals_only=True, check_finite=False)
    return np.asarray(found), none


def _positive(mass: Array) -> Array:
    """Return a mass matrix (n, n) with no mode lighter than `LEAST_MASS` of what it weighs alone.

    A step of a fit may take away more mass than there is: such films are bad, but no error.
    """
    root = np.sqrt(np.abs(np.diag(mass)))
    scaled, vectors = np.linalg.eigh(mass / np.outer(root, root))
    return np.asarray((vectors * np.maximum(scaled, LEAST_MASS)) @ vectors.T * np.outer(root, root))
