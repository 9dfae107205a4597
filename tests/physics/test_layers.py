"""Layers on a film: closed forms of laminates, loaded drums and stressed inclusions."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv, jvp, yv, yvp

from femnl.core.device import Model
from femnl.core.errors import GeometryError, ParameterError
from femnl.device.geometry import curves, load_shipped, parse
from femnl.device.layout import export_layout, import_layout, read_layers
from femnl.device.mesh import mesh
from femnl.io.results.netcdf import read_modes, write_modes
from femnl.mechanics.fem.elements import Space
from femnl.mechanics.fem.forms import cells
from femnl.mechanics.fem.offset import tension_offset
from femnl.mechanics.fem.stress import relaxed_tension
from femnl.mechanics.prestress import solve_prestress
from femnl.mechanics.static_deflection import solve_static_deflection
from femnl.observe.film import SimulatedFilm
from femnl.pipeline import solve_modes, solve_nonlinearity
from tests.physics.layered_text import FILM

RADIUS = 50e-6
INNER = 20e-6
DISC = '[outline]\nkind = "circle"\ndiameter = "100 um"\n'
SQUARE = '[outline]\nkind = "square"\nside = "100 um"\n'
PAD = 'shape = {kind = "circle", diameter = "40 um"}\n'


def device(outline: str, *layers: str, stress: str = "1 GPa", bending: bool = False) -> Model:
    tables = "".join(f"[[layers]]\n{layer}\n" for layer in layers)
    model = f"[model]\nbending = {str(bending).lower()}\n"
    return parse(f'name = "layered"\n{outline}{FILM.format(stress=stress)}{tables}{model}')


def layer(
    thickness: str = "50 nm",
    young: str = "70 GPa",
    poisson: float = 0.23,
    density: str = "2700 kg/m^3",
    stress: str = "100 MPa",
    more: str = "",
) -> str:
    return (
        f'name = "metal"\nthickness = "{thickness}"\nyoung = "{young}"\npoisson = {poisson}\n'
        f'density = "{density}"\nstress = "{stress}"\n{more}'
    )


def loaded_drum(order: int, inner_mass: float, outer_mass: float, tension: float) -> float:
    """Return f₁ of a membrane under one tension whose disc r < INNER has another mass by area.

    Jₘ(k₁a) and its slope continue as AJₘ(k₂r) + BYₘ(k₂r), which vanishes at the edge.
    """

    def mismatch(omega: float) -> float:
        first = omega * np.sqrt(inner_mass / tension)
        second = omega * np.sqrt(outer_mass / tension)
        edge = second * RADIUS
        rim = second * INNER

        def value(x: float) -> float:
            return float(jv(order, x) * yv(order, edge) - yv(order, x) * jv(order, edge))

        slope = jvp(order, rim) * yv(order, edge) - yvp(order, rim) * jv(order, edge)
        inside = jv(order, first * INNER)
        inside_slope = jvp(order, first * INNER)
        return float(inside * second * slope - first * inside_slope * value(rim))

    highest = 8 * np.sqrt(tension / outer_mass) / RADIUS
    grid = np.linspace(1e-3, 1, 4000) * highest
    values = np.array([mismatch(omega) for omega in grid])
    first_sign = int(np.flatnonzero(np.diff(np.sign(values)))[0])
    return float(brentq(mismatch, grid[first_sign], grid[first_sign + 1])) / (2 * np.pi)


@pytest.mark.parametrize("density", ["2700 kg/m^3", "19300 kg/m^3"])
def test_a_loaded_drum_has_the_frequencies_of_bessels_equation(density: str) -> None:
    """A soft disc without stress adds mass alone: the tension stays even."""
    disc = layer(density=density, stress="0 MPa", young="1 Pa", more=PAD)
    modes = solve_modes(device(DISC, disc), 3, cache=False)
    film = 3000 * 100e-9
    metal = float(density.split()[0]) * 50e-9
    exact = np.array([loaded_drum(m, film + metal, film, 100.0) for m in (0, 1, 1)])
    off = np.abs(modes.frequency - exact)
    assert np.all(off < 1e-6 * exact)
    assert np.all(off <= modes.frequency_error)
    assert modes.frequency[1] == pytest.approx(modes.frequency[2], rel=1e-9)


def test_tension_settles_as_lame_says() -> None:
    """A disc of other tension and stiffness in a clamped ring: u = Ar inside, Br + C/r outside."""
    model = device(DISC, layer(stress="-300 MPa", more=PAD))
    domain = mesh(model)
    prestress = solve_prestress(domain, 4)
    nu = 0.23
    outer = 250e9 * 100e-9 / (1 - nu**2)
    inner = outer + 70e9 * 50e-9 / (1 - nu**2)
    before = np.array([1e9 * 100e-9 - 0.3e9 * 50e-9, 1e9 * 100e-9])
    a = INNER
    # Unknowns A, B, C: held at the edge, u and the radial tension continue at the rim
    matrix = np.array(
        [
            [0, RADIUS, 1 / RADIUS],
            [a, -a, -1 / a],
            [inner * (1 + nu), -outer * (1 + nu), outer * (1 - nu) / a**2],
        ]
    )
    first, second, third = np.linalg.solve(matrix, [0, 0, before[1] - before[0]])
    for cell, tension in zip(
        cells(Space(domain.mesh, 4), 8), relaxed_tension(prestress, 8), strict=True
    ):
        r = np.hypot(*np.moveaxis(cell.jet.point, -1, 0))
        inside = np.broadcast_to((r.mean(axis=1) < a)[:, None], r.shape)
        pressure = np.where(
            inside,
            before[0] + inner * (1 + nu) * first,
            before[1] + outer * (1 + nu) * second,
        )
        shear = np.where(inside, 0.0, outer * (1 - nu) * third / r**2)
        x, y = np.moveaxis(cell.jet.point, -1, 0) / r
        exact = np.stack(
            [
                pressure - shear * (x**2 - y**2),
                pressure + shear * (x**2 - y**2),
                -2 * shear * x * y,
            ],
            -1,
        )
        assert np.abs(tension - exact).max() < 2e-4 * before[1]


def test_an_evenly_covered_film_is_the_equivalent_film() -> None:
    """f, m_eff and α of an even laminate are those of one film of its tension, mass and A."""
    covered = solve_modes(device(SQUARE, layer()), 4, cache=False)
    h = 150e-9
    young = (250e9 * 100e-9 + 70e9 * 50e-9) / h
    density = (3000 * 100e-9 + 2700 * 50e-9) / h
    stress = (1e9 * 100e-9 + 0.1e9 * 50e-9) / h
    text = (
        f'name = "equivalent"\n{SQUARE}[film]\nthickness = "{h!r} m"\nyoung = "{young!r} Pa"\n'
        f'poisson = 0.23\ndensity = "{density!r} kg/m^3"\nstress = "{stress!r} Pa"\n'
        "[model]\nbending = false\n"
    )
    alone = solve_modes(parse(text), 4, cache=False)
    assert covered.frequency == pytest.approx(alone.frequency, rel=1e-9)
    assert covered.effective_mass == pytest.approx(alone.effective_mass, rel=1e-9)
    k3 = solve_nonlinearity(covered, cache=False).k3
    assert k3 == pytest.approx(solve_nonlinearity(alone, cache=False).k3, rel=1e-8)
    exact = np.sqrt(2) / 2 * np.sqrt(stress / density) / 100e-6
    assert covered.frequency[0] == pytest.approx(exact, rel=1e-8)
    bent, other = (solve_static_deflection(modes, pressure=1e5) for modes in (covered, alone))
    assert bent.frequency[0] > 1.01 * covered.frequency[0]
    assert bent.depth == pytest.approx(other.depth, rel=1e-8)
    assert bent.frequency == pytest.approx(other.frequency, rel=1e-8)
    assert bent.k2 == pytest.approx(other.k2, rel=1e-7, abs=1e-7 * np.abs(other.k2).max())


def test_a_laminated_plate_bends_about_its_neutral_plane() -> None:
    """A clamped circular bilayer: ω = λ² √(D*/m)/R², λ = 3.19622 of Leissa, NASA SP-160 (1969).

    Tension of 1 kPa raises it by less than 1e-5. D* = E of both about their neutral plane.
    """
    metal = layer("80 nm", "70 GPa", stress="0 MPa")
    found = solve_modes(device(DISC, metal, stress="1 Pa", bending=True), 1, cache=False)
    young = np.array([250e9, 70e9])
    size = np.array([100e-9, 80e-9])
    middle = np.array([0.0, 90e-9])
    neutral = (young * size) @ middle / (young @ size)
    rigidity = np.sum(young * (size**3 / 12 + size * (middle - neutral) ** 2)) / (1 - 0.23**2)
    mass = 3000 * 100e-9 + 2700 * 80e-9
    exact = 3.196220616**2 * np.sqrt(rigidity / mass) / RADIUS**2 / (2 * np.pi)
    assert found.frequency[0] == pytest.approx(exact, rel=3e-6)


def test_both_sides_alike_leave_the_middle_where_it_is() -> None:
    """A layer on each side: D = Σ of Steiner's terms, the same from either side."""
    one = layer("30 nm", stress="0 MPa")
    both = device(DISC, one, one + 'side = "bottom"\n', stress="1 Pa", bending=True)
    found = solve_modes(both, 1, cache=False)
    steiner = 2 * 70e9 * (30e-9**3 / 12 + 30e-9 * 65e-9**2)
    rigidity = (250e9 * 100e-9**3 / 12 + steiner) / (1 - 0.23**2)
    mass = 3000 * 100e-9 + 2 * 2700 * 30e-9
    exact = 3.196220616**2 * np.sqrt(rigidity / mass) / RADIUS**2 / (2 * np.pi)
    assert found.frequency[0] == pytest.approx(exact, rel=3e-6)


