"""A basis of base modes and of what changes of the tension make of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.mechanics.tension.sectors import Change, Parity, Sectors

Array = NDArray[np.float64]

WIDEST = 200
"""Responses of one sector that are held at a time before the weak ones are dropped."""


@dataclass(frozen=True)
class Response:
    """A change of K, how strong it may be, and the changes that follow it.

    after: names of the changes whose second response is followed; again: those of them whose third
    one is, by the same change once more.
    """

    change: Change
    strongest: float
    after: tuple[str, ...] = ()
    again: tuple[str, ...] = ()


@dataclass(frozen=True)
class Basis:
    """Vectors of every sector, orthonormal in M, the base modes first.

    vectors: of `Sectors`, (n_own, k) by parity; place: (k,) by parity, where each stands among all
    of them, with the n base modes in their own order before the others; size: how many there are.
    """

    vectors: Mapping[Parity, Array]
    place: Mapping[Parity, NDArray[np.int64]]
    size: int


class _Gathered:
    """Responses in one sector, weighted by how strong they get, without those that stay weak."""

    def __init__(self, sectors: Sectors, parity: Parity, base: Array, least: float) -> None:
        self._stiffness = sectors.base[parity]
        self._mass = sectors.mass[parity]
        self._base = base
        self._least = least
        self._found = np.empty((len(sectors.free[parity]), 0))

    def beyond(self, shapes: Array) -> Array:
        """Return the part of shapes that the base modes do not span."""
        return np.asarray(shapes - self._base @ (self._base.T @ (self._mass @ shapes)))

    def add(self, shapes: Array) -> None:
        """Gather weighted shapes (n_free, m)."""
        self._found = np.concatenate([self._found, shapes], axis=1)
        if self._found.shape[1] > WIDEST:
            self._found = self._strong(self._least / 3)

    def _strong(self, least: float) -> Array:
        """Return the directions whose √energy is above `least`, with that amplitude."""
        values, turn = np.linalg.eigh(self._found.T @ (self._stiffness @ self._found))
        return np.asarray(self._found @ turn[:, values > least**2])

    def vectors(self) -> Array:
        """Return base modes and strong responses, orthonormal in M."""
        both = np.concatenate([self._base, self._strong(self._least)], axis=1)
        both = both / np.sqrt(np.sum(both * (self._mass @ both), axis=0))
        lower = np.linalg.cholesky(both.T @ (self._mass @ both))
        return np.asarray(np.linalg.solve(lower, both.T).T)


def enriched(sectors: Sectors, responses: Mapping[str, Response]) -> Basis:
    """Return the base modes with their responses to changes p of K.

    First K⁻¹K_p ξ of every mode. Of the lower half of the modes, which follow changes most, also
    K⁻¹M K⁻¹K_p ξ, which lets a response go with its own frequency, and the second and third
    responses K⁻¹K_q K⁻¹K_p ξ of changes together, the third where `Effort.further` says so. Each
    counts by the strengths it takes.
    """
    modes = sectors.modes
    square = (2 * np.pi * modes.frequency) ** 2
    count = len(square)
    least = sectors.effort.kept * float(np.sqrt(square[count // 4]))
    base = {p: (mine, np.eye(len(sectors.free[p]), len(mine))) for p, mine in sectors.mine.items()}
    gathered = {p: _Gathered(sectors, p, base[p][1], least) for p in sectors.sectors}

    def respond(change: Change, parity: Parity, shapes: Array) -> tuple[Parity, Array]:
        target = sectors.target(change, parity)
        moved = sectors.solve(target, sectors.act(change, parity, shapes))
        return target, gathered[target].beyond(moved)

    for response in responses.values():
        strong = response.strongest
        for parity, (mine, shapes) in base.items():
            if len(mine) == 0:
                continue
            low = mine < count // 2
            target, first = respond(response.change, parity, shapes)
            # A high mode takes part in a low one by a further strength
            gathered[target].add(first * np.where(low, strong, strong**2))
            if not np.any(low):
                continue
            first = first[:, low]
            again = sectors.solve(target, sectors.mass[target] @ first)
            gathered[target].add(gathered[target].beyond(again) * square[mine[low]] * strong)
            for name in response.after:
                then = responses[name]
                second_target, second = respond(then.change, target, first)
                gathered[second_target].add(second * strong * then.strongest)
                if name in response.again and sectors.effort.further:
                    third_target, third = respond(then.change, second_target, second)
                    gathered[third_target].add(third * strong * then.strongest**2)
    return _numbered(base, {p: found.vectors() for p, found in gathered.items()})


def _numbered(
    base: Mapping[Parity, tuple[NDArray[np.int64], Array]], vectors: Mapping[Parity, Array]
) -> Basis:
    start = sum(len(mine) for mine, _ in base.values())
    place = {}
    for parity, (mine, _) in base.items():
        more = vectors[parity].shape[1] - len(mine)
        place[parity] = np.concatenate([mine, np.arange(start, start + more)])
        start += more
    return Basis(vectors, place, start)


def base_stiffness(sectors: Sectors, basis: Basis) -> Array:
    """Return K on a basis, (size, size) [s⁻²]."""
    found = np.zeros((basis.size, basis.size))
    for parity, vectors in basis.vectors.items():
        place = basis.place[parity]
        found[np.ix_(place, place)] = vectors.T @ (sectors.base[parity] @ vectors)
    return (found + found.T) / 2


def on_basis(sectors: Sectors, basis: Basis, change: Change) -> Array:
    """Return a change of K on a basis, (size, size) [s⁻²]."""
    found = np.zeros((basis.size, basis.size))
    for parity, vectors in basis.vectors.items():
        target = sectors.target(change, parity)
        block = np.ix_(basis.place[target], basis.place[parity])
        found[block] = basis.vectors[target].T @ sectors.act(change, parity, vectors)
    return (found + found.T) / 2


def responses_of(
    stresses: Mapping[str, Change],
    sides: Sequence[Change],
    yielding: Sequence[Change],
) -> dict[str, Response]:
    """Return which responses are followed, and how far.

    Uniform stresses by up to 0.1 σ, deposited ones by 0.05 σ, as the effects allow; stretched sides
    and yielding edges are at full strength, a part of which only scales the modes.
    """
    uniform = ("deviator", "shear")
    uneven = ("x", "y", "bowl")
    edges = tuple(f"yielding {k}" for k in range(len(yielding)))
    found = {name: Response(stresses[name], 0.1, uniform, (name,)) for name in uniform}
    found |= {name: Response(stresses[name], 0.05, uneven) for name in uneven}
    found |= {name: Response(stresses[name], 0.05) for name in ("saddle", "product")}
    for k, change in enumerate(sides):
        name = f"sides {k}"
        found[name] = Response(change, 0.5, (name,), (name,))
    for name, change in zip(edges, yielding, strict=True):
        found[name] = Response(change, 0.5, edges, (name,))
    return found
