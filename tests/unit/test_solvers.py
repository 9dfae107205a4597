"""Direct and eigenvalue solvers.

The same answers with and without CHOLMOD, and failures that name the cause.
"""

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.linalg import eigh
from scipy.sparse import csc_matrix, diags_array, kronsum

from femnl.core.errors import ConvergenceError
from femnl.mechanics.fem import solvers

SIZE = 60


def chain(size: int = SIZE) -> csc_matrix:
    """A string of masses: eigenvalues 4 sin²(kπ/2(n+1))."""
    return csc_matrix(diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(size, size)))


def diagonal(entries: ArrayLike) -> csc_matrix:
    values = np.asarray(entries, float)
    return csc_matrix((values, (np.arange(len(values)), np.arange(len(values)))))


@pytest.fixture(params=["cholmod", "superlu"])
def solver(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run a test with either direct solver."""
    if request.param == "cholmod" and not solvers.HAS_CHOLMOD:
        pytest.skip("the optional extra `fast` is not installed")
    monkeypatch.setattr(solvers, "HAS_CHOLMOD", request.param == "cholmod")
    return str(request.param)


@pytest.mark.parametrize("shape", [(SIZE,), (SIZE, 1), (SIZE, 3)])
def test_one_factorisation_solves_for_any_number_of_right_hand_sides(
    solver: str, shape: tuple[int, ...]
) -> None:
    right = np.random.default_rng(1).standard_normal(shape)
    solution = solvers.factorize(chain())(right)
    assert solution.shape == shape
    np.testing.assert_allclose(chain() @ solution, right, atol=1e-12)


@pytest.mark.parametrize(
    "entries", [[1.0, 0.0, 2.0], [1.0, -1.0, 2.0]], ids=["singular", "indefinite"]
)
def test_a_film_without_support_is_refused_with_the_reason(
    solver: str, entries: list[float]
) -> None:
    with pytest.raises(ConvergenceError, match="unsupported or under compression"):
        solvers.factorize(diagonal(entries))


def test_lowest_eigenpairs_of_a_string_of_masses_match_the_closed_form(solver: str) -> None:
    values, vectors = solvers.lowest_eigenpairs(chain(), diagonal(np.ones(SIZE)), 5)
    exact = 4 * np.sin(np.arange(1, 6) * np.pi / 2 / (SIZE + 1)) ** 2
    np.testing.assert_allclose(values, exact, rtol=1e-12)
    np.testing.assert_allclose(chain().toarray() @ vectors, vectors * values, atol=1e-11)


def test_eigenvectors_are_orthonormal_in_the_mass_and_degenerate_pairs_are_found_whole() -> None:
    rng = np.random.default_rng(2)
    weights = rng.uniform(1, 2, SIZE**2)
    mass, root = (diagonal(w) for w in (weights, np.sqrt(weights)))
    plane = kronsum(chain(), chain())
    # The square's degenerate spectrum, with an uneven mass
    weighted = csc_matrix(root @ plane @ root)
    values, vectors = solvers.lowest_eigenpairs(weighted, mass, 8)
    single = 4 * np.sin(np.arange(1, 9) * np.pi / 2 / (SIZE + 1)) ** 2
    np.testing.assert_allclose(
        values, np.sort(np.add.outer(single, single).ravel())[:8], rtol=1e-11
    )
    np.testing.assert_allclose(vectors.T @ (mass @ vectors), np.eye(8), atol=1e-11)


def test_reruns_give_identical_bits() -> None:
    first, second = (
        solvers.lowest_eigenpairs(chain(), diagonal(np.ones(SIZE)), 4) for _ in range(2)
    )
    np.testing.assert_array_equal(first[1], second[1])


def test_more_modes_than_the_mesh_holds_are_refused_with_the_remedy() -> None:
    with pytest.raises(
        ConvergenceError,
        match="59 modes were asked of a mesh with 60 unknowns: ask for fewer modes or raise",
    ):
        solvers.lowest_eigenpairs(chain(), diagonal(np.ones(SIZE)), SIZE - 1)


def test_an_uneven_mass_moves_eigenvalues_as_a_dense_solver_says(solver: str) -> None:
    weights = np.linspace(1, 3, SIZE)
    values, _ = solvers.lowest_eigenpairs(chain(), diagonal(weights), 6)
    np.testing.assert_allclose(
        values, eigh(chain().toarray(), np.diag(weights), eigvals_only=True)[:6], rtol=1e-11
    )
