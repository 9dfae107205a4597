"""The in-plane response of a deflected film.

a closed form, and the energy that it takes off the stretching.
"""

from collections.abc import Callable

import numpy as np
import pytest

from femnl.core.device import Edge, Model
from femnl.core.modes import Modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.nonlinearity import in_plane_response, solve_nonlinearity
from femnl.mechanics.nonlinearity.stretching import film_membrane, stretching
from femnl.pipeline import solve_modes

SIDE = 100e-6
NU = 0.23


@pytest.fixture(scope="module")
def modes(device: Callable[..., Model]) -> Modes:
    """The fundamental mode cos(πx/L) cos(πy/L) of an ideal square membrane."""
    return solve_modes(device(f'kind = "square"\nside = "{SIDE * 1e6} um"'), 1, cache=False)


def test_a_square_that_slides_along_its_edges_gives_way_as_the_closed_form_says(
    modes: Modes,
) -> None:
    # u_x = (π/16L) (cos 2πy/L − 1 + ν) sin 2πx/L from a corner of the square: Chu & Herrmann, J.
    # Appl. Mech. 23, 532 (1956).
    space = Space(modes.domain.mesh, modes.degree)
    a, b = (2 * np.pi * (space.location + SIDE / 2) / SIDE).T
    exact = (
        np.pi
        / (16 * SIDE)
        * np.concatenate([(np.cos(b) - 1 + NU) * np.sin(a), (np.cos(a) - 1 + NU) * np.sin(b)])
    )
    found = in_plane_response(modes, 0, "sliding")
    np.testing.assert_allclose(found, exact, atol=2e-5 * np.abs(exact).max())


@pytest.mark.parametrize("edge", ["clamped", "sliding", "paper"])
def test_what_it_relaxes_is_what_the_cubic_coefficient_lacks(modes: Modes, edge: Edge) -> None:
    film = stretching(modes, [(0, 0)], film_membrane(modes, edge))
    u = in_plane_response(modes, 0, edge)
    strain = modes.domain.copies * (film.energies[0, 0] - u @ film.stiffness @ u)
    assert 2 * strain == pytest.approx(solve_nonlinearity(modes, edge).k3[0], rel=1e-9)