def test_layers_that_cross_edge_and_mirrors_keep_the_symmetry() -> None:
    """A cross that reaches beyond the edge: as a quarter and whole; a lone strip breaks it."""
    cross = 'shape = {kind = "rectangle", width = "200 um", height = "10 um"}\n'
    other = 'shape = {kind = "rectangle", width = "10 um", height = "200 um"}\n'
    model = device(SQUARE, layer(more=cross), layer(more=other))
    quarter = solve_modes(model, 3, cache=False)
    whole = solve_modes(model, 3, "full", cache=False)
    assert quarter.domain.copies == 4
    bars = quarter.frequency_error + whole.frequency_error
    assert np.all(np.abs(quarter.frequency - whole.frequency) <= bars)
    corner = 'shape = {kind = "polygon", points = [["0 um", "0 um"], ["20 um", "0 um"], '
    corner += '["10 um", "30 um"]]}\n'
    assert mesh(device(SQUARE, layer(more=corner))).copies == 1


@pytest.mark.slow
def test_frequencies_converge_within_their_errors() -> None:
    """A stiff, stressed pad on a plate: each resolution holds that of a fine mesh in its errors."""
    model = device(DISC, layer("80 nm", stress="500 MPa", more=PAD), bending=True)
    fine = solve_modes(model, 3, resolution=2.5, cache=False)
    before = np.inf
    for resolution in (0.7, 1.0, 1.5):
        modes = solve_modes(model, 3, resolution=resolution, cache=False)
        off = np.abs(modes.frequency - fine.frequency)
        assert np.all(off <= modes.frequency_error + fine.frequency_error)
        assert off[0] < before
        before = off[0]


