"""Geometric cubic coefficients: rates, symmetry of the tensor, scaling.

Values are held in validation/.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest
from numpy.typing import NDArray
from skfem import MeshTri1, MeshTri2

from femnl.core.device import Edge, Model
from femnl.core.domain import Domain
from femnl.core.modes import Modes
from femnl.core.outline import Holes
from femnl.device.mesh import mesh
from femnl.mechanics.modes import align, shape_at, solve_modes
from femnl.mechanics.nonlinearity import solve_nonlinearity
from femnl.mechanics.prestress import solve_prestress

Array = NDArray[np.float64]
Device = Callable[..., Model]

SQUARE = 'kind = "square"\nside = "1 m"'


def solve(
    model: Model, count: int, symmetry: str = "auto", resolution: float = 1.0, degree: int = 4
) -> Modes:
    return solve_modes(solve_prestress(mesh(model, symmetry, resolution), degree), count, degree)


@pytest.fixture(scope="module")
def uneven(device: Device) -> Model:
    """A perforated film with bending and a stress far from even."""
    centres = 0.25 * np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    model = replace(device(SQUARE), bending=True, holes=Holes(centres, 0.06))
    return replace(model, film=replace(model.film, thickness=5e-3))


@pytest.mark.parametrize("degree", [2, 3])
def test_the_cubic_coefficients_error_falls_as_h_to_twice_the_degree(
    device: Device, degree: int
) -> None:
    model = device(SQUARE)
    errors = []
    film = model.film
    # With sliding edges u is a sum of cosines; at clamped corners it is not smooth, and the rate
    # ends at theirs.
    bracket = (3 - film.poisson**2) / 8 + film.poisson / 4
    exact = (
        film.young
        / film.thickness
        / (1 - film.poisson**2)
        / film.density**2
        * 4
        * np.pi**4
        * bracket
    )
    for level in (2, 3, 4):
        linear = MeshTri1.init_sqsymmetric().refined(level)
        grid = MeshTri2.from_mesh(MeshTri1(np.asarray(linear.p) - 0.5, linear.t))
        domain = Domain(
            model,
            grid.with_boundaries({"clamped": lambda x: np.full(x.shape[1:], True)}),
            2 * np.pi,
        )
        modes = solve_modes(solve_prestress(domain, degree), 1, degree)
        # k₃/m² does not depend on the value of max|ξ|, whose error has a rate of its own.
        errors.append(
            abs(
                solve_nonlinearity(modes, "sliding").k3[0] / modes.effective_mass[0] ** 2 / exact
                - 1
            )
        )
    assert [np.log2(a / b) for a, b in pairwise(errors)] == pytest.approx([2 * degree] * 2, abs=0.4)


@pytest.mark.parametrize("edge", ["clamped", "sliding", "paper"])
@pytest.mark.parametrize("symmetry", ["full", "quarter"])
def test_the_tensor_is_fully_symmetric_and_its_diagonal_is_k3(
    uneven: Model, edge: Edge, symmetry: str
) -> None:
    modes = solve(uneven, 4, symmetry, 0.5)
    found = solve_nonlinearity(modes, edge, tensor=True)
    assert found.tensor is not None
    scale = np.abs(found.tensor).max()
    for order in permutations(range(4)):
        np.testing.assert_allclose(found.tensor.transpose(order), found.tensor, atol=1e-9 * scale)
    np.testing.assert_allclose(np.einsum("iiii->i", found.tensor), found.k3, rtol=1e-11)
    np.testing.assert_allclose(solve_nonlinearity(modes, edge).k3, found.k3, rtol=1e-11)
    assert solve_nonlinearity(modes, edge).tensor is None


@pytest.mark.parametrize("edge", ["clamped", "sliding"])
def test_the_tensor_gives_k3_of_every_mixture_of_modes(uneven: Model, edge: Edge) -> None:
    # Energy ¼ Σ tensor_ijkl q_i q_j q_k q_l: along q = s·c it is that of one shape Σ c ξ with its
    # own k₃.
    modes = solve(uneven, 4, "full", 0.5)
    tensor = solve_nonlinearity(modes, edge, tensor=True).tensor
    assert tensor is not None
    for c in np.random.default_rng(1).standard_normal((3, 4)):
        mixed = replace(modes, shapes=np.vstack([c @ modes.shapes, modes.shapes[1:]]))
        k3 = solve_nonlinearity(mixed, edge).k3[0]
        assert np.einsum("ijkl,i,j,k,l", tensor, c, c, c, c) == pytest.approx(k3, rel=1e-9)


def test_wedge_and_whole_film_have_the_same_tensor(device: Device) -> None:
    model = device(SQUARE)
    tensors = []
    points = (np.array([0.13, -0.21, 0.3]), np.array([0.17, 0.11, -0.07]))
    signs = []
    for symmetry in ("full", "quarter"):
        modes = solve(model, 4, symmetry)
        tensors.append(solve_nonlinearity(modes, "clamped", tensor=True).tensor)
        signs.append(np.array([np.sign(shape_at(modes, k, *points)[0]) for k in range(4)]))
    flip = signs[0] * signs[1]
    assert tensors[0] is not None
    assert tensors[1] is not None
    turned = np.einsum("ijkl,i,j,k,l->ijkl", tensors[0], flip, flip, flip, flip)
    np.testing.assert_allclose(turned, tensors[1], atol=2e-5 * np.abs(turned).max())
    assert np.abs(turned[0, 0, 1, 1]) > 0.1 * turned[0, 0, 0, 0]  # modes couple
    assert np.abs(turned[0, 0, 0, 1]) < 1e-5 * turned[0, 0, 0, 0]  # but not of different symmetry


def test_k3_grows_with_stiffness_and_thickness_and_knows_no_density(device: Device) -> None:
    model = device(SQUARE)
    film = model.film
    base = solve_nonlinearity(solve(model, 2, resolution=0.5), "clamped")
    changed = replace(
        film,
        young=3 * film.young,
        thickness=2 * film.thickness,
        density=5 * film.density,
        stress=7 * film.stress,
    )
    other = solve_nonlinearity(solve(replace(model, film=changed), 2, resolution=0.5), "clamped")
    np.testing.assert_allclose(other.k3, 6 * base.k3, rtol=1e-9)
    np.testing.assert_allclose(other.alpha, 3 / 7 * base.alpha, rtol=1e-9)


def test_the_softer_the_edge_the_softer_the_mode(uneven: Model) -> None:
    modes = solve(uneven, 3, resolution=0.5)
    clamped, sliding = (solve_nonlinearity(modes, edge).k3 for edge in ("clamped", "sliding"))
    assert np.all(sliding < clamped)


def test_coarse_counterparts_bound_the_error_of_alpha(device: Device) -> None:
    model = device(SQUARE)
    fine = solve(model, 4)
    modes = replace(fine, coarse=align(solve(model, 8, degree=3), fine))
    found = solve_nonlinearity(modes, "paper")
    exact = 3 * np.pi**2 / 16 * model.film.young / model.film.stress * np.array([1, 3.4, 3.4, 4])
    assert np.all(np.abs(found.alpha - exact) < found.alpha_error)
    assert np.all(found.alpha_error < 1e-3 * exact)
    assert np.all(np.isinf(solve_nonlinearity(fine, "paper").alpha_error))
