"""The cubic coefficients of the modes, in plane at rest."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from femnl.core.device import Edge
from femnl.core.discretisation_error import remainder
from femnl.core.memory import need_memory
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.mechanics.fem.solvers import factorize
from femnl.mechanics.nonlinearity.stretching import (
    Membrane,
    film_membrane,
    same_parity_only,
    stretching,
)

Array = NDArray[np.float64]
Pairs = list[tuple[int, int]]
Energies = Callable[[Modes, Pairs], Array]

SAFETY = 1.1  # on the remainder of stretching energies, which err apart from the largest values
UNEVEN = 2.6  # the same where holes make the stress uneven
# Of the last difference between degrees, at least, what the in-plane displacement of smooth edges
# leaves
SMOOTH = 0.05
# The same of others: an energy falls at least as 1/degree², which leaves 9/7 of the last
# difference, and a safety
ROUGH = 2.5
PAIR_BYTES = 512  # of memory a triangle and pair of modes: 16 in-plane unknowns, 4 copies


def solve_nonlinearity(
    modes: Modes, edge: Edge, tensor: bool = False, energies: Energies | None = None
) -> Nonlinearity:
    """Solve the cubic coefficients k₃ and α = k₃/k of the modes, and their tensor where asked.

    k₃ = 2 ∫ h C E_ii : E_ii for mode i, in the coordinate q of the point where |ξ| = 1.

    For modes i ≤ j the in-plane displacement u_ij relaxes the strain: ∫ h C (ε(u_ij) + ½
    sym(∇ξᵢ⊗∇ξⱼ)) : ε(v) = 0 for all v; E_ij is the strain in the bracket, G_ijkl = ∫ h C E_ij :
    E_kl, and the force on mode i is −Σ tensor[i,j,k,l] q_j q_k q_l with tensor = (2/3)(G_ijkl +
    G_ikjl + G_iljk).

    Args: edge: in-plane condition of the outline, `clamped`, `sliding` or `paper` (see `Model`).
        tensor: all modes, not the diagonal. energies: G of given modes and pairs, where another way
            to it than `strain_energies` is better.
    Returns: k3 [N/m³], alpha [m⁻²], the tensor, and upper estimates of their errors where the modes
    carry counterparts of lower degrees.
    Valid: slow motion against in-plane waves; amplitudes well below the outline's length.
    Source: von Kármán plate with quasi-static in-plane response; validation cases `duffing_table`,
        `duffing_sliding`, `erratum_alpha`, `static_deflection`.
    """
    n = len(modes.frequency)
    pairs = (
        list(combinations_with_replacement(range(n), 2)) if tensor else [(i, i) for i in range(n)]
    )
    need_memory(
        PAIR_BYTES * modes.domain.mesh.nelements * len(pairs) + 32 * len(pairs) ** 2,
        f"couplings of {n} modes",
        "ask for fewer modes",
    )
    solve = energies or partial(strain_energies, edge=edge)
    grades = [_coefficients(m, pairs, tensor, solve) for m in modes.grades]
    k3, full = grades[0]
    # Of mass-normalised shapes
    scale = np.abs([k for k, _ in grades]) / np.array([m.effective_mass for m in modes.grades]) ** 2
    relative = energy_remainder(modes, edge, list(scale), scale[0]) / scale[0]
    k3_error = k3 * np.hypot(relative, 4 * modes.peak_error)
    alpha = k3 / modes.stiffness
    parts = (relative, 2 * modes.peak_error, 2 * modes.frequency_error / modes.frequency)
    alpha_error = alpha * np.linalg.norm(parts, axis=0)
    return Nonlinearity(
        edge,
        k3,
        alpha,
        k3_error,
        alpha_error,
        full,
        _tensor_error(modes, edge, grades, k3) if tensor else None,
    )


def _coefficients(
    modes: Modes, pairs: Pairs, tensor: bool, solve: Energies
) -> tuple[Array, Array | None]:
    """Return k₃ of each mode and, where asked for, the tensor."""
    n = len(modes.frequency)
    energies = solve(modes, pairs)
    position = {pair: k for k, pair in enumerate(pairs)}
    k3 = 2 * np.array([energies[position[i, i], position[i, i]] for i in range(n)])
    missing = np.where(np.isnan(modes.frequency), np.nan, 1.0)
    return k3 * missing, _symmetrise(energies, position, n) if tensor else None


def energy_remainder(modes: Modes, edge: Edge, values: Sequence[Array], scale: Array) -> Array:
    """Return the discretisation errors of stretching energies of mass-normalised shapes.

    They are estimated from solutions of three degrees, or of two.

    At an inner corner of the outline, and at corners of sliding edges other than 90°, the in-plane
    displacement converges slowly.

    Args: values: fine, coarse and coarsest. scale: their natural size.
    """
    angles = np.array([angle for _, angle in modes.domain.model.outline.corners])
    rough = np.any(angles > np.pi + 1e-6) or (
        edge == "sliding" and np.any(np.abs(angles - np.pi / 2) > 1e-6)
    )
    safety = UNEVEN if modes.domain.model.pierced else SAFETY
    return (
        remainder(values[:3], scale, ROUGH if rough else SMOOTH, safety)
        if len(values) > 1
        else np.full(scale.shape, np.inf)
    )


def _tensor_error(
    modes: Modes, edge: Edge, grades: list[tuple[Array, Array | None]], k3: Array
) -> Array:
    """Return the errors of the tensor's entries.

    They come from the mass-normalised shapes, and from the four largest values that scale them.
    """
    peak = modes.peak_error
    unit = np.abs(k3) ** 0.25
    scale = np.einsum("i,j,k,l->ijkl", unit, unit, unit, unit)
    normal = []
    for m, (_, full) in zip(modes.grades, grades, strict=True):
        size = np.sqrt(m.effective_mass / modes.effective_mass)
        normal.append(
            np.einsum("ijkl,i,j,k,l->ijkl", np.empty(0) if full is None else full, *(1 / size,) * 4)
        )
    relative = energy_remainder(modes, edge, normal, scale) / scale
    four = sum(np.expand_dims(peak, tuple(a for a in range(4) if a != axis)) for axis in range(4))
    known = np.isfinite(four)
    return np.asarray(
        np.where(known, np.hypot(scale * relative, normal[0] * np.where(known, four, 0.0)), np.inf)
    )


def _symmetrise(energies: Array, position: dict[tuple[int, int], int], n: int) -> Array:
    index = np.array([[position[min(i, j), max(i, j)] for j in range(n)] for i in range(n)])
    g = energies[index[:, :, None, None], index[None, None]]
    return np.asarray(2 / 3 * (g + g.transpose(0, 2, 1, 3) + g.transpose(0, 3, 2, 1)))


def strain_energies(
    modes: Modes, pairs: Pairs, edge: Edge, membrane: Membrane | None = None
) -> Array:
    """Return G over the whole film for all combinations of pairs, (n_pairs, n_pairs) [N/m³].

    G_PQ = ∫ h C m_P : m_Q − ∫ h C ε(u_P) : ε(u_Q), with m_P the second-order strain of a pair of
    modes and u_P the in-plane displacement that relaxes it.

    Args: membrane: h C (..., 3, 3) [N/m] at the points of a cell, for films that are not of one
    material; the film's by default.
    """
    domain = modes.domain
    film = stretching(modes, pairs, membrane or film_membrane(modes, edge))
    energies = film.energies.copy()
    for members, supports in film.sectors(domain.wedge, edge):
        solve = factorize(csc_matrix(supports.T @ film.stiffness @ supports))
        loads = film.loads[:, members]
        energies[np.ix_(members, members)] -= loads.T @ (supports @ solve(supports.T @ loads))
    return same_parity_only(energies, film.parities) * domain.copies
