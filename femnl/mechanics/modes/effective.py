"""Modes of a changed film as matrices on those of the unchanged one."""

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import ParameterError
from femnl.core.modes import Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.modes.operators import mass_matrix

Array = NDArray[np.float64]

HELD = 0.7
"""Amplitude of a changed mode in the base modes from which on it is one of them."""


def effective_stiffness(base: Modes, changed: Modes) -> Array:
    """Return K (n, n) [N/m] that has, with the masses of base modes, the ω² of a changed film.

    H = P(PᵀP)^−½ ω² (PᵀP)^−½Pᵀ on base modes of modal mass 1, P the shares of base modes in the
    changed ones, for each parity. It is the symmetric matrix that keeps the base modes as far as
    can be. Base modes that no changed one holds keep their ω².

    Args: base, changed: as many modes, in elements of one degree on one mesh.
    Raises: ParameterError for modes on other meshes.
    Source: des Cloizeaux, Nucl. Phys. 20, 321 (1960).
    """
    if base.shapes.shape != changed.shapes.shape:
        raise ParameterError(
            f"{base.domain.model.name}: modes of a changed film are on another mesh; solve both "
            "with one resolution"
        )
    mass = mass_matrix(base.domain, Space(base.domain.mesh, base.degree))
    moved = mass @ changed.shapes.T
    norm = np.sqrt(base.domain.copies * np.einsum("ni,in->n", changed.shapes, moved))
    shares = base.domain.copies * base.shapes @ moved
    shares /= np.outer(np.sqrt(base.effective_mass), norm)
    square = (2 * np.pi * changed.frequency) ** 2
    found = np.zeros((len(square), len(square)))
    # Over the whole film, modes of unlike parity have nothing in common
    for parity in set(base.parity):
        mine = np.flatnonzero([own == parity for own in base.parity])
        theirs = np.flatnonzero([own == parity for own in changed.parity])
        # The highest ones may be other modes than before
        held = np.linalg.norm(shares[np.ix_(mine, theirs)], axis=0) > HELD
        theirs = theirs[held]
        left, _, right = np.linalg.svd(shares[np.ix_(mine, theirs)], full_matrices=False)
        turned = left @ right
        rest = np.eye(len(mine)) - turned @ turned.T
        own = (rest * (2 * np.pi * base.frequency[mine]) ** 2) @ rest
        block = (turned * square[theirs]) @ turned.T + own
        scale = np.sqrt(base.effective_mass[mine])
        found[np.ix_(mine, mine)] = block * np.outer(scale, scale)
    return found
