"""Films as the diagnosis of a spectrum changes them."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from femnl.core.stages import ModalSystem
from femnl.observe.film import SimulatedFilm

Array = NDArray[np.float64]


def system_of(film: SimulatedFilm) -> ModalSystem:
    """The unchanged film's matrices."""
    modes = film.modes
    return ModalSystem(
        np.diag(modes.stiffness),
        np.diag(modes.effective_mass),
        film.model.film.stress,
        film.model.film,
        film.projection,
        film.model.outline.size,
        film.bending_length if film.model.bending else 0.0,
        film.layer if film.model.bending else np.empty((0, 0)),
    )


def relative_shift(changed: ModalSystem, plain: ModalSystem) -> Array:
    """Δf/f of every mode by rank."""
    new, old = (eigh(s.stiffness, s.mass, eigvals_only=True) for s in (changed, plain))
    return np.asarray(np.sqrt(new / old) - 1)
