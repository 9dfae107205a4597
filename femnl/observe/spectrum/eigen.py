"""Eigenvalues of a film's modal matrices."""

import numpy as np
from scipy.linalg import eigh

from femnl.core.readout import Array
from femnl.core.stages import ModalSystem


def eigen(system: ModalSystem) -> tuple[Array, Array]:
    """Return ω² and the vectors of M-norm 1.

    Most causes leave the masses alone, and then a plain problem is the faster one.
    """
    mass = system.mass
    own = np.diag(mass)
    if np.count_nonzero(mass) == len(own):
        square, turned = np.linalg.eigh(system.stiffness / np.sqrt(np.outer(own, own)))
        return square, turned / np.sqrt(own)[:, None]
    square, vectors = eigh(system.stiffness, mass, check_finite=False)
    return np.asarray(square), np.asarray(vectors)


def squares(system: ModalSystem) -> tuple[Array, Array]:
    """Return ω² alone, and no vectors (n, 0).

    What has no labels goes by rank, and the vectors cost twice as much as the squares.
    """
    mass = system.mass
    root = np.sqrt(np.diag(mass))
    none = np.empty((len(root), 0))
    scaled = np.outer(root, root)
    if np.count_nonzero(mass) == len(root):
        return np.linalg.eigvalsh(system.stiffness / scaled), none
    return np.asarray(eigh(system.stiffness, mass, eigvals_only=True, check_finite=False)), none
