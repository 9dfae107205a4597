"""Lagrange elements on straight and curved triangles.

Exact where they must be, continuous across edges.
"""

from collections.abc import Callable
from math import comb

import numpy as np
import pytest
from numpy.typing import NDArray
from skfem import MeshTri1, MeshTri2

from femnl.core.device import Model
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import DEGREES, Space
from femnl.mechanics.fem.reference import nodes, reference_basis

Array = NDArray[np.float64]
POINTS = np.array([[0.2, 0.3], [0.05, 0.9], [0.61, 0.22]])
FIRST = ((1, 0), (0, 1))
SECOND = ((2, 0), (0, 2), (1, 1))


def stretched() -> MeshTri2:
    """Straight triangles of all shapes and orientations."""
    linear = MeshTri1.init_circle(1)
    moved = np.array([[1.3, 0.4], [-0.2, 0.7]]) @ np.asarray(linear.p)
    grid: MeshTri2 = MeshTri2.from_mesh(MeshTri1(moved, linear.t))
    return grid


@pytest.fixture(scope="module")
def curved(device: Callable[..., Model]) -> MeshTri2:
    """A perforated disc in a few curved triangles."""
    return mesh(
        device(
            'kind = "circle"\ndiameter = "2 m"',
            'lattice = "list"\ncentres = [["0.1 m", "0.2 m"]]\nradius = "0.3 m"',
        ),
        "full",
        0.4,
    ).mesh


def polynomial(degree: int, order: tuple[int, int], x: Array, y: Array) -> Array:
    """∂ₓᵃ∂ᵧᵇ of Σ c x^i y^j with fixed c, i + j ≤ degree."""
    total = np.add.outer(np.arange(degree + 1), np.arange(degree + 1))
    c = np.where(total > degree, 0, np.random.default_rng(1).standard_normal(total.shape))
    for axis in (0, 1):
        c = np.asarray(np.polynomial.polynomial.polyder(c, order[axis], axis=axis))
    return np.asarray(np.polynomial.polynomial.polyval2d(x, y, c))


@pytest.mark.parametrize("degree", DEGREES)
def test_basis_functions_are_one_at_their_own_node_and_zero_at_the_others(degree: int) -> None:
    np.testing.assert_allclose(
        reference_basis(degree, nodes(degree)), np.eye(len(nodes(degree))), atol=1e-13
    )


@pytest.mark.parametrize("degree", DEGREES)
def test_basis_functions_sum_to_one_and_their_derivatives_to_zero(degree: int) -> None:
    np.testing.assert_allclose(reference_basis(degree, POINTS).sum(axis=1), 1, atol=1e-13)
    for order in FIRST + SECOND:
        np.testing.assert_allclose(
            reference_basis(degree, POINTS, order).sum(axis=1), 0, atol=1e-11
        )


@pytest.mark.parametrize("degree", DEGREES)
def test_polynomials_are_exact_on_straight_triangles_up_to_second_derivatives(degree: int) -> None:
    space = Space(stretched(), degree)
    field = polynomial(degree, (0, 0), *space.location.T)[space.dofs]
    jet = space.jet(slice(None), POINTS, second=True)
    x = jet.point[..., 0]
    y = jet.point[..., 1]
    np.testing.assert_allclose(
        np.einsum("eqj,ej->eq", jet.value, field),
        polynomial(degree, (0, 0), x, y),
        rtol=1e-11,
        atol=1e-11,
    )
    for row, order in enumerate(FIRST):
        np.testing.assert_allclose(
            np.einsum("eqj,ej->eq", jet.gradient[:, :, row], field),
            polynomial(degree, order, x, y),
            atol=1e-10,
        )
    for row, order in enumerate(SECOND):
        np.testing.assert_allclose(
            np.einsum("eqj,ej->eq", jet.hessian[:, :, row], field),
            polynomial(degree, order, x, y),
            atol=1e-9,
        )


