"""Modes of a film that is bent at rest, with their quadratic and cubic coefficients."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csc_matrix

from femnl.core.arrays import freeze
from femnl.core.device import Edge
from femnl.core.errors import ParameterError
from femnl.core.memory import need_memory
from femnl.core.modes import DEGENERATE, Modes
from femnl.mechanics.fem.offset import layers_end_within
from femnl.mechanics.fem.solvers import factorize, lowest_eigenpairs
from femnl.mechanics.modes.shapes import largest_value
from femnl.mechanics.nonlinearity import energy_remainder, respond
from femnl.mechanics.static_deflection.film import Film, Parity
from femnl.mechanics.static_deflection.shallow import refuse_deep, refuse_rest

Array = NDArray[np.float64]

LEAST = 1e-12  # bow [m] whose k₂ is the least that errors of k₂ are measured by
# Modes beyond those asked for in each symmetry, so that each flat mode finds its bowed one
SPARE = 3
TRIANGLE_BYTES = 270_000  # of memory: three times what the deflection alone takes


@dataclass(frozen=True)
class StaticDeflection:
    """Modes of a film bent at rest, in the order of the flat film's.

    Their coordinate q [m] is the displacement, from rest, of the point where |ξ| = 1.

    m q̈ = −k q − k₂ q² − k₃ q³. depth [m]: the largest deflection at rest, with its sign. frequency
    [Hz], stiffness k [N/m], k2 [N/m²], k3 [N/m³] relaxed in plane. alpha [m⁻²]: the cubic
    coefficient over k that the motion at ω has, from k₃ and from what k₂ drives at 0 and at 2ω in
    this and in all other modes; k₃/k − (10/9)(k₂/k)² holds the mode's own part. shapes (n_modes,
    n_dofs) as in `Modes`, of the deflection. Errors: discretisation, absolute, upper estimates,
    infinite where the modes carry no counterparts.
    """

    edge: str
    depth: float
    frequency: Array
    stiffness: Array
    k2: Array
    k3: Array
    alpha: Array
    shapes: Array
    frequency_error: Array
    k2_error: Array
    k3_error: Array
    alpha_error: Array

    def __post_init__(self) -> None:
        freeze(self)


def solve_static_deflection(
    modes: Modes,
    depth: float | None = None,
    pressure: float | None = None,
    shape: int = 0,
    stressed: bool = True,
    edge: Edge | None = None,
) -> StaticDeflection:
    """Return the frequencies, quadratic and cubic coefficients of a film that is bent at rest.

    About the rest state (u₀, w₀) the energy W of `Film` has the second derivative K_t, and for a
    mode x with K_t x = ω² M x the load of second order f and A = ∫ h C E₂ : E₂ of
    `Film.second_order`. Then

        k₂ = f·x,  k₃ = 2 (A − f·K_uu⁻¹f),  α = (2/k) [A − ⅔ f·K_t⁻¹f − ⅓ f·(K_t − 4ω²M)⁻¹f].

    f pushes the film in plane and out of it: the last two terms are the in-plane relaxation and the
    response of all modes at 0 and 2ω. A bow b in a mode's own shape, small, gives k + 3k₃b² (k +
    2k₃b² where not `stressed`) and k₂ = 3k₃b.

    Layers bend the film by their own stresses, alone or with a pressure. Those that cover it evenly
    do so from edges that are free or may turn, by the load M₀ ∮ ∂ₙv of `fem.offset.own_moment`.
    Where a layer has a shape, W also holds what `Eccentricity` says, by which the film bends about
    its middle and stretches as it does: frequencies then differ from those of the flat film, which
    bends about the neutral plane, even where it does not bend at rest.

    Args: depth: [m] of a bow in the shape of the mode `shape` (0 is the fundamental), held by
        whatever load that takes. pressure: [Pa] on an even film, pushing towards +w; instead of
        depth. Neither: what layers do. stressed: the model's film stress is that of the flat film,
        which the bow stretches further; false where it is that of the bowed film already, as over a
        frame that is not flat. edge: in-plane edge, the model's by default.
    Returns: StaticDeflection, in the order of the modes.
    Raises: ParameterError, ConvergenceError (also where 2ω meets another mode: then the two
    exchange energy, and no α describes it).
    Valid: shallow bows, |∇w₀| ≪ 1; a load that stays as it is while the film moves; in-plane motion
    without inertia.
    Source: expansion of von Kármán's energy; averaging as in Nayfeh & Mook, Nonlinear Oscillations
        (1979), section 4.1. Held against sine series and Newton's method by
        tests/physics/test_bow.py and validation case `bowed_film`, and with layers against
        collocation by tests/physics/test_layers_at_rest.py and test_layers_that_end.py.
    """
    refuse_rest(modes.domain.model, depth, pressure)
    if modes.first > 1:
        raise ParameterError(
            f"bow: the modes begin with number {modes.first}; those of a bent film follow from "
            "the lowest ones, so solve these"
        )
    if pressure is not None and not stressed:
        raise ParameterError(
            "bow: a pressure stretches the film; stressed = False goes with a depth"
        )
    if not 0 <= shape < len(modes.frequency):
        raise ParameterError(
            f"shape = {shape}: expected 0 to {len(modes.frequency) - 1}, the modes that were solved"
        )
    need_memory(
        TRIANGLE_BYTES * modes.domain.mesh.nelements,
        "the couplings of a bowed film",
        "lower the resolution",
    )
    edge = edge or modes.domain.model.edge
    grades = [_bend(m, edge, depth, pressure, shape, stressed) for m in modes.grades]
    found = grades[0]
    if pressure is not None:
        refuse_deep(found.depth, modes.domain.model.outline.length, pressure)
    peak = modes.peak_error
    bow = peak[shape] if depth is not None else 0.0

    rise = np.abs(found.rise - 1)
    # No rise is exact, even where the bow's error is not known
    risen = np.multiply(rise, bow, out=np.zeros_like(rise), where=rise > 0)

    def error(name: str, power: int, bows: int) -> Array:
        """Return the error of a coefficient that goes with powers of max|ξ| and of the depth."""
        if len(grades) < 2:
            return np.full(len(peak), np.inf)
        normal = [np.asarray(getattr(grade, name)) / grade.mass ** (power / 2) for grade in grades]
        usual = (
            np.abs(3 * found.k3 * (abs(found.depth) + LEAST) / found.mass**1.5)
            if name == "k2"
            else np.abs(normal[0])
        )
        own = energy_remainder(modes, edge, normal, usual) * found.mass ** (power / 2)
        return np.asarray(own + np.abs(getattr(found, name)) * (power * peak + bows * bow))

    return StaticDeflection(
        edge,
        found.depth,
        modes.frequency * found.rise,
        found.k,
        found.k2,
        found.k3,
        found.alpha,
        found.shapes,
        modes.frequency_error * found.rise + modes.frequency * (error("rise", 0, 0) + 2 * risen),
        error("k2", 3, 1),
        error("k3", 4, 0),
        error("alpha", 2, 0),
    )


@dataclass(frozen=True)
class _Numbers:
    """What one grade of the modes gives: see `StaticDeflection`.

    rise: f over that of the flat film; mass: m_eff [kg].
    """

    depth: float
    rise: Array
    mass: Array
    k: Array
    k2: Array
    k3: Array
    alpha: Array
    shapes: Array


def _bend(
    modes: Modes,
    edge: Edge,
    depth: float | None,
    pressure: float | None,
    shape: int,
    stressed: bool,
) -> _Numbers:
    model = modes.domain.model
    eccentric = depth is None and model.bending and layers_end_within(model)
    film = Film(modes, edge, eccentric)
    even = tuple(abs(p) for p in modes.parity[0])
    if depth is not None:
        parity = modes.parity[shape]
        rest = film.relax(depth * modes.shapes[shape], even)
    else:
        parity = even
        rest = film.deflect((pressure or 0.0) * film.area + film.of_layers, even)
    _, tangent = film.stretching(rest, stressed)
    square, motions = _bowed_modes(film, modes, parity, rest, tangent)
    w = motions[:, 2 * film.space.size :]
    copies = film.domain.copies
    mass = film.domain.copies * np.einsum("ni,ni->n", w, (film.mass @ w.T).T)
    loads, energies = film.second_order(rest, motions, modes.parity)
    own = np.array([p == parity for p in modes.parity])  # else the integral over the film vanishes
    # 0 and not −0 where it vanishes
    k2 = copies * own * np.einsum("in,ni->n", loads, motions) + 0.0
    tangent = csc_matrix(tangent + film.coupling(rest, parity)[1])
    flat, still, moved = _responses(film, tangent, parity, loads, square)
    k = mass * square
    bent = rest[2 * film.space.size :]
    deepest = float(largest_value(film.space, bent)) if np.any(bent) else 0.0
    k3 = 2 * copies * (energies - flat)
    alpha = 2 * copies * (energies - 2 / 3 * still - moved / 3) / k
    return _Numbers(
        deepest, np.sqrt(square) / (2 * np.pi * modes.frequency), mass, k, k2, k3, alpha, w
    )


def _bowed_modes(
    film: Film, modes: Modes, bow: Parity, rest: Array, tangent: csc_matrix
) -> tuple[Array, Array]:
    """Return ω² (n,) of the deflected modes that follow from each flat one, and their motions.

    The motions (n, 3·size) have max|w| = 1.
    """
    size = film.space.size
    square = np.full(len(modes.frequency), np.nan)
    motions = np.zeros((len(modes.frequency), 3 * size))
    for parity in sorted(set(modes.parity)):
        members = [
            k for k, p in enumerate(modes.parity) if p == parity and np.isfinite(modes.frequency[k])
        ]
        if not members:
            continue
        columns = film.admissible(parity, bow)
        beside = film.coupling(rest, parity)[1]
        stiffness = csc_matrix(columns.T @ (tangent + beside + film.linear(parity)) @ columns)
        mass = csc_matrix(columns.T @ film.inertia @ columns)
        values, vectors = lowest_eigenpairs(stiffness, mass, len(members) + SPARE)
        found = (columns @ vectors).T
        flat = (
            modes.shapes[members]
            / np.sqrt(modes.effective_mass[members] / film.domain.copies)[:, None]
        )
        overlap = flat @ (film.mass @ found[:, 2 * size :].T)
        rows, chosen = linear_sum_assignment(-(overlap**2))
        for row, column in zip(rows, chosen, strict=True):
            # Of those that share a frequency, the mixtures that are nearest to the flat modes.
            same = np.flatnonzero(np.abs(values - values[column]) < DEGENERATE * values[column])
            alike = rows[np.isin(chosen, same)]
            left, _, right = np.linalg.svd(overlap[np.ix_(alike, same)], full_matrices=False)
            motion = (left @ right)[np.flatnonzero(alike == row)[0]] @ found[same]
            square[members[row]] = values[column]
            motions[members[row]] = motion / abs(largest_value(film.space, motion[2 * size :]))
    return square, motions


def _responses(
    film: Film, tangent: csc_matrix, bow: Parity, loads: Array, square: Array
) -> tuple[Array, Array, Array]:
    """Return f·x for loads f of second order, x the film's response to f, in three cases.

    Returns: the film in its plane alone; the whole film at rest; and at twice each mode's
    frequency.
    """
    size = film.space.size
    columns = film.admissible(bow, bow)
    stiffness = csc_matrix(columns.T @ (tangent + film.linear(bow)) @ columns)
    n_plane = int(np.count_nonzero(np.diff(columns[: 2 * size].indptr)))
    plane = factorize(csc_matrix(stiffness[:n_plane, :n_plane]))
    pull = columns.T @ loads
    solve = factorize(stiffness)
    mass = csc_matrix(columns.T @ film.inertia @ columns)
    flat = np.einsum("in,in->n", pull[:n_plane], plane(pull[:n_plane]))
    still = np.einsum("in,in->n", pull, solve(pull))
    moved = [
        load @ respond(stiffness, mass, solve, 4 * omega, load) if np.isfinite(omega) else np.nan
        for load, omega in zip(pull.T, square, strict=True)
    ]
    return flat, still, np.array(moved)