def test_a_film_without_layers_keeps_its_middle() -> None:
    """The tension's offset: 0 where nothing ends, Σσhz/Σσh where a pad does."""
    assert tension_offset(device(SQUARE, layer())) == 0.0
    pad = device(DISC, layer("50 nm", stress="200 MPa", more=PAD))
    assert tension_offset(pad) == pytest.approx(0.2 * 50 * 75e-9 / (100 + 0.2 * 50), rel=1e-12)
    below = device(DISC, layer("50 nm", stress="200 MPa", more='side = "bottom"\n' + PAD))
    assert tension_offset(below) == pytest.approx(-tension_offset(pad), rel=1e-12)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ('thickness = "50"', "[layers] 1 thickness"),
        ('side = "left"', "expected 'top' or 'bottom', write e.g. side = \"top\""),
        ('stress = "1 m"', "[layers] 1 stress"),
    ],
)
def test_mistakes_in_a_layer_are_named(changed: str, said: str) -> None:
    key = changed.split(" = ")[0]
    lines = [line for line in layer().splitlines() if not line.startswith(key)]
    with pytest.raises(GeometryError) as refused:
        device(SQUARE, "\n".join([*lines, changed, ""]))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_layer_varies_by_its_key_and_goes_through_a_layout(tmp_path: Path) -> None:
    model = load_shipped("metallised-drum")
    assert model.with_("layers.1.thickness", "60 nm").layers[0].thickness == 60e-9
    path = tmp_path / "drum.gds"
    export_layout(model, path)
    layers = read_layers("film=1/0,metal=5/0")
    back = import_layout(path, layers, model).model
    assert len(back.layers) == 1
    first, second = model.layers[0].rims[0], back.layers[0].rims[0]
    assert curves.area(second) == pytest.approx(curves.area(first), rel=1e-6)


def test_a_diagnosis_refuses_layers_in_one_line() -> None:
    with pytest.raises(ParameterError, match=r"\[layers\]: causes act on a film of one material"):
        _ = SimulatedFilm(device(SQUARE, layer()), 3).modes


def test_a_layer_beside_the_film_is_refused_with_its_place() -> None:
    part = '{shape = {kind = "square", side = "10 um"}, at = ["90 um", "0 um"]}'
    beside = f'shape = {{kind = "combined", parts = [{part}]}}\n'
    with pytest.raises(GeometryError, match=r"\[layers\] 1 metal lies beside the film"):
        device(DISC, layer(more=beside))


def test_modes_with_layers_are_kept_on_disk(tmp_path: Path) -> None:
    model = device(DISC, layer(more=PAD), layer("20 nm", more='side = "bottom"\n'))
    modes = solve_modes(model, 2, cache=False)
    path = tmp_path / "modes.nc"
    write_modes(path, modes)
    back = read_modes(path, model)
    again = solve_nonlinearity(back, cache=False).k3
    assert again == pytest.approx(solve_nonlinearity(modes, cache=False).k3, rel=1e-12)


def test_a_layer_of_the_films_own_outline_covers_it_all() -> None:
    own = 'shape = {kind = "square", side = "100 um"}\n'
    found = [solve_modes(device(SQUARE, layer(more=m)), 2, cache=False) for m in ("", own)]
    assert found[1].frequency == pytest.approx(found[0].frequency, rel=1e-12)