@pytest.mark.parametrize("degree", [2, 3, 4, 5, 6])
def test_curved_triangles_hold_a_tilt_to_its_second_derivatives(
    curved: MeshTri2, degree: int
) -> None:
    # The map is of the element's degree, so of all polynomials in x and y only the linear ones are
    # in the space of a curved triangle.
    space = Space(curved, degree)
    field = polynomial(1, (0, 0), *space.location.T)[space.dofs]
    jet = space.jet(slice(None), POINTS, second=True)
    x = jet.point[..., 0]
    y = jet.point[..., 1]
    for row, order in enumerate(FIRST):
        np.testing.assert_allclose(
            np.einsum("eqj,ej->eq", jet.gradient[:, :, row], field),
            polynomial(1, order, x, y),
            atol=1e-10,
        )
    for row in range(len(SECOND)):
        np.testing.assert_allclose(
            np.einsum("eqj,ej->eq", jet.hessian[:, :, row], field), 0, atol=1e-8
        )


@pytest.mark.parametrize("degree", [3, 4])
def test_derivatives_on_curved_triangles_match_finite_differences_of_the_mapped_function(
    curved: MeshTri2, degree: int
) -> None:
    space = Space(curved, degree)
    bent = np.flatnonzero(np.any(np.isin(curved.t2f, curved.boundary_facets()), axis=0))
    field = np.random.default_rng(2).standard_normal(space.size)[space.dofs[bent]]

    def value(place: Array) -> Array:
        return np.asarray(np.einsum("eqj,ej->eq", space.jet(bent, place).value, field))

    def gradient(place: Array) -> Array:
        return np.asarray(np.einsum("eqxj,ej->eqx", space.jet(bent, place).gradient, field))

    def difference(quantity: Callable[[Array], Array]) -> Array:
        """Return fourth-order central differences along both axes, in the last axis."""
        columns = []
        step = 1e-3
        for shift in step * np.eye(2):
            f = {k: quantity(POINTS + k * shift) for k in (-2, -1, 1, 2)}
            columns.append((8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * step))
        return np.stack(columns, axis=-1)

    jet = space.jet(bent, POINTS, second=True)
    to_place = np.linalg.inv(jet.jacobian)
    slope = (difference(value)[..., None, :] @ to_place)[..., 0, :]
    np.testing.assert_allclose(gradient(POINTS), slope, atol=1e-9 * np.abs(slope).max())
    hessian = difference(gradient) @ to_place
    computed = np.einsum("eqcj,ej->eqc", jet.hessian, field)
    expected = np.stack([hessian[..., 0, 0], hessian[..., 1, 1], hessian[..., 0, 1]], -1)
    np.testing.assert_allclose(computed, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("degree", DEGREES)
@pytest.mark.parametrize("shape", ["straight", "curved"])
def test_functions_agree_on_both_sides_of_every_edge(
    degree: int, shape: str, request: pytest.FixtureRequest
) -> None:
    grid = stretched() if shape == "straight" else request.getfixturevalue("curved")
    space = Space(grid, degree)
    field = np.random.default_rng(3).standard_normal(space.size)
    for facet in np.flatnonzero(grid.f2t[1] >= 0):
        sides = []
        for triangle in grid.f2t[:, facet]:
            edge = int(np.flatnonzero(grid.t2f[:, triangle] == facet)[0])
            jet = space.jet(np.array([triangle]), space.edge_points(edge, 7)[0])
            sides.append((jet.point[0], jet.value[0] @ field[space.dofs[triangle]]))
        # Both walk the edge the same way
        np.testing.assert_allclose(sides[0][0], sides[1][0], atol=1e-12)
        np.testing.assert_allclose(sides[0][1], sides[1][1], atol=1e-12)


@pytest.mark.parametrize("degree", [2, 3, 4, 6])
def test_unknowns_of_a_facet_lie_on_it_in_order(curved: MeshTri2, degree: int) -> None:
    space = Space(curved, degree)
    s = np.array([0.0, 1.0, *np.linspace(0, 1, degree + 1)[1:-1]])[:, None]
    for facet in map(int, np.flatnonzero(curved.f2t[1] >= 0)):
        ends = np.asarray(curved.doflocs)[:, curved.facets[:, facet]].T
        np.testing.assert_allclose(
            space.location[space.facet_unknowns(facet)], ends[0] * (1 - s) + ends[1] * s, atol=1e-12
        )


@pytest.mark.parametrize("degree", [2, 3, 4, 6])
def test_unknowns_of_a_round_edge_lie_on_its_circle_at_even_angles(
    curved: MeshTri2, degree: int
) -> None:
    space = Space(curved, degree)
    even = min(degree, 4)
    for name, centre, radius in (("clamped", (0.0, 0.0), 1.0), ("free", (0.1, 0.2), 0.3)):
        for facet in space.boundary_facets(name):
            place = space.location[space.facet_unknowns(int(facet))] - centre
            assert np.hypot(*place.T) == pytest.approx(radius, rel=1e-9 if degree == even else 1e-4)
            start, end, *between = np.unwrap(np.arctan2(place[:, 1], place[:, 0]))
            np.testing.assert_allclose(
                between,
                np.linspace(start, end, degree + 1)[1:-1],
                atol=1e-9 if degree == even else 1e-4,
            )


@pytest.mark.parametrize(("degree", "order"), [(2, 4), (4, 6)])
def test_the_area_beside_arcs_converges_with_the_degree_of_the_map(degree: int, order: int) -> None:
    errors = []
    for segments in (6, 12):
        angle = 2 * np.pi / segments * np.arange(2 * segments) / 2
        linear = MeshTri1(
            np.hstack([np.zeros((2, 1)), np.stack([np.cos(angle[::2]), np.sin(angle[::2])])]),
            np.array([[0, k + 1, (k + 1) % segments + 1] for k in range(segments)]).T,
        )
        grid = MeshTri2.from_mesh(MeshTri1(linear.p, np.sort(linear.t, axis=0)))
        place = np.array(grid.doflocs)
        rim = np.flatnonzero(grid.f2t[1] < 0) + grid.nvertices
        place[:, rim] /= np.hypot(*place[:, rim])
        space = Space(MeshTri2(place, grid.t), degree)
        points, weights = space.quadrature(12)
        errors.append(
            abs(
                np.sum(np.abs(np.linalg.det(space.jet(slice(None), points).jacobian)) @ weights)
                / np.pi
                - 1
            )
        )
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.3)


