"""What edges and mirror lines hold, in deflection and in plane."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.core.device import Edge, Model
from femnl.core.domain import Domain
from femnl.core.errors import ParameterError
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.supports import free_deflections, in_plane_supports, slope_held_facets

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def quarter(device: Callable[..., Model]) -> Domain:
    return mesh(device('kind = "square"\nside = "2 m"'), "quarter", 0.5)


@pytest.fixture(scope="module")
def disc(device: Callable[..., Model]) -> Domain:
    return mesh(device('kind = "circle"\ndiameter = "2 m"'), "full", 0.5)


def held(
    space: Space, wedge: float, edge: Edge, even: tuple[bool, ...]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which unknowns of u_x and of u_y cannot move."""
    supports = in_plane_supports(space, wedge, edge, even)
    fixed = np.asarray(abs(supports).sum(axis=1)).ravel() < 1e-12
    return fixed[: space.size], fixed[space.size :]


@pytest.mark.parametrize("parity", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_deflection_is_held_on_the_edge_and_on_mirrors_about_which_it_is_odd(
    quarter: Domain, parity: tuple[int, int]
) -> None:
    space = Space(quarter.mesh, 4)
    x, y = space.location.T
    expected = (
        np.isclose(x, 1)
        | np.isclose(y, 1)
        | (parity[0] < 0) & np.isclose(y, 0)
        | (parity[1] < 0) & np.isclose(x, 0)
    )
    np.testing.assert_array_equal(np.flatnonzero(~expected), free_deflections(space, parity))


@pytest.mark.parametrize("parity", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_the_slope_is_held_on_the_edge_and_on_mirrors_about_which_the_deflection_is_even(
    quarter: Domain, parity: tuple[int, int]
) -> None:
    space = Space(quarter.mesh, 4)
    facets = slope_held_facets(space, parity)
    x, y = np.asarray(quarter.mesh.doflocs)[:, quarter.mesh.nvertices + facets]
    assert np.all(np.isclose(x, 1) | np.isclose(y, 1) | np.isclose(y, 0) | np.isclose(x, 0))
    assert np.isclose(y, 0).any() == (parity[0] > 0)
    assert np.isclose(x, 0).any() == (parity[1] > 0)


@pytest.mark.parametrize("even", [(True, True), (True, False), (False, True), (False, False)])
def test_a_load_even_about_a_mirror_moves_nothing_across_it_and_an_odd_one_nothing_along_it(
    quarter: Domain, even: tuple[bool, bool]
) -> None:
    space = Space(quarter.mesh, 3)
    x, y = space.location.T
    edge = np.isclose(x, 1) | np.isclose(y, 1)
    on_x = np.isclose(y, 0)
    on_y = np.isclose(x, 0)
    ux, uy = held(space, quarter.wedge, "clamped", even)
    np.testing.assert_array_equal(
        ux, edge | (on_y if even[1] else False) | (False if even[0] else on_x)
    )
    np.testing.assert_array_equal(
        uy, edge | (on_x if even[0] else False) | (False if even[1] else on_y)
    )


def test_a_sliding_edge_holds_only_the_motion_across_it_and_its_corners_fast(
    quarter: Domain,
) -> None:
    space = Space(quarter.mesh, 3)
    x, y = space.location.T
    ux, uy = held(space, quarter.wedge, "sliding", (True, True))
    np.testing.assert_array_equal(ux, np.isclose(x, 1) | np.isclose(x, 0))
    np.testing.assert_array_equal(uy, np.isclose(y, 1) | np.isclose(y, 0))


@pytest.mark.parametrize("wedge", ["eighth", "twelfth"])
def test_oblique_mirrors_hold_the_motion_across_them(
    device: Callable[..., Model], wedge: str
) -> None:
    outline = (
        'kind = "square"\nside = "2 m"'
        if wedge == "eighth"
        else 'kind = "regular-polygon"\nsides = 6\nlong_axis = "2 m"'
    )
    domain = mesh(device(outline), wedge, 0.5)
    space = Space(domain.mesh, 3)
    line = space.boundary_dofs("mirror-1")
    across = np.array([-np.sin(domain.wedge), np.cos(domain.wedge)])
    for even, direction in ((True, across), (False, np.array([across[1], -across[0]]))):
        supports = in_plane_supports(space, domain.wedge, "clamped", (True, even)).toarray()
        moved = np.stack([supports[line], supports[line + space.size]], -1) @ direction
        np.testing.assert_allclose(moved, 0, atol=1e-12)
        assert np.abs(supports[line]).sum() > 1


def test_a_sliding_round_edge_moves_along_its_tangent_only(disc: Domain) -> None:
    space = Space(disc.mesh, 3)
    rim = space.boundary_dofs("clamped")
    supports = in_plane_supports(space, disc.wedge, "sliding", ()).toarray()
    motion = np.stack([supports[rim], supports[rim + space.size]], -1)
    radius = np.linalg.norm(space.location[rim], axis=1)[:, None]
    outwards = space.location[rim] / radius
    along = space.location[rim][:, ::-1] * [-1, 1] / radius
    assert np.abs(np.einsum("ncx,nx->nc", motion, outwards)).max() < 1e-9
    moved = np.sort(np.abs(np.einsum("ncx,nx->nc", motion, along)).sum(axis=1))
    # One point is held, or else the disc could turn
    np.testing.assert_allclose(moved, [0.0] + [1.0] * (len(rim) - 1), atol=1e-9)


def test_a_disc_on_a_sliding_edge_cannot_turn_as_a_whole(disc: Domain) -> None:
    space = Space(disc.mesh, 3)
    supports = in_plane_supports(space, disc.wedge, "sliding", ())
    x, y = space.location.T
    turn = np.concatenate([-y, x])
    assert np.abs(turn - supports @ (supports.T @ turn)).max() > 0.5
    film = np.concatenate([x, y]) * np.tile(1 - x**2 - y**2, 2)
    np.testing.assert_allclose(supports @ (supports.T @ film), film, atol=1e-9)


def test_admissible_displacements_are_independent_and_of_unit_length(disc: Domain) -> None:
    supports = in_plane_supports(Space(disc.mesh, 2), disc.wedge, "sliding", ())
    np.testing.assert_allclose(
        (supports.T @ supports).toarray(), np.eye(supports.shape[1]), atol=1e-14
    )


def test_an_edge_that_does_not_exist_is_refused_by_name(disc: Domain) -> None:
    edge: Any = "sliding "
    with pytest.raises(ParameterError, match='edge = "sliding ": expected clamped, sliding, paper'):
        in_plane_supports(Space(disc.mesh, 2), disc.wedge, edge, ())


def test_free_edges_hold_nothing(device: Callable[..., Model]) -> None:
    outline = (
        'kind = "polygon"\npoints = [["0 m", "0 m"], ["2 m", "0 m"], ["2 m", "1 m"], ["0 '
        'm", "1 m"]]\nfree = '
        "[1, 2, 3]"
    )
    domain = mesh(replace(device(outline), bending=False), "full", 0.5)
    space = Space(domain.mesh, 3)
    x = space.location[:, 0]
    np.testing.assert_array_equal(free_deflections(space, ()), np.flatnonzero(~np.isclose(x, 0)))
    np.testing.assert_array_equal(held(space, domain.wedge, "clamped", ())[0], np.isclose(x, 0))
