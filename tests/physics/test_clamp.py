"""Edges that give way, against closed forms: springs out of plane, in rotation and in plane, and an undercut strip of the frame."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import iv, ivp, jn_zeros, jv, jvp, kv, kvp, yv, yvp

from femnl.errors import ParameterError
from femnl.fem.elements import Space
from femnl.fem.forms import cells
from femnl.fem.stress import relaxed_stress
from femnl.mesh import mesh
from femnl.modes import solve_modes
from femnl.modes.dilution import bending_share
from femnl.nonlinearity import solve_nonlinearity
from femnl.predict import solve_modes as solve_device
from femnl.prestress import solve_prestress
from femnl.types.device import Clamp, Film, Holes, Model, Overhang
from femnl.types.mechanics import Modes, Prestress

Array = NDArray[np.float64]
Device = Callable[..., Model]

CIRCLE = 'kind = "circle"\ndiameter = "2 m"'
SQUARE = 'kind = "square"\nside = "2 m"'
POISSON, DENSITY, STRESS, THICKNESS = 0.3, 1000.0, 1e9, 0.01
TENSION = STRESS * THICKNESS
BESSEL = {"J": (jv, jvp, -1), "Y": (yv, yvp, -1), "I": (iv, ivp, 1), "K": (kv, kvp, 1)}  # with the sign of Δf/k²f
ORDERS = (0, 1, 1, 2)


def young(layer: float) -> float:
    """E of a film with √(D/T) = `layer` [m]."""
    return 12 * (1 - POISSON**2) * STRESS * (layer / THICKNESS) ** 2


def elastic(device: Device, outline: str = CIRCLE, layer: float | None = None, clamp: Clamp | None = None) -> Model:
    """A film with E = 100 GPa without bending, or with the bending length `layer`."""
    modulus = young(layer) if layer else 1e11
    film = f'thickness = "1 cm"\nyoung = "{modulus:.15g} Pa"\npoisson = {POISSON}\ndensity = "1000 kg/m^3"\nstress = "1 GPa"'
    return replace(device(outline, film=film, model=f"bending = {'true' if layer else 'false'}"), clamp=clamp or Clamp())


def solve(model: Model, count: int = 4, symmetry: str = "auto", resolution: float = 0.5, degree: int = 6) -> Modes:
    return solve_modes(solve_prestress(mesh(model, symmetry, resolution), degree), count, degree)


def squares(modes: Modes) -> Array:
    """(ω/c)² [1/m²]."""
    return np.asarray((2 * np.pi * modes.frequency) ** 2 * DENSITY / STRESS)


def first_root(miss: Callable[[float], float], step: float = 0.02) -> float:
    """The first change of sign above zero."""
    here = 1e-3
    while miss(here) * miss(here + step) > 0:
        here += step
    return float(brentq(miss, here, here + step, xtol=1e-15, rtol=1e-14))


def traces(kind: str, order: int, wave: float, radius: float, film: tuple[float, float]) -> Array:
    """w, w', M/D and V/D at a radius of w = f(kr) cos nθ in a film of (ℓ, ν): V is the force per length that an edge must bear.

    M = D [w'' + ν (w'/r − n²w/r²)]; V = T w' − D [∂ᵣΔw − (1−ν) n²/r² (w' − w/r)], with T = D/ℓ².
    """
    layer, poisson = film
    value, slope, sign = BESSEL[kind]
    f, f1, f2 = value(order, wave * radius), wave * slope(order, wave * radius), wave**2 * slope(order, wave * radius, 2)
    moment = f2 + poisson * (f1 / radius - order**2 * f / radius**2)
    force = f1 / layer**2 - sign * wave**2 * f1 + (1 - poisson) * order**2 / radius**2 * (f1 - f / radius)
    return np.array([f, f1, moment, force])


def waves(square: float, layer: float) -> tuple[float, float]:
    """Wave numbers k of the J (or Y) and of the I (or K) in w where (ω/c)² = k²(1 + ℓ²k²)."""
    first = (np.sqrt(1 + 4 * layer**2 * square) - 1) / (2 * layer**2)
    return float(np.sqrt(first)), float(np.sqrt(first + layer**-2))


def plate_on_springs(order: int, layer: float, clamp: Clamp) -> float:
    """(ω/c)² of the lowest mode of the disc of radius 1 with `order` nodal diameters: V = −k w and M = −k_θ w' at its edge."""
    rigidity = TENSION * layer**2

    def miss(root: float) -> float:
        rows = []
        for kind, wave in zip("JI", waves(root**2, layer), strict=True):
            w, slope, moment, force = traces(kind, order, wave, 1.0, (layer, POISSON))
            held = w if np.isinf(clamp.deflection) else rigidity * force + clamp.deflection * w
            turned = slope if np.isinf(clamp.rotation) else rigidity * moment + clamp.rotation * slope
            rows.append([held / clamp.deflection if np.isfinite(clamp.deflection) else held, turned])
        return float(np.linalg.det(rows))

    return first_root(miss) ** 2


@pytest.mark.parametrize("stiffness", [1e6, 1e7, 1e9])
def test_a_drum_on_springs_solves_bessels_robin_problem(device: Device, stiffness: float) -> None:
    def exact(order: int) -> float:
        return first_root(lambda k: float(TENSION * k * jvp(order, k) + stiffness * jv(order, k))) ** 2

    found = squares(solve(elastic(device, clamp=Clamp(deflection=stiffness))))
    np.testing.assert_allclose(found, [exact(order) for order in ORDERS], rtol=1e-9)


@pytest.mark.parametrize("stiffness", [1e6, 1e8])
def test_a_square_film_on_springs_has_waves_along_x_and_y_apart(device: Device, stiffness: float) -> None:
    ratio = stiffness / TENSION
    even = first_root(lambda k: k * np.sin(k) - ratio * np.cos(k))
    odd = first_root(lambda k: k * np.cos(k) + ratio * np.sin(k))
    found = squares(solve(elastic(device, SQUARE, clamp=Clamp(deflection=stiffness))))
    np.testing.assert_allclose(found, [2 * even**2, even**2 + odd**2, even**2 + odd**2, 2 * odd**2], rtol=1e-9)


def test_a_film_on_ever_softer_springs_ends_as_a_rigid_mass_on_them(device: Device) -> None:
    soft = np.array([1e4, 1e3])
    lowest = np.array([squares(solve(elastic(device, clamp=Clamp(deflection=k)), 1))[0] for k in soft])
    miss = 1 - lowest / (2 * soft / TENSION)  # of ω² = k·2πR/(ρhπR²)
    np.testing.assert_allclose(miss, soft / TENSION / 4, rtol=1e-3)  # w = 1 − (k/2T) r² to first order


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
def test_a_plate_in_tension_on_springs_has_its_exact_frequencies(device: Device, clamp: Clamp, layer: float) -> None:
    exact = [plate_on_springs(order, layer, clamp) for order in ORDERS]
    np.testing.assert_allclose(squares(solve(elastic(device, layer=layer, clamp=clamp))), exact, rtol=1e-6)


def test_stiff_springs_end_as_the_clamp_and_miss_it_as_one_over_their_stiffness(device: Device) -> None:
    rigid = squares(solve(elastic(device, layer=0.1), 1))[0]
    for spring in ("deflection", "rotation"):
        miss = [1 - squares(solve(elastic(device, layer=0.1, clamp=Clamp(**{spring: k})), 1))[0] / rigid for k in (1e10, 1e11)]
        assert miss[0] / miss[1] == pytest.approx(10, rel=0.02)
        assert 0 < miss[1] < 1e-3


def test_springs_hold_no_energy_of_bending(device: Device) -> None:
    clamp, step = Clamp(deflection=3e8, rotation=1e5), 1e-2
    shares = bending_share(solve(elastic(device, layer=0.1, clamp=clamp)))
    exact = []
    for order in ORDERS:
        values = [np.log(plate_on_springs(order, 0.1 * np.exp(k * step), clamp)) for k in (-2, -1, 1, 2)]
        exact.append(np.dot([1, -8, 8, -1], values) / (12 * step) / 2)
    np.testing.assert_allclose(shares, exact, rtol=1e-6)


def everywhere(prestress: Prestress) -> tuple[Array, Array]:
    """Distance (n,) from the origin and mean (xx + yy)/2 and deviator of the stress (n, 2) [Pa] at the points of quadrature."""
    space = Space(prestress.domain.mesh, prestress.degree)
    point = np.concatenate([cell.jet.point.reshape(-1, 2) for cell in cells(space, 8)])
    xx, yy, xy = np.concatenate([s.reshape(-1, 3) for s in relaxed_stress(prestress, 8)]).T
    return np.hypot(*point.T), np.stack([(xx + yy) / 2, np.hypot((xx - yy) / 2, xy)], 1)


@pytest.mark.parametrize("symmetry", ["quarter", "half", "full"])
@pytest.mark.parametrize(("shear", "draw"), [(0.0, 0.0), (1e9, 2e-3), (np.inf, -1e-3)])
def test_a_disc_pulls_its_elastic_edge_in_by_an_even_strain(device: Device, symmetry: str, shear: float, draw: float) -> None:
    stiffness, model = 2e9, elastic(device, clamp=Clamp(normal=2e9, shear=shear, draw=draw))
    pull = (TENSION + stiffness * draw) / (stiffness + 1e11 * THICKNESS / (1 - POISSON))
    _, stress = everywhere(solve_prestress(mesh(model, symmetry, 0.3), 4))
    np.testing.assert_allclose(stress[:, 0], stiffness * (pull - draw) / THICKNESS, rtol=1e-7)
    np.testing.assert_allclose(stress[:, 1], 0, atol=1e-7 * STRESS)


def test_a_ring_with_an_elastic_edge_has_lames_stress(device: Device) -> None:
    inner, stiffness = 0.3, 2e9
    model = replace(elastic(device, clamp=Clamp(normal=stiffness, shear=stiffness)), holes=Holes(np.zeros((1, 2)), inner))
    # u = a r + b/r with σᵣ(inner) = 0 and h σᵣ(1) = −k u(1)
    wide, deviating = 1e11 / (1 - POISSON), 1e11 / (1 + POISSON)
    matrix = [[wide, -deviating / inner**2], [THICKNESS * wide + stiffness, -THICKNESS * deviating + stiffness]]
    a, b = np.linalg.solve(matrix, [-STRESS, -TENSION])
    radius, stress = everywhere(solve_prestress(mesh(model, "auto", 2), 6))
    np.testing.assert_allclose(stress[:, 0], STRESS + wide * a, rtol=3e-6)
    np.testing.assert_allclose(stress[:, 1], abs(deviating * b) / radius**2, atol=2e-6 * STRESS)


def test_half_a_film_moves_in_its_plane_as_the_whole_one(device: Device) -> None:
    # One hole aside: the film moves along the mirror as a whole until its springs balance.
    model = replace(elastic(device, clamp=Clamp(normal=1e8, shear=5e7)), holes=Holes(np.array([[0.4, 0.0]]), 0.3))
    means = []
    for symmetry in ("full", "half"):
        prestress = solve_prestress(mesh(model, symmetry, 2), 6)
        space = Space(prestress.domain.mesh, 6)
        stress = zip(cells(space, 8), relaxed_stress(prestress, 8), strict=True)
        means.append(prestress.domain.copies * sum(float(np.sum(s[..., 0] * c.dx)) for c, s in stress))
    assert means[1] == pytest.approx(means[0], rel=1e-8)


@pytest.mark.parametrize("stiffness", [1e8, 1e10])
def test_the_duffing_coefficient_falls_by_what_the_edge_of_a_disc_gives_way(device: Device, stiffness: float) -> None:
    # Clamped, the edge bears n = Eh∫|∇ξ|²/((1−ν)4πR²) (test stress: an even stretch); let go against a spring it moves by
    # u = n/(k + Eh/(1−ν)R) and 4·πR·n·u less is left of k₃.
    clamped, springy = (solve(elastic(device, clamp=c), 1, resolution=1) for c in (Clamp(), Clamp(normal=stiffness, shear=np.inf)))
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
        return np.asarray(solve_nonlinearity(replace(modes, prestress=relaxed), "clamped").k3 / ends[end] - 1)

    for end, pair in enumerate(((1e6, 1e5), (1e14, 1e15))):
        miss = [away(end, k) for k in pair]
        np.testing.assert_allclose(miss[0] / miss[1], 10, rtol=0.05)
        assert np.all(np.abs(miss[1]) < 1e-3)
    assert np.all((away(0, 1e9) > 0) & (away(1, 1e9) < 0))


def test_an_elastic_edge_is_no_sliding_one(device: Device) -> None:
    modes = solve(elastic(device, clamp=Clamp(normal=1e9)), 1)
    with pytest.raises(ParameterError, match=r'edge = "sliding": .*\[clamp\].*use edge = "clamped"'):
        solve_nonlinearity(modes, "sliding")


def undercut(model: Model, width: float, other: Film | None = None) -> Model:
    """The device with a strip of its own film, or of another, around its circle or square."""
    outer = model.outline
    grown = tuple(
        replace(s, start=tuple(np.multiply(s.start, 1 + width)), end=tuple(np.multiply(s.end, 1 + width))) for s in outer.segments
    )
    return replace(model, overhang=Overhang(width, replace(outer, segments=grown), other or model.film))


@pytest.mark.parametrize(("outline", "exact"), [(CIRCLE, [jn_zeros(n, 1)[0] for n in ORDERS]), (SQUARE, np.pi * np.sqrt([2, 5, 5, 8]) / 2)])
@pytest.mark.parametrize("symmetry", ["auto", "half"])
def test_an_overhang_of_the_film_is_more_film(device: Device, outline: str, exact: Array, symmetry: str) -> None:
    modes = solve(undercut(elastic(device, outline), 0.25), symmetry=symmetry, resolution=1)
    np.testing.assert_allclose(squares(modes), (np.array(exact) / 1.25) ** 2, rtol=1e-9)


def test_film_and_overhang_of_different_stress_share_lames_displacement(device: Device) -> None:
    inner = elastic(device)
    other = replace(inner.film, thickness=0.03, stress=2e9, young=4e10, poisson=0.1)
    model = undercut(inner, 0.5, other)
    # Inside u = a r, in the overhang u = c (r − R²/r) with R = 1.5, which does not move at its rim.
    wide, deviating = other.young / (1 - other.poisson), other.young / (1 + other.poisson)
    matrix = [[1, -(1 - 2.25)], [THICKNESS * 1e11 / (1 - POISSON), -other.thickness * (wide + 2.25 * deviating)]]
    a, c = np.linalg.solve(matrix, [0, other.thickness * other.stress - TENSION])
    radius, stress = everywhere(solve_prestress(mesh(model, "auto", 2), 6))
    inside = radius < 1
    np.testing.assert_allclose(stress[inside, 0], STRESS + 1e11 / (1 - POISSON) * a, rtol=1e-6)
    np.testing.assert_allclose(stress[~inside, 0], other.stress + wide * c, rtol=1e-6)
    np.testing.assert_allclose(stress[~inside, 1], abs(deviating * c) * 2.25 / radius[~inside] ** 2, rtol=1e-6)


def two_plates(order: int, layers: tuple[float, float], density: float, rim: float, poisson: float, rigidity: float) -> float:
    """(ω/c)² of a disc of radius 1 within a clamped ring: one tension, two masses (1 and `density`), rigidities (1 and `rigidity`)."""
    inner, outer = (layers[0], POISSON), (layers[1], poisson)

    def miss(root: float) -> float:
        columns = []
        for kind, wave in zip("JI", waves(root**2, layers[0]), strict=True):
            columns.append(np.concatenate([traces(kind, order, wave, 1.0, inner), [0, 0]]))
        first, second = waves(root**2 * density, layers[1])
        for kind, wave in (("J", first), ("Y", first), ("I", second), ("K", second)):
            here = traces(kind, order, wave, 1.0, outer) * [1, 1, rigidity, rigidity]
            columns.append(np.concatenate([-here, traces(kind, order, wave, rim, outer)[:2]]))
        matrix = np.array(columns)
        return float(np.linalg.det(matrix / np.abs(matrix).max(axis=1, keepdims=True)))

    return first_root(miss) ** 2


def test_a_plate_and_its_thicker_overhang_vibrate_as_two_joined_plates(device: Device) -> None:
    layer = 0.05
    inner = elastic(device, layer=layer)
    # Four times as thick at a quarter of the stress, so that the tension is the same.
    model = undercut(inner, 0.2, replace(inner.film, thickness=4 * THICKNESS, stress=STRESS / 4, density=DENSITY / 2, poisson=0.1))
    rigidity = 64 * (1 - POISSON**2) / (1 - 0.1**2)
    exact = [two_plates(order, (layer, layer * np.sqrt(rigidity)), 2.0, 1.2, 0.1, rigidity) for order in ORDERS]
    np.testing.assert_allclose(squares(solve(model, resolution=1)), exact, rtol=1e-6)


def test_the_overhang_is_a_film_of_its_own(device: Device) -> None:
    model = undercut(elastic(device), 0.5)
    domain = mesh(model, "quarter", 1)
    strip = np.isin(np.arange(domain.mesh.nelements), (domain.mesh.subdomains or {})["overhang"])
    areas = np.concatenate([cell.dx.sum(axis=1) for cell in cells(Space(domain.mesh, 4), 4)])
    assert 4 * areas[strip].sum() == pytest.approx(np.pi * (1.5**2 - 1), rel=1e-6)
    assert 4 * areas[~strip].sum() == pytest.approx(np.pi, rel=1e-6)


@pytest.mark.parametrize("resolution", [0.6, 1.0])
def test_error_bars_hold_where_edges_give_way_and_overhang(device: Device, resolution: float) -> None:
    clamp, layer, rigidity = Clamp(deflection=3e8, rotation=1e5), 0.05, 64 * (1 - POISSON**2) / (1 - 0.1**2)
    inner = elastic(device, layer=layer)
    thick = undercut(inner, 0.2, replace(inner.film, thickness=4 * THICKNESS, stress=STRESS / 4, density=DENSITY / 2, poisson=0.1))
    cases = [
        (elastic(device, layer=0.1, clamp=clamp), [plate_on_springs(order, 0.1, clamp) for order in ORDERS]),
        (thick, [two_plates(order, (layer, layer * np.sqrt(rigidity)), 2.0, 1.2, 0.1, rigidity) for order in ORDERS]),
    ]
    for model, exact in cases:
        modes = solve_device(model, 4, resolution=resolution, cache=False)
        found, known = np.sqrt(squares(modes)), np.sqrt(exact)
        assert np.all(np.abs(found / known - 1) <= modes.frequency_error / modes.frequency)
        assert np.all(np.abs(modes.ratio * known[0] / known - 1) <= (modes.ratio_error / modes.ratio) + 1e-15)
        assert np.all(modes.frequency_error < 1e-3 * modes.frequency)
