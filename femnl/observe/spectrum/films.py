"""Changed films of a spectrum: one, and several side by side."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np

from femnl.core.device import Film
from femnl.core.readout import Array
from femnl.core.stages import Lines, ModalSystem
from femnl.observe.spectrum.matching import Index


@dataclass(frozen=True, eq=False)
class Solved:
    """A changed film.

    frequency (n_changed,) [Hz] of its modes; vectors (n, n_changed): base modes in them, of modal
    mass 1, (n, 0) where not solved for; own (n,) [Hz] and mass (n,) [kg] of each base mode of the
    unchanged film; that film; system: matrices of the changed one.
    """

    frequency: Array
    vectors: Array
    own: Array
    mass: Array
    film: Film
    system: ModalSystem


@dataclass(frozen=True, eq=False)
class Films:
    """What is read off of m changed films.

    frequency (m, n_changed) [Hz]; vectors (m, n, n_changed) and mass (m, n) as of `Solved`; loss
    (m, n_changed), (m, 0) where no quality factor was measured; film: of all of them.
    """

    frequency: Array
    vectors: Array
    mass: Array
    loss: Array
    film: Film

    @cached_property
    def content(self) -> Array:
        """Base modes of modal mass 1 in the changed ones, (m, n, n_changed); squares are shares."""
        return self.vectors * np.sqrt(self.mass)[:, :, None]

    def lines(self, changed: Index, participation: Array, unmixed: Array) -> Lines:
        """Return lines (m, k), or (k,) of one film, of the changed modes (m, k).

        Args: participation (3, n): of each base mode. unmixed (n, k): shares of base modes that
            stand for those of the changed ones, where no vectors are known.
        """
        if self.content.size:
            parts = np.take_along_axis(self.content, changed[:, None, :], 2) ** 2
        else:
            parts = np.broadcast_to(unmixed, (len(changed), *unmixed.shape))
        shape = changed.shape if len(changed) > 1 else changed.shape[1:]
        loss = np.take_along_axis(self.loss, changed, 1).reshape(shape) if self.loss.size else None
        return Lines(
            np.take_along_axis(self.frequency, changed, 1).reshape(shape),
            np.empty(0),
            np.empty(0) if loss is None else loss,
            np.moveaxis(participation @ parts, 1, 0).reshape(3, *shape),
            self.film,
        )


def with_densities(films: Sequence[Film]) -> Film:
    """Return films that differ in their density alone as one, its density (m, 1) beside lines."""
    first = films[0]
    density = np.array([film.density for film in films])
    if np.all(density == first.density):
        return first
    # Effects on lines take an array for a number
    return replace(first, density=cast(float, density[:, None]))


def bent_part(solved: Sequence[Solved], share: Array) -> Array:
    """Return the part of bending in the energy of each changed mode, (m, n_changed).

    Σ ξᵢξⱼ √(sᵢsⱼ) (K − what bending does not follow)ᵢⱼ / ω².

    Args: share (m, n): s, that part of each base mode.
    """
    stiffness = np.stack([one.system.stiffness - one.system.unbent for one in solved])
    shapes = np.sqrt(share)[:, :, None] * np.stack([one.vectors for one in solved])
    energy = np.sum(shapes * (stiffness @ shapes), axis=1)
    omega = 2 * np.pi * np.stack([one.frequency for one in solved])
    return np.asarray(np.divide(energy, omega**2, out=np.zeros_like(energy), where=omega > 0))
