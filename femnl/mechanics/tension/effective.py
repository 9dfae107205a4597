"""Effective stiffness: a polynomial in the changes of the tension, on the base modes alone."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from femnl.core.memo import recent
from femnl.core.modes import Modes
from femnl.core.operators import Units
from femnl.core.tension import (
    STRENGTHS,
    YIELDS_MOST,
    TensionChanges,
    compliance_at,
    strengths,
    yielding,
)
from femnl.mechanics.prestress import YieldingEdges, solve_yielding
from femnl.mechanics.tension.basis import base_stiffness, enriched, on_basis, responses_of
from femnl.mechanics.tension.effort import SIDES_MOST, Effort
from femnl.mechanics.tension.sectors import PARTS, Sectors

Array = NDArray[np.float64]

STEPS = 3
"""Of subspace iteration; each brings a mode a third up the spectrum of the base modes ten times
nearer.
"""
YIELDING_STEPS = 10
YIELDING = tuple(
    yielding(YIELDS_MOST)
    * (1 - np.cos(np.pi * np.arange(1, YIELDING_STEPS + 1) / YIELDING_STEPS))
    / 2
)
"""Yielding edges t that are solved: Chebyshev's points, without that of 0."""
FOLLOWED = (3, YIELDING_STEPS - 1)
"""Of those, the edges whose responses make the basis."""
STRONGEST = dict.fromkeys(PARTS, 0.05) | {
    "deviator": 0.1,
    "shear": 0.1,
    "sides": SIDES_MOST,
    "yielding": yielding(YIELDS_MOST),
}
"""Strengths up to which the polynomials are fitted."""
FIRST = dict.fromkeys(STRENGTHS, 1) | {"yielding": 2}
"""The lowest power of each strength."""
TOGETHER: tuple[tuple[tuple[str, ...], int], ...] = (
    (("deviator", "shear"), 8),
    (("x", "y", "bowl"), 4),
    (("saddle",), 3),
    (("product",), 3),
    (("sides",), 6),
    (("yielding",), 15),
)
"""Changes that one polynomial holds together, and its total degree."""


@dataclass(frozen=True)
class _Enlarged:
    """K of the film on an enriched basis whose first n vectors are the base modes.

    base (N, N); stresses: matrices of the film stresses by name; sides (m, N, N): what those of
    `solved_sides` add to K; edges (1 + m, N, N): the film stress as deposited, and that of each of
    the yielding edges. cut: the largest ω² of the base modes.
    """

    n: int
    base: Array
    stresses: Mapping[str, Array]
    solved_sides: Array
    sides: Array
    edges: Array
    yielding: YieldingEdges
    reach: float
    cut: float

    def stiffness(self, changes: Mapping[str, float]) -> Array:
        """Return K (N, N) [s⁻²] under changes of the tension."""
        found = self.base.copy()
        for name, strength in changes.items():
            if name in self.stresses:
                found += strength * self.stresses[name]
            elif name == "sides":
                found += np.tensordot(_through_zero(self.solved_sides, strength), self.sides, 1)
            else:
                shares = self._shares(compliance_at(strength) * self.reach)
                found += np.tensordot(np.append(1 - shares.sum(), shares), self.edges, 1)
        return found

    @cached_property
    def _shares(self) -> Callable[[float], Array]:
        """Shares of the solved edges, which many points of a fit ask for again."""
        return recent(self.yielding.shares)

    def effective(self, changes: Mapping[str, float]) -> Array:
        """Return the effective stiffness (n, n) [s⁻²] of the base modes under changes.

        T = F(K⁻¹)P with Chebyshev's polynomial F of degree `STEPS`, which is at most 1 above the
        base modes and grows below, holds the lowest modes of the changed film. On it K is turned
        into H = (SᵀS)^−½ SᵀKS (SᵀS)^−½ with S = T (PᵀT)⁻¹, the symmetric one nearest to the base
        modes. Being a smooth function of K, H has no crossings of levels to follow.
        Source: des Cloizeaux, Nucl. Phys. 20, 321 (1960); Zhou & Saad, SIAM J. Matrix Anal. Appl.
        29, 954 (2007), for the filter.
        """
        stiffness = self.stiffness(changes)
        n = self.n
        factor = cho_factor(stiffness)
        before = np.eye(len(stiffness), n)
        trial = 2 * self.cut * cho_solve(factor, before) - before
        for _ in range(STEPS - 1):
            after = 2 * (2 * self.cut * cho_solve(factor, trial) - trial) - before
            before = trial
            trial = after
        trial = np.asarray(np.linalg.solve(trial[:n].T, trial.T).T, dtype=np.float64)
        values, vectors = np.linalg.eigh(trial.T @ trial)
        root = (vectors / np.sqrt(values)) @ vectors.T
        found = root @ (trial.T @ stiffness @ trial) @ root
        return np.asarray((found + found.T) / 2)


def solve_tension(modes: Modes, units: Units, effort: Effort) -> TensionChanges:
    """Solve what changes of the tension add to K on the base modes.

    The film is expanded in the base modes and in their responses to every change, which is as good
    as solving it anew, and then condensed onto the base modes alone.

    Args: modes: of a quarter of the film or more. units: how the film relaxes in its plane under
        the film stresses. effort: how far responses are followed, of `effort_of`.
    Returns: a polynomial in the strengths of the changes.
    Valid: up to `STRONGEST`. There the lowest third of the modes has the frequencies of the film
        solved anew on the same mesh, see `tests/physics/test_changed_tension.py`; for meshes of
        many unknowns see `effort_of`.
    """
    enlarged = _enlarge(modes, units, effort)
    scale = np.sqrt(np.outer(modes.effective_mass, modes.effective_mass))
    return _fit(enlarged, scale / modes.domain.model.film.stress)


