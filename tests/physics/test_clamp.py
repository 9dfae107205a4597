"""Edges that give way, against closed forms and other elements.

Springs out of plane, in rotation and in plane.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import eigsh, spsolve
from scipy.special import jn_zeros, jv, jvp
from skfem import Basis, BilinearForm, ElementTriP2, ElementVector, LinearForm, MeshTri
from skfem.helpers import ddot, sym_grad, trace

from femnl.core.device import Clamp
from femnl.core.errors import ParameterError
from femnl.core.outline import Holes
from femnl.device.mesh import mesh
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells
from femnl.mechanics.fem.stress import relaxed_stress
from femnl.mechanics.modes.dilution import bending_share
from femnl.mechanics.nonlinearity import solve_nonlinearity
from femnl.mechanics.prestress import solve_prestress
from tests.physics.elastic_films import (
    ORDERS,
    POISSON,
    SQUARE,
    STRESS,
    TENSION,
    THICKNESS,
    Array,
    Device,
    elastic,
    everywhere,
    first_root,
    plate_on_springs,
    solve,
    squares,
)


@pytest.mark.parametrize("stiffness", [1e6, 1e7, 1e9])
def test_a_drum_on_springs_solves_bessels_robin_problem(device: Device, stiffness: float) -> None:
    def exact(order: int) -> float:
        return (
            first_root(lambda k: float(TENSION * k * jvp(order, k) + stiffness * jv(order, k))) ** 2
        )

    found = squares(solve(elastic(device, clamp=Clamp(deflection=stiffness))))
    np.testing.assert_allclose(found, [exact(order) for order in ORDERS], rtol=1e-9)


@pytest.mark.parametrize("stiffness", [1e6, 1e8])
def test_a_square_film_on_springs_has_waves_along_x_and_y_apart(
    device: Device, stiffness: float
) -> None:
    ratio = stiffness / TENSION
    even = first_root(lambda k: k * np.sin(k) - ratio * np.cos(k))
    odd = first_root(lambda k: k * np.cos(k) + ratio * np.sin(k))
    found = squares(solve(elastic(device, SQUARE, clamp=Clamp(deflection=stiffness))))
    np.testing.assert_allclose(
        found, [2 * even**2, even**2 + odd**2, even**2 + odd**2, 2 * odd**2], rtol=1e-9
    )


def test_a_film_on_ever_softer_springs_ends_as_a_rigid_mass_on_them(device: Device) -> None:
    soft = np.array([1e4, 1e3])
    lowest = np.array(
        [squares(solve(elastic(device, clamp=Clamp(deflection=k)), 1))[0] for k in soft]
    )
    miss = 1 - lowest / (2 * soft / TENSION)  # of ω² = k·2πR/(ρhπR²)
    # W = 1 − (k/2T) r² to first order
    np.testing.assert_allclose(miss, soft / TENSION / 4, rtol=1e-3)


@pytest.mark.parametrize(
    ("clamp", "layer"),
    [
        (Clamp(rotation=0.0), 0.1),
        (Clamp(rotation=1e5), 0.1),
        (Clamp(rotation=1e7), 0.1),
        (Clamp(rotation=1e9), 0.03),
        (Clamp(deflection=1e7), 0.1),
        (Clamp(deflection=3e8, rotation=0.0), 0.1),
        (Clamp(deflection=1e9, rotation=2e4), 0.03),
    ],
)
def test_a_plate_in_tension_on_springs_has_its_exact_frequencies(
    device: Device, clamp: Clamp, layer: float
) -> None:
    exact = [plate_on_springs(order, layer, clamp) for order in ORDERS]
    np.testing.assert_allclose(
        squares(solve(elastic(device, layer=layer, clamp=clamp))), exact, rtol=1e-6
    )


def test_stiff_springs_end_as_the_clamp_and_miss_it_as_one_over_their_stiffness(
    device: Device,
) -> None:
    rigid = squares(solve(elastic(device, layer=0.1), 1))[0]
    for spring in ("deflection", "rotation"):
        miss = [
            1 - squares(solve(elastic(device, layer=0.1, clamp=Clamp(**{spring: k})), 1))[0] / rigid
            for k in (1e10, 1e11)
        ]
        assert miss[0] / miss[1] == pytest.approx(10, rel=0.02)
        assert 0 < miss[1] < 1e-3


def test_springs_hold_no_energy_of_bending(device: Device) -> None:
    clamp = Clamp(deflection=3e8, rotation=1e5)
    step = 1e-2
    shares = bending_share(solve(elastic(device, layer=0.1, clamp=clamp)))
    exact = []
    for order in ORDERS:
        values = [
            np.log(plate_on_springs(order, 0.1 * np.exp(k * step), clamp)) for k in (-2, -1, 1, 2)
        ]
        exact.append(np.dot([1, -8, 8, -1], values) / (12 * step) / 2)
    np.testing.assert_allclose(shares, exact, rtol=1e-6)


@pytest.mark.parametrize("symmetry", ["quarter", "half", "full"])
@pytest.mark.parametrize(("shear", "draw"), [(0.0, 0.0), (1e9, 2e-3), (np.inf, -1e-3)])
def test_a_disc_pulls_its_elastic_edge_in_by_an_even_strain(
    device: Device, symmetry: str, shear: float, draw: float
) -> None:
    stiffness = 2e9
    model = elastic(device, clamp=Clamp(normal=2e9, shear=shear, draw=draw))
    pull = (TENSION + stiffness * draw) / (stiffness + 1e11 * THICKNESS / (1 - POISSON))
    _, stress = everywhere(solve_prestress(mesh(model, symmetry, 0.3), 4))
    np.testing.assert_allclose(stress[:, 0], stiffness * (pull - draw) / THICKNESS, rtol=1e-7)
    np.testing.assert_allclose(stress[:, 1], 0, atol=1e-7 * STRESS)


def test_a_ring_with_an_elastic_edge_has_lames_stress(device: Device) -> None:
    inner = 0.3
    stiffness = 2e9
    model = replace(
        elastic(device, clamp=Clamp(normal=stiffness, shear=stiffness)),
        holes=Holes(np.zeros((1, 2)), inner),
    )
    # u = a r + b/r with σᵣ(inner) = 0 and h σᵣ(1) = −k u(1)
    wide = 1e11 / (1 - POISSON)
    deviating = 1e11 / (1 + POISSON)
    matrix = [
        [wide, -deviating / inner**2],
        [THICKNESS * wide + stiffness, -THICKNESS * deviating + stiffness],
    ]
    a, b = np.linalg.solve(matrix, [-STRESS, -TENSION])
    radius, stress = everywhere(solve_prestress(mesh(model, "auto", 2), 6))
    np.testing.assert_allclose(stress[:, 0], STRESS + wide * a, rtol=3e-6)
    np.testing.assert_allclose(stress[:, 1], abs(deviating * b) / radius**2, atol=2e-6 * STRESS)


def test_half_a_film_moves_in_its_plane_as_the_whole_one(device: Device) -> None:
    # One hole aside: the film moves along the mirror as a whole until its springs balance.
    model = replace(
        elastic(device, clamp=Clamp(normal=1e8, shear=5e7)),
        holes=Holes(np.array([[0.4, 0.0]]), 0.3),
    )
    means = []
    for symmetry in ("full", "half"):
        prestress = solve_prestress(mesh(model, symmetry, 2), 6)
        space = Space(prestress.domain.mesh, 6)
        stress = zip(cells(space, 8), relaxed_stress(prestress, 8), strict=True)
        means.append(
            prestress.domain.copies * sum(float(np.sum(s[..., 0] * c.dx)) for c, s in stress)
        )
    assert means[1] == pytest.approx(means[0], rel=1e-8)


@pytest.mark.parametrize("stiffness", [1e8, 1e10])
def test_the_duffing_coefficient_falls_by_what_the_edge_of_a_disc_gives_way(
    device: Device, stiffness: float
) -> None:
    # Clamped, the edge bears n = Eh∫|∇ξ|²/((1−ν)4πR²) (test stress: an even stretch); let go
    # against a spring it moves by u = n/(k + Eh/(1−ν)R) and 4·πR·n·u less is left of k₃.
    clamped, springy = (
        solve(elastic(device, clamp=c), 1, resolution=1)
        for c in (Clamp(), Clamp(normal=stiffness, shear=np.inf))
    )
    wave = jn_zeros(0, 1)[0]
    membrane = 1e11 * THICKNESS / (1 - POISSON)
    pull = membrane * wave**2 * jv(1, wave) ** 2 / 4
    lost = 4 * np.pi * pull**2 / (stiffness + membrane)
    whole, rest = (solve_nonlinearity(modes, "clamped").k3[0] for modes in (clamped, springy))
    assert whole - rest == pytest.approx(lost, rel=1e-7)


def test_shear_springs_lead_from_the_sliding_edge_to_the_clamped_one(device: Device) -> None:
    modes = solve(elastic(device, SQUARE), 2)
    ends = [solve_nonlinearity(modes, edge).k3 for edge in ("sliding", "clamped")]

    def away(end: int, stiffness: float) -> Array:
        sprung = replace(modes.domain.model, clamp=Clamp(shear=stiffness))
        relaxed = replace(modes.prestress, domain=replace(modes.domain, model=sprung))
        return np.asarray(
            solve_nonlinearity(replace(modes, prestress=relaxed), "clamped").k3 / ends[end] - 1
        )

    for end, pair in enumerate(((1e6, 1e5), (1e14, 1e15))):
        miss = [away(end, k) for k in pair]
        np.testing.assert_allclose(miss[0] / miss[1], 10, rtol=0.05)
        assert np.all(np.abs(miss[1]) < 1e-3)
    assert np.all((away(0, 1e9) > 0) & (away(1, 1e9) < 0))


def test_an_elastic_edge_is_no_sliding_one(device: Device) -> None:
    modes = solve(elastic(device, clamp=Clamp(normal=1e9)), 1)
    with pytest.raises(
        ParameterError, match=r'edge = "sliding": .*\[clamp\].*use edge = "clamped"'
    ):
        solve_nonlinearity(modes, "sliding")


def plain_ratio(stiffness: float, n: int) -> float:
    """Return f(2,2)/f(1,1) of the square film on normal and shear springs.

    By scikit-fem's own elements on a plain grid, graded to the edges.
    """
    line = np.sin(np.pi / 2 * np.linspace(-1, 1, 2 * n + 1))
    grid = MeshTri.init_tensor(line, line)
    plane = Basis(grid, ElementVector(ElementTriP2()))
    across = Basis(grid, ElementTriP2())
    rim = plane.boundary()
    shear = 1e11 / 2 / (1 + POISSON)
    wide = 1e11 * POISSON / (1 - POISSON**2)
    membrane = BilinearForm(
        lambda u, v, w: (
            wide * trace(sym_grad(u)) * trace(sym_grad(v))
            + 2 * shear * ddot(sym_grad(u), sym_grad(v))
        )
    )
    springs = BilinearForm(lambda u, v, w: stiffness * (u[0] * v[0] + u[1] * v[1]))
    pull = LinearForm(lambda v, w: -STRESS * trace(sym_grad(v)))
    matrix = THICKNESS * membrane.assemble(plane) + springs.assemble(rim)
    moved = plane.interpolate(spsolve(csc_matrix(matrix), THICKNESS * pull.assemble(plane)))
    one = np.eye(2)[:, :, None, None]
    tension = BilinearForm(
        lambda w, v, x: np.einsum(
            "ijeq,ieq,jeq->eq",
            (STRESS + wide * trace(sym_grad(x.u))) * one + 2 * shear * sym_grad(x.u),
            w.grad,
            v.grad,
        )
    ).assemble(across, u=moved)
    free = np.setdiff1d(np.arange(across.N), across.get_dofs().flatten())
    mass = BilinearForm(lambda w, v, x: w * v).assemble(across)
    values = eigsh(
        csc_matrix(tension[free][:, free]),
        4,
        csc_matrix(mass[free][:, free]),
        sigma=0,
        return_eigenvectors=False,
    )
    return float(np.sqrt(max(values) / min(values)))


def test_an_edge_that_moves_in_makes_tension_uneven_as_plain_elements_say(device: Device) -> None:
    # The corners hold the sides back, and f(2,2)/f(1,1) = 2 of the even film falls in first order
    # of the motion.
    clamp = Clamp(normal=1e10, shear=1e10)
    modes = solve(elastic(device, SQUARE, clamp=clamp), resolution=2)
    coarse = plain_ratio(1e10, 12)
    fine = plain_ratio(1e10, 24)
    limit = fine + (fine - coarse) / 15  # of frequencies that converge in fourth order
    assert modes.ratio[3] - 2 == pytest.approx(limit - 2, rel=3e-4)
    assert modes.ratio[3] - 2 < -1e-3
