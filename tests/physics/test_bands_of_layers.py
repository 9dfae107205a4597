"""Bands of cells whose layers have a shape: stripes by transfer matrices, discs by plane waves."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh, expm
from scipy.optimize import brentq
from scipy.special import j1

from femnl.core.device import Model
from femnl.core.errors import ParameterError
from femnl.device.geometry import parse
from femnl.mechanics.bands import Lattice, find_cell, solve_bands
from femnl.pipeline import solve_modes
from tests.physics.layered_text import FILM

Array = NDArray[np.float64]

PITCH = 10e-6
SQUARE = Lattice("square", PITCH)
HEXAGONAL = Lattice("hexagonal", PITCH)


def device(shape: str, more: str = "", side: float = 60.0, bending: bool = False) -> Model:
    """A square film with one layer of a shape; more: keys that replace those of the layer."""
    keys = {
        "name": '"metal"',
        "thickness": '"60 nm"',
        "young": '"70 GPa"',
        "poisson": "0.23",
        "density": '"2700 kg/m^3"',
        "stress": '"0 Pa"',
    }
    for line in more.splitlines():
        key, value = line.split(" = ")
        keys[key] = value
    layer = "\n".join(f"{key} = {value}" for key, value in keys.items())
    return parse(
        f'name = "metal"\n[outline]\nkind = "square"\nside = "{side} um"\n'
        f"{FILM.format(stress='200 MPa')}[[layers]]\n{layer}\nshape = {shape}\n"
        f"[model]\nbending = {str(bending).lower()}\n"
    )


def stripes(width: float, count: int = 7) -> str:
    """Stripes along y as wide as that, one in the middle of each cell, in µm."""
    middle = (count - 1) / 2
    parts = [
        f'{{shape = {{kind = "rectangle", width = "{width} um", height = "80 um"}}, '
        f'at = ["{10 * (k - middle)} um", "0 um"]}}'
        for k in range(count)
    ]
    return f'{{kind = "combined", parts = [{", ".join(parts)}]}}'


def disc(diameter: float) -> str:
    return f'{{kind = "circle", diameter = "{diameter} um"}}'


def strips(model: Model) -> tuple[Array, Array, Array, Array]:
    """Tension along x, mass, and stiffness in x and in bending of film and film with layer, (2,).

    Both are strained in x alone, from film stresses that balance: ε(x) of mean zero, N one.
    """
    film = model.film
    layer = model.layers[0]
    rigid_film = film.young / (1 - film.poisson**2)
    rigid_layer = layer.young / (1 - layer.poisson**2)
    height = (film.thickness + layer.thickness) / 2
    in_plane = film.thickness * rigid_film
    coupled = layer.thickness * rigid_layer
    pull = np.array([film.thickness * film.stress] * 2)
    pull[1] += layer.thickness * layer.stress
    mass = np.array([film.thickness * film.density] * 2)
    mass[1] += layer.thickness * layer.density
    stretch = np.array([in_plane, in_plane + coupled])
    bend = np.array([film.thickness**3 * rigid_film / 12] * 2)
    # Steiner's theorem for two strips about their common neutral line
    bend[1] += layer.thickness**3 * rigid_layer / 12
    bend[1] += height**2 * in_plane * coupled / (in_plane + coupled)
    return pull, mass, stretch, bend


def common_tension(model: Model, width: float) -> float:
    """N across stripes of the layer, width [m] of each pitch, that sides without motion leave."""
    pull, _, stretch, _ = strips(model)
    parts = np.array([PITCH - width, width])
    return float(np.sum(parts * pull / stretch) / np.sum(parts / stretch))


STRESSED = 'stress = "300 MPa"'
STIFF = 'stress = "-150 MPa"\nyoung = "400 GPa"\nthickness = "150 nm"'


def roots(mismatch: Callable[[float], float], highest: float) -> list[float]:
    """Zeros below the highest ω, told apart to a thousandth of it."""
    omega = np.linspace(1e-3, 1.0, 1500) * highest
    values = np.array([mismatch(one) for one in omega])
    at = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))
    return [float(brentq(mismatch, omega[k], omega[k + 1], xtol=1e-9 * highest)) for k in at]


@pytest.mark.parametrize("bending", [False, True])
@pytest.mark.parametrize("width", [pytest.param(4.0, marks=pytest.mark.slow), 7.5])
@pytest.mark.parametrize("more", [pytest.param("", marks=pytest.mark.slow), STRESSED, STIFF])
def test_waves_across_stripes_are_those_of_a_string_or_beam_of_two_kinds(
    bending: bool, width: float, more: str
) -> None:
    """Of Kronig and Penney: w, w′, Dw″ and Nw′ − Dw‴ go on across a rim, and by e^{iqa} a cell.

    With z = 2 cos qa the matrix T of a cell has z = tr T of a string, and of a beam
    z² − z tr T + ½(tr²T − tr T²) − 2 = 0.
    """
    model = device(stripes(width), more, bending=bending)
    tension = common_tension(model, width * 1e-6)
    _, mass, _, bend = strips(model)
    lengths = [PITCH - width * 1e-6, width * 1e-6]

    def cell(omega: float) -> Array:
        found = np.eye(4 if bending else 2)
        for length, inertia, rigidity in zip(lengths, mass, bend, strict=True):
            push = -(omega**2) * inertia
            if bending:
                rates = np.zeros((4, 4))
                rates[[0, 1, 2, 2, 3], [1, 2, 1, 3, 0]] = [1, 1 / rigidity, tension, -1, push]
            else:
                rates = np.array([[0, 1 / tension], [push, 0]])
            found = expm(length * rates) @ found
        return found

    for part in (0.3, 0.77, 0.95):
        double = 2 * np.cos(np.pi * part)

        def mismatch(omega: float, double: float = double) -> float:
            matrix = cell(omega)
            trace = np.trace(matrix)
            if not bending:
                return float(double - trace)
            second = (trace**2 - np.trace(matrix @ matrix)) / 2
            return float(double**2 - double * trace + second - 2)

        wave = np.array([[part, 0.0]]) * np.pi / PITCH
        found = solve_bands(model, 8, wave, lattice=SQUARE)
        exact = np.array(roots(mismatch, 2 * np.pi * found.frequency[0, -1])) / (2 * np.pi)
        for frequency in exact[:2]:
            # Other waves have knots along y
            nearest = np.argmin(np.abs(found.frequency[0] - frequency))
            away = abs(found.frequency[0, nearest] - frequency)
            assert away < 5e-5 * frequency
            assert away < found.frequency_error[0, nearest] + 1e-9 * frequency
        assert found.frequency[0, 0] == pytest.approx(exact[0], rel=5e-5)


@pytest.mark.parametrize(
    ("lattice", "diameter"), [(SQUARE, 4.0), (SQUARE, 9.0), (HEXAGONAL, 4.0), (HEXAGONAL, 8.0)]
)
def test_waves_in_a_film_with_discs_are_those_of_plane_waves(
    lattice: Lattice, diameter: float
) -> None:
    """T |k + G|² c_G = ω² Σ μ_{G−G′} c_G′ of a membrane whose tension the discs leave even."""
    model = device(disc(diameter), side=10.0)
    wave = np.array([[0.0, 0.0], [0.43, 0.21], *list(lattice.points.values())[1:]])
    wave[1] *= np.pi / PITCH
    found = solve_bands(model, 5, wave, lattice=lattice)
    film = model.film
    layer = model.layers[0]
    basis = 2 * np.pi * np.linalg.inv(lattice.steps[:2]).T
    every = np.array([i * basis[0] + j * basis[1] for i, j in product(range(-15, 16), repeat=2)])
    lengths = np.linalg.norm(every[:, None] - every[None], axis=-1)
    radius = diameter / 2 * 1e-6
    argument = np.where(lengths > 0, lengths * radius, 1.0)
    share = np.where(lengths > 0, 2 * j1(argument) / argument, 1.0)
    area = abs(np.linalg.det(lattice.steps[:2]))
    mass = layer.thickness * layer.density * np.pi * radius**2 / area * share
    mass += film.thickness * film.density * np.eye(len(every))
    for k, frequency in zip(wave, found.frequency, strict=True):
        pull = film.thickness * film.stress * np.sum((k + every) ** 2, axis=1)
        square = eigh(np.diag(pull), mass, eigvals_only=True, subset_by_index=[0, 4])
        exact = np.sqrt(np.maximum(square, 0)) / (2 * np.pi)
        np.testing.assert_allclose(frequency, exact, rtol=1e-4, atol=10.0)


HINGED = '[clamp]\nshear = "0 Pa"\nrotation = "0 N"\n'


@pytest.mark.parametrize(
    "shape", [disc(6.0), stripes(4.0), pytest.param(disc(11.0), marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("bending", [False, True])
def test_standing_waves_of_one_cell_are_waves_of_the_lattice(shape: str, bending: bool) -> None:
    """Modes of a hinged film as large as a cell, continued oddly, which no periodic code solved.

    What is even along x goes on by −1 from cell to cell, what is odd by 1.
    """
    more = 'stress = "-150 MPa"\nyoung = "150 GPa"\npoisson = 0.35'
    model = device(shape, more, side=10.0, bending=bending)
    modes = solve_modes(parse(model.text + HINGED), 5, cache=False)
    parts = [[1, 1], [0, 1], [1, 0], [0, 0]]
    bands = solve_bands(model, 12, np.array(parts) * np.pi / PITCH, lattice=SQUARE)
    assert modes.parity is not None
    for parity, frequency in zip(modes.parity, modes.frequency, strict=True):
        # Mirrors are those at y = 0 and at x = 0
        along_y, along_x = parity
        place = parts.index([int(along_x > 0), int(along_y > 0)])
        nearest = np.min(np.abs(bands.frequency[place] - frequency))
        assert nearest < 2e-5 * frequency


def dotted(angle: float, dots: str = "7 um") -> Model:
    """A square lattice of holes, turned, with metal dots in the middles between them."""
    c = np.cos(angle)
    s = np.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    row, column = np.meshgrid(np.arange(5), np.arange(5))
    board = 20.0 * np.stack([row.ravel(), column.ravel()], axis=1) - 40.0
    row, column = np.meshgrid(np.arange(6), np.arange(6))
    between = 20.0 * np.stack([row.ravel(), column.ravel()], axis=1) - 50.0
    centres = ", ".join(f'["{x:.12g} um", "{y:.12g} um"]' for x, y in board @ turn)
    parts = ", ".join(
        f'{{shape = {{kind = "circle", diameter = "{dots}"}}, at = ["{x:.12g} um", "{y:.12g} um"]}}'
        for x, y in between @ turn
    )
    model = device(f'{{kind = "combined", parts = [{parts}]}}', STRESSED, side=180.0, bending=True)
    holes = f'[[holes]]\nlattice = "list"\ncentres = [{centres}]\nradius = "4 um"\n'
    return parse(model.text + holes)


@pytest.mark.slow
def test_dots_between_the_holes_of_a_device_are_found_with_their_lattice() -> None:
    """However the device is turned, and the same as a lattice that is given about one hole."""
    wave = np.array([[0.3, 0.1], [1.0, 1.0]]) * np.pi / 20e-6
    found = [solve_bands(dotted(angle), 2, wave).frequency for angle in (0.0, 0.3)]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-6)
    given = solve_bands(dotted(0.0), 2, wave, lattice=Lattice("square", 20e-6))
    np.testing.assert_allclose(given.frequency, found[0], rtol=1e-6)
    bare = solve_bands(replace(dotted(0.0), layers=()), 2, wave).frequency
    assert np.all(np.abs(bare / found[0] - 1) > 1e-3)


def test_long_waves_along_stripes_have_another_speed_than_those_across() -> None:
    """N_xx is the same everywhere; ε_yy = 0, so that N_yy − ν N_xx of each strip is its own."""
    width = 4.0
    model = device(stripes(width), STIFF)
    across = common_tension(model, width * 1e-6)
    pull, mass, _, _ = strips(model)
    nu = model.film.poisson
    parts = np.array([PITCH - width * 1e-6, width * 1e-6]) / PITCH
    along = float(parts @ (pull + nu * (across - pull)))
    inertia = float(parts @ mass)
    bands = solve_bands(model, 1, np.array([[100.0, 0.0], [0.0, 100.0]]), lattice=SQUARE)
    exact = np.sqrt(np.array([across, along]) / inertia)
    np.testing.assert_allclose(bands.speed_along(np.eye(2)), exact, rtol=1e-6)
    np.testing.assert_allclose(2 * np.pi * bands.frequency[:, 0] / 100, exact, rtol=1e-6)
    np.testing.assert_allclose(bands.speed, np.sort(exact), rtol=1e-6)


def test_cells_with_stripes_take_waves_along_both_mirrors() -> None:
    bands = solve_bands(device(stripes(4.0)), 2, steps=1, lattice=SQUARE)
    assert [name for name, _ in bands.corners] == ["Γ", "X", "M", "Y", "Γ"]


ASIDE = (
    '{kind = "combined", parts = [{shape = {kind = "circle", diameter = "3 um"}, '
    'at = ["2 um", "1 um"]}]}'
)


@pytest.mark.parametrize(
    ("shape", "lattice", "told"),
    [
        (disc(30.0), SQUARE, "does not repeat with the square lattice of pitch 10 µm"),
        (disc(11.0), SQUARE, "does not repeat with the square lattice"),
        (stripes(4.0, 3), SQUARE, "does not repeat with the square lattice"),
        (ASIDE, SQUARE, "lacks mirror lines along x and y in the cell of the square lattice"),
        (stripes(4.0), HEXAGONAL, "does not repeat with the hexagonal lattice"),
        ('{kind = "square", side = "4 um"}', HEXAGONAL, "lacks mirror lines at every 30°"),
    ],
)
def test_layers_that_do_not_repeat_are_named(shape: str, lattice: Lattice, told: str) -> None:
    with pytest.raises(ParameterError, match=rf"^metal: \[layers\] 1 metal: {told}.*$"):
        solve_bands(device(shape), 2, lattice=lattice)


def test_an_electrode_on_some_holes_alone_is_named() -> None:
    with pytest.raises(ParameterError, match=r"\[layers\] 1 metal: does not repeat"):
        find_cell(dotted(0.0).with_("layers.1.shape", {"kind": "circle", "diameter": "50 um"}))
