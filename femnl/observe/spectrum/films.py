"""Changed films of a spectrum: one, and several side by side."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np

from femnl.core.device import Film
from femnl.core.readout import Array
from femnl.core.stages import ModalSystem
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

    def read_off(self, changed: Index) -> tuple[Array, Array]:
        """Return frequency (m, k) and loss (m, k) of changed modes (m, k); no loss is (m, 0)."""
        films = np.arange(len(changed))[:, None]
        loss = self.loss[films, changed] if self.loss.size else self.loss
        return self.frequency[films, changed], loss

    def participation(self, changed: Index, own: Array) -> Array:
        """Return that of changed modes (m, k), (3, m, k), given that of base modes, (3, n)."""
        films = np.arange(len(changed))[:, None]
        return np.asarray((own @ self.content**2).transpose(1, 0, 2)[:, films, changed])


def together(rows: Sequence[Array]) -> Array:
    """Return arrays of one shape as rows of one array; of a single one nothing is copied."""
    return rows[0][None] if len(rows) == 1 else np.array(rows)


def with_densities(films: Sequence[Film]) -> Film:
    """Return films that differ in their density alone as one, its density (m, 1) beside lines."""
    first = films[0]
    if len(films) == 1:
        return first
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
    stiffness = together([one.system.stiffness - one.system.unbent for one in solved])
    shapes = np.sqrt(share)[:, :, None] * together([one.vectors for one in solved])
    energy = np.sum(shapes * (stiffness @ shapes), axis=1)
    omega = 2 * np.pi * together([one.frequency for one in solved])
    return np.asarray(np.divide(energy, omega**2, out=np.zeros_like(energy), where=omega > 0))
