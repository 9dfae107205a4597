"""The one place that picks the sparse direct solver and the eigenvalue solver."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, tril
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, splu

from femnl.core.errors import ConvergenceError

HAS_CHOLMOD = find_spec("cvxopt") is not None  # the optional extra `fast`

Array = NDArray[np.float64]
Solve = Callable[[Array], Array]
PRECISE = 1e-10
ROUGH = 1e-2
"""Relative tolerances of eigenvalues: of those that are returned, and of one that was missed."""
FACTOR_BYTES = 5000
"""Memory of an indefinite factor for each unknown: 4 500 at 333 000 unknowns of fourth degree."""
SAME = 1e-6
"""Relative difference up to which an eigenvalue is a copy of the farthest, of which some may be
left out.
"""


def factorize(stiffness: csc_matrix) -> Solve:
    """Factorise a symmetric positive definite matrix once.

    The returned function solves K x = b for b (n,) or (n, m).

    CHOLMOD is used where cvxopt (the optional extra `fast`) is installed, otherwise SuperLU in its
    symmetric mode.
    Raises: ConvergenceError where the matrix is not positive definite.
    """
    logging.getLogger("femnl.progress").info("solving for %s unknowns", f"{stiffness.shape[0]:,}")
    if HAS_CHOLMOD:
        return _factorize_cholmod(stiffness)
    try:
        factor = splu(
            csc_matrix(stiffness),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:  # exactly singular
        raise ConvergenceError(INDEFINITE) from error
    if np.any(factor.U.diagonal() <= 0):
        raise ConvergenceError(INDEFINITE)
    return lambda right: np.asarray(factor.solve(np.asarray(right)))


INDEFINITE = (
    "the stiffness is not positive definite: part of the film is unsupported or under compression; "
    "femnl geometry check draws where; check the outline's free edges and the film stress, or "
    "raise the resolution"
)


def _factorize_cholmod(stiffness: csc_matrix) -> Solve:
    cvxopt = import_module("cvxopt")
    cholmod = import_module("cvxopt.cholmod")
    stored = _lower_triangle(stiffness)
    cholmod.options["supernodal"] = 2
    factor = cholmod.symbolic(stored)
    try:
        cholmod.numeric(stored, factor)
    except ArithmeticError as error:
        raise ConvergenceError(INDEFINITE) from error

    def solve(right: Array) -> Array:
        work = cvxopt.matrix(np.asarray(right, dtype=float))
        cholmod.solve(factor, work)
        return np.array(work).reshape(np.shape(right), order="C")

    return solve


def _lower_triangle(matrix: csc_matrix) -> Any:
    """Return the lower triangle of a symmetric matrix as one of cvxopt."""
    cvxopt = import_module("cvxopt")
    lower = tril(matrix, format="coo")
    at = [cvxopt.matrix(index.astype(np.int64)) for index in (lower.row, lower.col)]
    return cvxopt.spmatrix(cvxopt.matrix(lower.data), *at, size=lower.shape)


def lowest_eigenpairs(stiffness: csc_matrix, mass: csc_matrix, count: int) -> tuple[Array, Array]:
    """Return the `count` lowest solutions of K x = λ M x.

    λ (count,) rising, and x (n, count) with xᵀMx = 1.

    Shift–invert Lanczos at zero, so K must be positive definite. Raises: ConvergenceError naming
    the setting.
    """
    n = stiffness.shape[0]
    if count >= n - 1:
        raise ConvergenceError(
            f"{count} modes were asked of a mesh with {n} unknowns: ask for fewer modes or raise "
            "the resolution"
        )
    return _nearest(Pencil(stiffness, mass, 0.0, factorize(stiffness)), count)


def nearest_eigenpairs(
    stiffness: csc_matrix, mass: csc_matrix, count: int, target: float
) -> tuple[Array, Array, int]:
    """Return the `count` solutions of K x = λ M x nearest to a target, without those in between.

    λ (count,) rising, x (n, count) with xᵀMx = 1, and how many λ lie below the target: as many as
    K − target·M = LDLᵀ has negative pivots (Sylvester's law of inertia).

    Shift–invert Lanczos at the target. K may be indefinite: whether it is has to be told from the
    lowest eigenvalues.
    Raises: ConvergenceError naming the setting, such as a target on an eigenvalue.
    """
    n = stiffness.shape[0]
    if count >= n - 1:
        raise ConvergenceError(
            f"{count} modes were asked of a mesh with {n} unknowns: ask for fewer modes or raise "
            "the resolution"
        )
    shifted = csc_matrix(stiffness - target * mass)
    solve, below = _factorize_indefinite(shifted)
    values, vectors = _nearest(Pencil(stiffness, mass, target, solve), count)
    return values, vectors, below


@dataclass(frozen=True)
class Pencil:
    """K x = λ M x about a shift σ; `solve` is (K − σM)⁻¹."""

    stiffness: csc_matrix
    mass: csc_matrix
    shift: float
    solve: Solve


def _nearest(pencil: Pencil, count: int) -> tuple[Array, Array]:
    """Return the `count` solutions nearest to the shift: λ rising, and x (n, count), xᵀMx = 1.

    Lanczos finds the copies of a multiple eigenvalue by rounding alone, and may end without one.
    What is left beside all that was found is therefore searched as well, until nothing in it is
    nearer than the farthest of them.
    """
    values, vectors = _lanczos(pencil, count, PRECISE, np.empty((pencil.mass.shape[0], 0)))
    while True:
        farthest = np.abs(values - pencil.shift).max() * (1 - SAME)
        # Not with fewer vectors than ARPACK's twenty: with twelve a copy was missed among 100 modes
        if abs(_lanczos(pencil, 1, ROUGH, vectors)[0][0] - pencil.shift) >= farthest:
            break
        more, missed = _lanczos(pencil, 1, PRECISE, vectors)
        values = np.concatenate([values, more])
        vectors = np.hstack([vectors, missed])
        kept = np.argsort(np.abs(values - pencil.shift), kind="stable")[:count]
        values = values[kept]
        vectors = vectors[:, kept]
    order = np.argsort(values)
    return values[order], vectors[:, order]


def _lanczos(pencil: Pencil, count: int, tolerance: float, known: Array) -> tuple[Array, Array]:
    """Return the solutions nearest to the shift that are M-orthogonal to those known (n, m)."""
    weighted = pencil.mass @ known

    def inverse(right: Array) -> Array:
        found = pencil.solve(right - weighted @ (known.T @ right))
        return np.asarray(found - known @ (weighted.T @ found))

    n = pencil.mass.shape[0]
    # A fixed start makes reruns identical. It holds only one combination of two vectors that share
    # an eigenvalue, so that each number of known vectors has a start of its own.
    start = np.random.default_rng(known.shape[1]).standard_normal(n)
    start -= known @ (weighted.T @ start)
    try:
        values, vectors = eigsh(
            pencil.stiffness,
            k=count,
            M=pencil.mass,
            sigma=pencil.shift,
            OPinv=LinearOperator((n, n), matvec=inverse, dtype=float),
            tol=tolerance,
            v0=start,
        )
    except ArpackNoConvergence as error:
        raise ConvergenceError(
            f"the eigenvalue iteration found {len(error.eigenvalues)} of {count} modes: ask for "
            "fewer modes"
        ) from error
    return np.asarray(values), np.asarray(vectors)


RESIDUAL = 1e-6
"""Of the right side, what a solution without pivoting may miss: growth of the pivots beyond that
would also spoil their signs."""


def _factorize_indefinite(matrix: csc_matrix) -> tuple[Solve, int]:
    """Factorise a symmetric indefinite matrix once; also return how many eigenvalues are negative.

    SuperLU in its symmetric mode keeps the pivots on the diagonal, so that U = DLᵀ and the signs of
    its diagonal are those of the eigenvalues.
    """
    logging.getLogger("femnl.progress").info("solving for %s unknowns", f"{matrix.shape[0]:,}")
    order = np.arange(matrix.shape[0])
    ordered = matrix
    if HAS_CHOLMOD:
        order = _minimum_degree(matrix)
        ordered = csc_matrix(matrix[order][:, order])
    try:
        factor = splu(
            ordered,
            permc_spec="NATURAL" if HAS_CHOLMOD else "MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:  # exactly singular
        raise ConvergenceError(ON_A_MODE) from error

    def solve(right: Array) -> Array:
        found = np.empty_like(right)
        found[order] = factor.solve(right[order])
        return found

    probe = np.random.default_rng(1).standard_normal(matrix.shape[0])
    missed = np.linalg.norm(matrix @ solve(probe) - probe) / np.linalg.norm(probe)
    if missed > RESIDUAL or not np.array_equal(factor.perm_r, factor.perm_c):
        raise ConvergenceError(ON_A_MODE)
    return solve, int(np.sum(factor.U.diagonal() < 0))


def _minimum_degree(matrix: csc_matrix) -> NDArray[np.int64]:
    """Return the order (n,) of elimination by approximate minimum degree.

    The multiple minimum degree of SuperLU leaves as much fill, and may take long to be found: 7 of
    7.3 s for 81 000 unknowns of second degree between holes, where this one takes 0.06 s.
    """
    amd = import_module("cvxopt.amd")
    return np.array(amd.order(_lower_triangle(matrix), uplo="L"), dtype=np.int64).ravel()


ON_A_MODE = (
    "the target lies on the frequency of a mode, too close to tell which modes are below it; move "
    "the target by 1e-6 of itself"
)
