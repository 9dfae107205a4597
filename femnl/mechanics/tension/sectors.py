"""Changes of K of a film's deflection, between the symmetry sectors of its mesh."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from femnl.core.domain import Domain, Prestress
from femnl.core.modes import Modes
from femnl.core.operators import POWERS, Units
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import as_matrix, cells, local_matrices, quadrature_order, slope
from femnl.mechanics.fem.sheet import Sheet
from femnl.mechanics.fem.solvers import Solve, factorize
from femnl.mechanics.fem.stress import relaxed_tension, unit_stress
from femnl.mechanics.fem.supports import free_deflections
from femnl.mechanics.modes.operators import Operators
from femnl.mechanics.prestress import YieldingEdges, solve_prestress
from femnl.mechanics.tension.bordered import Bordered, Responding
from femnl.mechanics.tension.effort import Effort

Array = NDArray[np.float64]
Parity = tuple[int, ...]


def _weight(power: tuple[int, int]) -> int:
    return POWERS.index(power)


X2, Y2 = _weight((2, 0)), _weight((0, 2))
XX, YY, XY = 0, 1, 2
PARTS = {
    "deviator": ((0, XX, 1.0), (0, YY, -1.0)),
    # `unit_stress` of xy has 1 in xy and in yx
    "shear": ((0, XY, 1.0),),
    "x": ((_weight((1, 0)), XX, 1.0), (_weight((1, 0)), YY, 1.0)),
    "y": ((_weight((0, 1)), XX, 1.0), (_weight((0, 1)), YY, 1.0)),
    "bowl": ((X2, XX, 1.0), (X2, YY, 1.0), (Y2, XX, 1.0), (Y2, YY, 1.0)),
    "saddle": ((X2, XX, 1.0), (X2, YY, 1.0), (Y2, XX, -1.0), (Y2, YY, -1.0)),
    "product": ((_weight((1, 1)), XX, 1.0), (_weight((1, 1)), YY, 1.0)),
}
"""Film stresses of strength 1: index of the weight, direction, and factor."""
FLIPS = {"shear": (-1, -1), "x": (1, -1), "y": (-1, 1), "product": (-1, -1)}
"""How a film stress behaves under y → −y and x → −x, where it is not even in both."""


@dataclass(frozen=True)
class Change:
    """A change of K that takes deflections of one parity to those of parity times `flip`.

    stiffness: on all base modes and unknowns of responses, by the parity that it acts on.
    """

    flip: Parity
    stiffness: Mapping[Parity, Bordered]


class Sectors:
    """K, M and changes of K on base modes and responses of every symmetry sector.

    Vectors hold shares of the sector's base modes, with ∫ρhw² = 1 over the mesh, and behind them
    values at its free unknowns, see `Bordered`.

    Attributes: effort: how far they are followed; sectors: their parities; mine: for each, which
    modes are its own; free: which of all modes and unknowns; base: K; mass: M.
    """

    def __init__(self, modes: Modes, effort: Effort) -> None:
        self.modes = modes
        self.domain = modes.domain
        self.effort = effort
        self._fine = Space(modes.domain.mesh, modes.degree)
        self.order = quadrature_order(modes.domain.model, 2 * modes.degree)
        self._spanned = Responding(modes, self.effort.degree)
        operators = Operators(modes.prestress, modes.degree)
        mass = self._spanned.of(operators.mass)
        mirrors = len(modes.parity[0])
        self.sectors = tuple(product((1, -1), repeat=mirrors))
        self.mine: dict[Parity, NDArray[np.int64]] = {}
        self.free: dict[Parity, NDArray[np.int64]] = {}
        self.base: dict[Parity, Bordered] = {}
        self.mass: dict[Parity, Bordered] = {}
        self._solve: dict[Parity, Solve] = {}
        for parity in self.sectors:
            mine = np.flatnonzero([own == parity for own in modes.parity])
            free = free_deflections(self._spanned.space, parity, modes.domain.model.clamp)
            self.mine[parity] = mine
            self.free[parity] = np.concatenate([mine, self._spanned.n + free])
            self.base[parity] = self._spanned.of(operators.stiffness(parity)).among(mine, free)
            self.mass[parity] = mass.among(mine, free)

    def release(self) -> None:
        """Let go of the factors of K, whose memory other changes need."""
        self._solve.clear()

    def solve(self, parity: Parity, loads: Array) -> Array:
        """Return K⁻¹ of loads on the unknowns of a sector, with no share of the base modes."""
        if parity not in self._solve:
            # Not before: they take as much memory as the stretched films, solved earlier
            self._solve[parity] = factorize(self.base[parity].inner)
        found = np.zeros_like(loads)
        own = len(self.mine[parity])
        found[own:] = self._solve[parity](loads[own:])
        return found

    def target(self, change: Change, parity: Parity) -> Parity:
        """Return the parity of what a change makes of deflections of the given one."""
        return tuple(a * b for a, b in zip(change.flip, parity, strict=True))

    def act(self, change: Change, parity: Parity, shapes: Array) -> Array:
        """Return ΔK w of deflections w (n_free, m), on the free unknowns of the target."""
        whole = np.zeros((self._spanned.n + self._spanned.space.size, shapes.shape[1]))
        whole[self.free[parity]] = shapes
        return np.asarray(
            (change.stiffness[parity] @ whole)[self.free[self.target(change, parity)]]
        )

    def stresses(self, units: Units) -> dict[str, Change]:
        """Return what the film stresses of `PARTS` add to K, for strength 1."""
        sheet = Sheet(self.domain)
        stress = self.domain.model.film.stress
        parts = {name: self._spanned.gathering() for name in PARTS}
        fields = unit_stress(self.domain, units, self.order)
        for cell, unit in zip(cells(self._fine, self.order), fields, strict=True):
            volume = stress * sheet.thickness(cell.triangles, cell.jet.point) * cell.dx
            steep = slope(cell.jet)
            for name, terms in PARTS.items():
                field = np.zeros(unit.shape[2:])
                for weight, direction, factor in terms:
                    field += factor * unit[weight, direction]
                local = local_matrices(steep, as_matrix(field), volume)
                parts[name].add(local, cell.triangles)
        mirrors = len(self.sectors[0])
        return {
            name: self._alike(part.total(), FLIPS.get(name, (1, 1))[:mirrors])
            for name, part in parts.items()
        }

    def yielding(self, edges: YieldingEdges, chosen: Sequence[int]) -> Iterator[Change]:
        """Yield what the stresses on yielding edges add to K, one at a time for their memory.

        It is counted from the stress on the edge as it is, in elements of the same degree.
        Args: chosen: which edges; −1 is the film stress as deposited.
        """
        edge = self._relaxed(edges.degree)
        before = relaxed_tension(edge, self.order)
        for k in chosen:
            displacement = edges.displacement[k] if k >= 0 else np.zeros_like(edges.displacement[0])
            after = relaxed_tension(Prestress(self.domain, edges.degree, displacement), self.order)
            total = self._spanned.gathering()
            for cell, new, old in zip(cells(self._fine, self.order), after, before, strict=True):
                local = local_matrices(slope(cell.jet), as_matrix(new - old), cell.dx)
                total.add(local, cell.triangles)
            yield self._alike(total.total(), (1,) * len(self.sectors[0]))

    def sides(self, chosen: Sequence[float]) -> Iterator[Change]:
        """Yield what sides Lx eᵘ and Ly e⁻ᵘ add to K, one at a time for their memory.

        That is the film anew on the stretched mesh. Args: chosen: u, of `Effort.sides`.
        """
        degree = self.effort.relaxed_degree
        before = self._stiffness(self._relaxed(degree))
        for u in chosen:
            after = self._stiffness(solve_prestress(stretched(self.domain, u), degree))
            changes = {p: after[p] - before[p] for p in self.sectors}
            yield Change((1,) * len(self.sectors[0]), changes)

    def _relaxed(self, degree: int) -> Prestress:
        """Return the film as it is, relaxed in elements of some degree."""
        known = self.modes.prestress
        return known if degree == known.degree else solve_prestress(self.domain, degree)

    def _stiffness(self, prestress: Prestress) -> dict[Parity, Bordered]:
        operators = Operators(prestress, self.modes.degree)
        return {p: self._spanned.of(operators.stiffness(p)) for p in self.sectors}

    def _alike(self, stiffness: Bordered, flip: Parity) -> Change:
        return Change(flip, dict.fromkeys(self.sectors, stiffness))


def stretched(domain: Domain, u: float) -> Domain:
    """Return the film with x → x eᵘ and y → y e⁻ᵘ, holes and thickness carried along."""
    factor = np.exp([u, -u])
    model = domain.model
    holes = replace(model.holes, centres=model.holes.centres * factor)
    gradient = np.asarray(model.film.gradient) / factor
    film = replace(model.film, gradient=(float(gradient[0]), float(gradient[1])))
    mesh = replace(domain.mesh, doflocs=domain.mesh.doflocs * factor[:, None])
    return replace(domain, mesh=mesh, model=replace(model, holes=holes, film=film), diagonal=False)
