"""Largest values of polynomials on one triangle, where they are known."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from skfem import MeshTri1, MeshTri2

from femnl.mechanics.fem.elements import Space
from femnl.mechanics.modes.shapes import largest_value

Array = NDArray[np.float64]


@pytest.mark.parametrize(
    ("shape", "largest"),
    [
        (lambda x, y: x * y, 0.25),  # vanishes along two edges, with its bend along them
        (lambda x, y: -27 * x * y * (1 - x - y), -1.0),  # along all three
        (lambda x, y: x * (1 - x) - 0.2 * y, 0.25),
        (lambda x, y: 1 - (x - 0.3) ** 2 - (y - 0.37) ** 2, 1.0),
        (lambda x, y: 0.5 * x - 1 + 0 * y, -1.0),  # along an edge
    ],
)
def test_the_largest_value_of_a_polynomial_is_found_with_its_sign(
    shape: Callable[[Array, Array], Array], largest: float
) -> None:
    mesh = MeshTri2.from_mesh(
        MeshTri1(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.array([[0], [1], [2]]))
    )
    space = Space(mesh, 3)
    assert largest_value(space, shape(*space.location.T)) == pytest.approx(largest, rel=1e-9)
