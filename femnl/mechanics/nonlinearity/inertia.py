"""What the film's inertia in its own plane changes of the cubic coefficients."""

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import LinearOperator, minres

from femnl.core.arrays import freeze
from femnl.core.device import Edge
from femnl.core.errors import ConvergenceError
from femnl.core.modes import DEGENERATE, Modes
from femnl.mechanics.fem.solvers import Solve, factorize
from femnl.mechanics.nonlinearity.cubic import energy_remainder
from femnl.mechanics.nonlinearity.stretching import (
    film_membrane,
    in_plane_mass,
    same_parity_only,
    stretching,
)

Array = NDArray[np.float64]

# residual of a response, relative: where the iteration ends, in its own norms, and what is accepted
RESPONSE = 1e-15
SETTLED = 1e-7
MOST_STEPS = 400


@dataclass(frozen=True)
class Inertia:
    """What in-plane inertia changes of the cubic coefficients of modes, relative.

    K₃ and α of each mode go as 1 + change.

    change (n,); cross (n, n), where asked for: the same of tensor[i,i,j,j], by which mode j shifts
    mode i, NaN where the two share a frequency. change_error, cross_error: discretisation errors,
    absolute, upper estimates, infinite without counterparts.
    """

    edge: str
    change: Array
    change_error: Array
    cross: Array | None = None
    cross_error: Array | None = None

    def __post_init__(self) -> None:
        freeze(self)


def solve_inertia(modes: Modes, edge: Edge | None = None, cross: bool = False) -> Inertia:
    """Return what the inertia of the film in its plane changes of k₃ and α.

    The film follows the second-order load at 0 and at 2ω.

    The load of modes i, j moving at ω_i, ω_j has the frequencies ω_i ± ω_j. With S_P(s) = f·(K −
    sM)⁻¹f, f the in-plane load of a pair P, the part of the cubic force in step with the motion
    gives

        k₃ = 2 (A_ii − ⅔ S_ii(0) − ⅓ S_ii(4ω²)),  tensor[i,i,j,j] = ⅔ (G_iijj + 2 A_ij − S_ij((ω_i +
        ω_j)²) − S_ij((ω_i − ω_j)²)),

    where A_P = ∫ h C m_P : m_P and G_iijj are those of `solve_nonlinearity`, from which both follow
    at ω = 0.

    Args: edge: as in `solve_nonlinearity`, the model's by default. cross: between modes too.
    Returns: the relative changes: of order −(σ/E)(1 − ν²), as that is the square of the speeds'
    ratio.
    Raises: ConvergenceError where ω_i ± ω_j meets an in-plane resonance.
    Valid: as von Kármán's plate, which leaves out other changes of the order σ/E: in-plane
        stiffness by the film stress itself, and what the material does beyond Hooke's law. Modes of
        one frequency exchange energy, which no shift of frequency tells.
    Source: first-order averaging with a linear in-plane field, Nayfeh & Mook, Nonlinear
        Oscillations (1979), sections 2.3 and 7.3; held against a closed form and integration in
        time by tests/physics/test_inertia.py.
    """
    edge = edge or modes.domain.model.edge
    grades = [_changes(m, edge, cross) for m in modes.grades]

    def error(values: list[Array]) -> Array:
        return energy_remainder(modes, edge, values, np.abs(values[0]))

    own = [np.diagonal(c) for c in grades]
    return Inertia(
        edge, own[0], error(own), grades[0] if cross else None, error(grades) if cross else None
    )


def _changes(modes: Modes, edge: Edge, cross: bool) -> Array:
    """Return the relative changes of tensor[i,i,j,j], (n, n).

    Only the diagonal is computed where no cross coefficients are asked for.
    """
    n = len(modes.frequency)
    omega = 2 * np.pi * modes.frequency
    pairs = (
        list(combinations_with_replacement(range(n), 2)) if cross else [(i, i) for i in range(n)]
    )
    film = stretching(modes, pairs, film_membrane(modes, edge))
    mass = in_plane_mass(modes, film.space)
    # ½ Σ± of S(s) − S(0), which needs no difference of large numbers
    energies = film.energies.copy()
    rise = np.zeros(len(pairs))
    for members, supports in film.sectors(modes.domain.wedge, edge):
        stiffness, inertia = (csc_matrix(supports.T @ m @ supports) for m in (film.stiffness, mass))
        solve = factorize(stiffness)
        loads = supports.T @ film.loads[:, members]
        still = solve(loads)
        energies[np.ix_(members, members)] -= loads.T @ still
        for column, k in enumerate(members):
            i, j = pairs[k]
            for square in ((omega[i] + omega[j]) ** 2, (omega[i] - omega[j]) ** 2):
                if square > 0:  # NaN where a mode has no counterpart
                    moved = respond(stiffness, inertia, solve, square, loads[:, column])
                    rise[k] += square * float(still[:, column] @ (inertia @ moved)) / 2
    energies = same_parity_only(energies, film.parities)
    position = {pair: k for k, pair in enumerate(pairs)}
    result = np.full((n, n), np.nan)
    for (i, j), k in position.items():
        own = i == j
        if own or not np.abs(omega[i] - omega[j]) < DEGENERATE * omega[i]:
            whole = (
                3 * energies[k, k]
                if own
                else energies[position[i, i], position[j, j]] + 2 * energies[k, k]
            )
            result[i, j] = result[j, i] = -2 * rise[k] / whole + 0 * (omega[i] + omega[j])
    return result


def respond(
    stiffness: csc_matrix, mass: csc_matrix, solve: Solve, square: float, load: Array
) -> Array:
    """Response x of (K − ω²M) x = load, from the factors of K alone, for ω² = `square` [rad²/s²].

    Source: Paige & Saunders, SIAM J. Numer. Anal. 12, 617 (1975), with K as preconditioner: the few
    eigenvalues that are not near one cost a step each.
    """
    size = stiffness.shape
    shifted = LinearOperator(
        size, matvec=lambda x: stiffness @ x - square * (mass @ x), dtype=float
    )
    found, _ = minres(
        shifted,
        load,
        M=LinearOperator(size, matvec=solve, dtype=float),
        rtol=RESPONSE,
        maxiter=MOST_STEPS,
    )
    # Without a solution the iteration still ends, at the least residual.
    if not np.linalg.norm(load - shifted @ found) <= SETTLED * np.linalg.norm(load):
        raise ConvergenceError(
            f"the response at {np.sqrt(square) / (2 * np.pi):.6g} Hz, sum or difference of modes, "
            "did not converge: it meets a resonance; change the device a little, or ask for "
            "fewer modes"
        )
    return np.asarray(found)
