"""The relaxed film stress against closed forms: rings, strips, cells of a lattice."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.core.device import Edge, Model
from femnl.core.domain import Prestress
from femnl.core.outline import Holes
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells, in_plane_strain, plane_stress, thickness, vector_dofs
from femnl.mechanics.fem.stress import relaxed_stress
from femnl.mechanics.prestress import solve_prestress

Array = NDArray[np.float64]
Device = Callable[..., Model]

CIRCLE = 'kind = "circle"\ndiameter = "2 m"'
SQUARE = 'kind = "square"\nside = "2 m"'
ORDER = 8


def solve(
    model: Model, symmetry: str = "auto", resolution: float = 1.0, edge: Edge = "clamped"
) -> Prestress:
    return solve_prestress(mesh(model, symmetry, resolution), 4, edge)


def everywhere(prestress: Prestress) -> tuple[Array, Array, Array]:
    """Points (n, 2), stress over the film stress (n, 3) and area (n,) at the quadrature points."""
    space = Space(prestress.domain.mesh, prestress.degree)
    stress = np.concatenate([s.reshape(-1, 3) for s in relaxed_stress(prestress, ORDER)])
    parts = [(cell.jet.point.reshape(-1, 2), cell.dx.ravel()) for cell in cells(space, ORDER)]
    point, area = (np.concatenate(column) for column in zip(*parts, strict=True))
    return point, stress / prestress.domain.model.film.stress, area


def polar(point: Array, stress: Array) -> tuple[Array, Array, Array]:
    """Radial, hoop and shear stress about the origin."""
    angle = np.arctan2(point[:, 1], point[:, 0])
    c = np.cos(angle)
    s = np.sin(angle)
    xx, yy, xy = stress.T
    return (
        c * c * xx + s * s * yy + 2 * c * s * xy,
        s * s * xx + c * c * yy - 2 * c * s * xy,
        c * s * (yy - xx) + (c * c - s * s) * xy,
    )


@pytest.mark.parametrize("symmetry", ["full", "quarter", "eighth"])
def test_a_ring_clamped_outside_and_free_inside_has_lames_stress(
    device: Device, symmetry: str
) -> None:
    inner = 0.2
    prestress = solve(replace(device(CIRCLE), holes=Holes(np.zeros((1, 2)), inner)), symmetry, 2)
    nu = prestress.domain.model.film.poisson
    # u = a r + b/r with u(1) = 0 and σᵣ(inner) = 0, in units of the film stress.
    b = 1 / (1 / (1 - nu) + 1 / (1 + nu) / inner**2)
    point, stress, _ = everywhere(prestress)
    radial, hoop, shear = polar(point, stress)
    r2 = np.sum(point**2, axis=1)
    np.testing.assert_allclose(radial, 1 - b / (1 - nu) - b / (1 + nu) / r2, atol=6e-4)
    np.testing.assert_allclose(hoop, 1 - b / (1 - nu) + b / (1 + nu) / r2, atol=6e-4)
    np.testing.assert_allclose(shear, 0, atol=6e-4)


def test_a_small_hole_doubles_the_hoop_stress_at_its_rim_and_carries_no_traction(
    device: Device,
) -> None:
    radius = 0.01
    prestress = solve(
        replace(device(SQUARE), holes=Holes(np.array([[0.3, 0.2]]), radius)), "full", 2
    )
    domain = prestress.domain
    space = Space(domain.mesh, 4)
    moduli = plane_stress(domain.model.film.young, domain.model.film.poisson)
    for facet in space.boundary_facets("free"):
        triangle = np.array([domain.mesh.f2t[0, facet]])
        edge = int(np.flatnonzero(domain.mesh.t2f[:, triangle[0]] == facet)[0])
        jet = space.jet(triangle, space.edge_points(edge, 4)[0])
        strain = np.einsum(
            "eqcj,ej->eqc",
            in_plane_strain(jet),
            prestress.displacement[vector_dofs(space, triangle)],
        )
        stress = np.array([1, 1, 0]) + strain[0] @ moduli / domain.model.film.stress
        radial, hoop, shear = polar(jet.point[0] - [0.3, 0.2], stress)
        np.testing.assert_allclose(radial, 0, atol=3e-3)
        np.testing.assert_allclose(shear, 0, atol=3e-3)
        # Kirsch; the clamped edge a hundred radii away takes 1e-4
        np.testing.assert_allclose(hoop, 2, rtol=3e-3)


def test_an_even_film_clamped_all_around_keeps_its_stress(device: Device) -> None:
    prestress = solve(device(SQUARE), "full", 0.5)
    _, stress, _ = everywhere(prestress)
    np.testing.assert_allclose(stress, np.broadcast_to([1, 1, 0], stress.shape), atol=1e-12)


def test_a_long_strip_with_free_sides_relaxes_to_one_axis(device: Device) -> None:
    points = '["-10 m", "-0.5 m"], ["10 m", "-0.5 m"], ["10 m", "0.5 m"], ["-10 m", "0.5 m"]'
    prestress = solve(device(f'kind = "polygon"\npoints = [{points}]\nfree = [1, 3]'))
    point, stress, _ = everywhere(prestress)
    middle = stress[np.abs(point[:, 0]) < 6]
    nu = prestress.domain.model.film.poisson
    # Held in length, free in width: σ₀(1 − ν) along it; the clamped ends add to its length what
    # they hold back in width.
    assert np.ptp(middle[:, 0]) < 1e-4
    np.testing.assert_allclose(middle[:, 1:], 0, atol=1e-4)
    assert middle[0, 0] == pytest.approx(1 - nu, rel=0.02)


@pytest.mark.parametrize("taper", [0.0, 0.4])
def test_the_tension_through_every_cross_section_is_the_same(device: Device, taper: float) -> None:
    # Sliding sides bear no shear, so that ∫ h σₓₓ dy does not depend on x: all its Fourier
    # coefficients but the mean vanish.
    model = replace(device(SQUARE), holes=Holes(np.array([[0.3, 0.2]]), 0.4))
    model = replace(
        model, film=replace(model.film, taper=taper * model.film.thickness, taper_length=0.3)
    )
    prestress = solve(model, "full", 2, "sliding")
    point, stress, area = everywhere(prestress)
    force = area * thickness(model, point) / model.film.thickness * stress[:, 0]
    for k in range(1, 6):
        for wave in (np.cos(k * np.pi * point[:, 0]), np.sin(k * np.pi * point[:, 0])):
            assert abs(force @ wave) < 3e-5 * force.sum()


@pytest.mark.parametrize("symmetry", ["half", "quarter", "eighth"])
def test_wedges_relax_as_the_whole_film(device: Device, symmetry: str) -> None:
    centres = 0.5 * np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    model = replace(device(SQUARE), holes=Holes(centres, 0.12))
    energies = []
    for word in ("full", symmetry):
        prestress = solve(model, word, 1)
        _, stress, area = everywhere(prestress)
        energies.append(prestress.domain.copies * area @ np.sum(stress[:, :2], axis=1))
    assert energies[1] == pytest.approx(energies[0], rel=3e-5)


def test_the_displacement_does_not_depend_on_the_unit_of_stiffness(device: Device) -> None:
    model = replace(device(SQUARE), holes=Holes(np.zeros((1, 2)), 0.3))
    harder = replace(
        model, film=replace(model.film, young=7 * model.film.young, stress=7 * model.film.stress)
    )
    np.testing.assert_allclose(
        solve(harder).displacement, solve(model).displacement, rtol=1e-9, atol=1e-9 * 1e-3
    )
