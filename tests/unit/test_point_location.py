"""Where points lie in a mesh of straight and bent triangles."""

import numpy as np
import pytest

from femnl import load
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.reference import reference_basis
from femnl.mechanics.modes.points import Finder

INSIDE = np.array(
    [(0.02, 0.02), (0.96, 0.02), (0.02, 0.96), (1 / 3, 1 / 3), (0.5, 0.49), (0.01, 0.5)]
)


@pytest.mark.parametrize(
    "name", ["square-270um", "hexagon-278um", "circle", "square-270um-perforated"]
)
def test_points_are_found_in_the_triangles_that_they_were_put_in(name: str) -> None:
    domain = mesh(load(name))
    space = Space(domain.mesh, 2)
    points = reference_basis(space.map_degree, INSIDE) @ space.map_nodes
    count = len(points)
    triangle, reference = Finder(domain).locate(points.reshape(-1, 2))
    assert np.array_equal(triangle, np.repeat(np.arange(count), len(INSIDE)))
    assert np.allclose(reference, np.tile(INSIDE, (count, 1)), atol=1e-9)


def test_points_beside_the_film_are_in_no_triangle() -> None:
    domain = mesh(load("circle"))
    turns = np.linspace(0, domain.wedge, 200)
    radius = float(np.hypot(*domain.mesh.p).max())
    rim = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    within, beyond = (Finder(domain).locate(factor * rim)[0] for factor in (1 - 1e-6, 1 + 1e-6))
    assert np.all(within >= 0)
    assert np.all(beyond == -1)
    assert np.all(Finder(domain).locate(1e3 * rim)[0] == -1)
    assert len(Finder(domain).locate(np.empty((0, 2)))[0]) == 0


@pytest.mark.parametrize("name", ["hexagon-278um", "trampoline", "square-270um-perforated"])
def test_a_raster_of_cells_changes_nothing_of_what_is_found(name: str) -> None:
    domain = mesh(load(name))
    finder = Finder(domain)
    low = domain.mesh.p.min(axis=1)
    points = low + np.random.default_rng(20261125).uniform(-0.2, 1.2, (4000, 2)) * np.ptp(
        domain.mesh.p, axis=1
    )
    triangle, reference = finder.locate(points)
    none = np.full(len(points), -1)
    slowly, there = finder._locate(points, none, np.ones(len(points), dtype=bool))
    assert np.array_equal(triangle, slowly)
    assert np.array_equal(reference, there)
    assert 0 < np.count_nonzero(triangle >= 0) < len(points)