@pytest.mark.parametrize(("coarse", "fine"), [(1, 4), (2, 3), (3, 4)])
def test_a_function_carried_to_a_higher_degree_is_the_same_function(
    curved: MeshTri2, coarse: int, fine: int
) -> None:
    low = Space(curved, coarse)
    high = Space(curved, fine)
    field = np.random.default_rng(4).standard_normal((2, low.size))
    carried = low.prolong(field, high)
    before = np.einsum("eqj,nej->neq", low.jet(slice(None), POINTS).value, field[:, low.dofs])
    after = np.einsum("eqj,nej->neq", high.jet(slice(None), POINTS).value, carried[:, high.dofs])
    np.testing.assert_allclose(after, before, atol=1e-12)


@pytest.mark.parametrize("order", [2, 5, 8, 12, 20])
def test_quadrature_is_exact_to_its_order(order: int) -> None:
    (points, weights) = Space(stretched(), 1).quadrature(order)
    space = Space(stretched(), 1)
    for a in range(order + 1):
        for b in range(order + 1 - a):
            # ∫ XᵃYᵇ = a! b! / (a + b + 2)!
            exact = 1 / ((a + b + 2) * (a + b + 1) * comb(a + b, a))
            assert weights @ (points[:, 0] ** a * points[:, 1] ** b) == pytest.approx(
                exact, rel=1e-12
            )
    along, lengths = space.edge_points(0, order)
    assert lengths @ along[:, 0] ** order == pytest.approx(1 / (order + 1), rel=1e-12)