def _enlarge(modes: Modes, units: Units, effort: Effort) -> _Enlarged:
    sectors = Sectors(modes, effort)
    # What takes most memory comes first
    first, *further, last = sectors.effort.sides
    outer = list(sectors.sides((first, last)))
    compliances = [compliance_at(t) * units.reach for t in YIELDING]
    between = solve_yielding(modes.domain, sectors.effort.relaxed_degree, compliances)
    stresses = sectors.stresses(units)
    followed = list(sectors.yielding(between, FOLLOWED))
    basis = enriched(sectors, responses_of(stresses, outer, followed))
    sectors.release()
    edges = sectors.yielding(between, range(-1, len(compliances)))
    at_first, at_last = (on_basis(sectors, basis, change) for change in outer)
    outer.clear()
    inner = [on_basis(sectors, basis, change) for change in sectors.sides(further)]
    return _Enlarged(
        len(modes.frequency),
        base_stiffness(sectors, basis),
        {name: on_basis(sectors, basis, change) for name, change in stresses.items()},
        np.array(sectors.effort.sides),
        np.array([at_first, *inner, at_last]),
        np.array([on_basis(sectors, basis, change) for change in edges]),
        between,
        units.reach,
        float((2 * np.pi * modes.frequency[-1]) ** 2),
    )


def _through_zero(points: Array, place: float) -> Array:
    """Return the weight of what each solved u (n,) adds to K in what another u adds.

    K is combined of e^{±2u}, as a film without holes has it where nothing bends, e^{±4u}, as
    bending has it, and so on; n is even.
    """
    factors = np.array([s * 2 * k for k in range(1, len(points) // 2 + 1) for s in (1, -1)])
    known = np.expm1(np.multiply.outer(factors, points))
    return np.asarray(np.linalg.solve(known, np.expm1(factors * place)))


def _fit(enlarged: _Enlarged, scale: Array) -> TensionChanges:
    """Return the polynomial through effective stiffnesses, as K/σ [m]."""
    rest = enlarged.effective({})
    found = TensionChanges(np.zeros((0, len(STRENGTHS)), np.int64), np.zeros((0, *rest.shape)))
    for names, degree in TOGETHER:
        powers = [
            p
            for p in product(*((0, *range(FIRST[name], degree + 1)) for name in names))
            if 0 < sum(p) <= degree
        ]
        points = list(product(*(_points(name, degree + 1) for name in names)))
        found = _extended(found, enlarged, rest, names, points, powers)
    held = {pair for names, _ in TOGETHER for pair in combinations(names, 2)}
    for pair in combinations(STRENGTHS, 2):
        if pair in held:
            continue
        counts = _pair_counts(pair)
        powers = list(
            product(*(range(FIRST[k], FIRST[k] + n) for k, n in zip(pair, counts, strict=True)))
        )
        axes = (_points(name, n + 1) for name, n in zip(pair, counts, strict=True))
        points = [point for point in product(*axes) if all(point)]
        found = _extended(found, enlarged, rest, pair, points, powers)
    return TensionChanges(found.powers, found.matrices * scale)


def _pair_counts(pair: tuple[str, str]) -> tuple[int, int]:
    """Return how many powers of each strength a pair of changes has: more beside a yielding edge.

    That slackens the film by up to a quarter, and what acts beside it is then stronger.
    """
    first, second = (2, 2) if "yielding" not in pair else (4, 3)
    return first, second


def _points(name: str, count: int) -> Array:
    """Return Chebyshev's points of a strength, both ends among them.

    The points of a strength without negative values begin at 0. Every polynomial passes through
    that one, so that it is left out.
    """
    cosine = np.cos(np.pi * np.arange(count) / (count - 1))
    if name == "yielding":
        return np.asarray(STRONGEST[name] * (1 - cosine[1:]) / 2)
    # Even numbers of intervals have 0 in the middle, not 6e-17
    return np.asarray(STRONGEST[name] * np.round(-cosine, 15))


def _extended(
    known: TensionChanges,
    enlarged: _Enlarged,
    rest: Array,
    names: tuple[str, ...],
    points: Sequence[tuple[float, ...]],
    powers: Sequence[tuple[int, ...]],
) -> TensionChanges:
    """Add terms of the given powers of the named strengths: by least squares at points."""
    rows = []
    for point in points:
        changes = dict(zip(names, point, strict=True))
        rows.append((enlarged.effective(changes) - rest - known(strengths(changes))).ravel())
    unit = np.array([STRONGEST[name] for name in names])
    exponents = np.array(powers)
    terms = np.prod((np.array(points) / unit)[:, None, :] ** exponents, axis=2)
    solution = np.linalg.lstsq(terms, np.array(rows), rcond=None)[0]
    solution /= np.prod(unit**exponents, axis=1)[:, None]
    more = np.zeros((len(powers), len(STRENGTHS)), np.int64)
    more[:, [STRENGTHS.index(name) for name in names]] = exponents
    return TensionChanges(
        np.concatenate([known.powers, more]),
        np.concatenate([known.matrices, solution.reshape(-1, *rest.shape)]),
    )
