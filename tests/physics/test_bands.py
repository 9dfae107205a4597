"""Bands against folded plane waves, standing waves of many cells, and an even film."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, diags_array

from femnl import load
from femnl.core.device import Model
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.geometry import parse
from femnl.device.geometry.shapes import ellipse
from femnl.mechanics.bands import Bands, Lattice, find_cell, find_lattice, solve_bands
from femnl.mechanics.bands.spectrum import lowest_eigenvalues
from femnl.mechanics.lattice import solve_cell

Array = NDArray[np.float64]

PITCH = 8.56e-6
LATTICES = [Lattice("square", PITCH), Lattice("hexagonal", PITCH)]


@pytest.fixture(scope="module")
def model() -> Model:
    found: Model = load("square-270um-perforated")
    return found


def empty(model: Model) -> Model:
    return replace(model, holes=Holes(np.empty((0, 2)), 0.0))


def reciprocal(lattice: Lattice) -> Array:
    """Vectors of the reciprocal lattice, the 81 around zero."""
    basis = 2 * np.pi * np.linalg.inv(lattice.steps[:2]).T
    return np.array([i * basis[0] + j * basis[1] for i, j in product(range(-4, 5), repeat=2)])


@pytest.mark.parametrize("lattice", LATTICES, ids=lambda lattice: lattice.kind)
def test_without_holes_bands_are_folded_plane_waves_each_as_often_as_they_meet(
    lattice: Lattice, model: Model
) -> None:
    film = model.film
    wave = np.array([[0.0, 0.0], [0.1, 0.03], [0.5, 0.2], *list(lattice.points.values())[1:]])
    wave[1:3] *= np.pi / PITCH
    found = solve_bands(empty(model), 8, wave, lattice=lattice)
    rigidity = film.young * film.thickness**3 / 12 / (1 - film.poisson**2)
    for k, frequency, error in zip(wave, found.frequency, found.frequency_error, strict=True):
        square = np.sum((k + reciprocal(lattice)) ** 2, axis=1)
        omega = np.sqrt(
            (film.stress * film.thickness * square + rigidity * square**2)
            / (film.density * film.thickness)
        )
        exact = np.sort(omega)[:8] / (2 * np.pi)
        np.testing.assert_allclose(frequency, exact, rtol=5e-5)
        assert np.all(np.abs(frequency - exact) <= error)
        assert np.all(error <= 5e-4 * exact + 1e-3)


def test_finer_cells_come_to_the_plane_waves_with_the_rate_of_their_degree(model: Model) -> None:
    film = model.film
    wave = np.array([[0.3, 0.1]]) * np.pi / PITCH
    errors = []
    for resolution in (0.5, 1.0):
        found = solve_bands(
            empty(replace(model, bending=False)),
            4,
            wave,
            lattice=LATTICES[0],
            resolution=resolution,
        )
        square = np.sort(np.sum((wave + reciprocal(LATTICES[0])) ** 2, axis=1))[:4]
        errors.append(
            found.frequency[0] * 2 * np.pi / np.sqrt(square * film.stress / film.density) - 1
        )
    rate = np.log2(errors[0][1:] / errors[1][1:])
    np.testing.assert_allclose(rate, 8, atol=1.2)


def test_bands_have_the_symmetry_of_the_lattice(model: Model) -> None:
    lattice = Lattice("hexagonal", PITCH)
    k = np.array([0.31, 0.17]) * np.pi / PITCH
    turn = np.array([[0.5, -np.sqrt(0.75)], [np.sqrt(0.75), 0.5]])
    wave = np.array([k, -k, turn @ k, k * [1, -1], k + reciprocal(lattice)[41]])
    found = solve_bands(
        replace(model, holes=Holes(np.zeros((1, 2)), 2e-6)), 4, wave, lattice=lattice
    )
    np.testing.assert_allclose(found.frequency[1:], np.tile(found.frequency[0], (4, 1)), rtol=1e-8)


def test_long_waves_are_those_of_the_even_film(model: Model) -> None:
    cell = solve_cell(model, PITCH)
    lattice = find_lattice(model)
    small = np.array([0.02, 0.04]) * np.pi / PITCH
    # four cells a wave, as the cell's own standing waves
    long = np.array([[s, 0.0] for s in small])
    quarter = np.pi / 2 / PITCH
    found = solve_bands(
        model, 2, np.concatenate([long, [[quarter, 0.0], [quarter, quarter]]]), lattice=lattice
    )
    np.testing.assert_allclose(found.tension, cell.tension * np.eye(2), atol=1e-6 * cell.tension)
    assert found.mass == pytest.approx(cell.mass, rel=1e-9)
    square = (2 * np.pi * found.frequency[:, 0]) ** 2
    ratio = square[:2] / small**2
    assert np.sqrt(ratio[0] + (ratio[0] - ratio[1]) / 3) == pytest.approx(found.speed[0], rel=1e-6)
    assert (ratio[1] - ratio[0]) / (small[1] ** 2 - small[0] ** 2) * cell.mass == pytest.approx(
        cell.d_axis, rel=0.05
    )
    along = cell.tension * quarter**2 + cell.d_axis * quarter**4
    across = 2 * cell.tension * quarter**2 + 2 * (cell.d_axis + cell.d_mixed) * quarter**4
    np.testing.assert_allclose(square[2:] * cell.mass, [along, across], rtol=1e-6)


@pytest.mark.slow
def test_holes_that_leave_narrow_bridges_open_a_gap(model: Model) -> None:
    wide = replace(model, holes=replace(model.holes, radius=4e-6))
    found = solve_bands(wide, 6, steps=3)
    assert found.gaps
    low, high = found.gaps[0]
    assert not np.any((found.frequency > low) & (found.frequency < high))
    assert [name for name, _ in found.corners] == ["Γ", "X", "M", "Γ"]
    assert solve_bands(model, 3, steps=1).gaps == ()


def test_gaps_are_free_of_waves_and_of_their_errors() -> None:
    frequency = np.array([[0.0, 3.0, 7.0], [2.0, 4.0, 4.5]])
    error = np.full((2, 3), 0.25)
    bands = Bands(
        LATTICES[0],
        np.zeros((2, 2)),
        frequency,
        error,
        (),
        np.eye(2),
        1.0,
        frequency[:0],
        error[:0],
    )
    assert bands.gaps == ((2.25, 2.75),)
    inside = np.array([[1.0, 2.7, 6.0]])
    bands = replace(bands, inside=inside, inside_error=error[:1] / 10)
    assert bands.gaps[0] == pytest.approx((2.25, 2.675))


@pytest.mark.parametrize(
    ("name", "kind"),
    [("square-270um-perforated", "square"), ("hexagon-278um-perforated", "hexagonal")],
)
def test_the_lattice_of_shipped_devices_is_found(name: str, kind: str) -> None:
    assert find_lattice(load(name)).kind == kind


Places = NDArray[np.floating[Any]]


def lattice_device(centres: Places, radius: float, others: Places, other: float) -> Model:
    """A film with two groups of round holes, all given in µm."""

    def written(points: Places) -> str:
        return ", ".join(f'["{x:.12g} um", "{y:.12g} um"]' for x, y in points)

    group = '[[holes]]\nlattice = "list"\ncentres = [{}]\nradius = "{:.15g} um"\n'
    words = group.format(written(centres), radius)
    words += group.format(written(others), other) if len(others) else ""
    side = 4 * float(np.abs(np.concatenate([centres, others])).max())
    return parse(
        f'name = "lattice"\n[outline]\nkind = "square"\nside = "{side} um"\n{words}[film]\n'
        'thickness = "100 nm"\nyoung = "250 GPa"\npoisson = 0.23\ndensity = "3100 kg/m^3"\n'
        'stress = "1 GPa"\n'
    )


def test_cells_of_two_holes_that_are_nearly_one_fold_the_bands_of_cells_of_one() -> None:
    # Black and white squares of a board: a lattice √2 wider, turned by 45°, whose waves at k are
    # those of the narrow one at k and at k + G, G = (π/p, π/p) of the board
    pitch = 20.0
    radius = 6.0
    row, column = np.meshgrid(np.arange(8), np.arange(8))
    board = pitch * np.stack([row.ravel(), column.ravel()], axis=1) - 3.5 * pitch
    black = (row + column).ravel() % 2 == 0
    device = lattice_device(board[black], radius, board[~black], radius * (1 + 1e-9))
    wide = find_cell(device)
    assert wide.lattice.kind == "square"
    assert wide.lattice.pitch == pytest.approx(np.sqrt(2) * pitch * 1e-6)
    waves = np.array([[0.3, 0.1], [0.0, 0.5]]) * np.pi / (pitch * 1e-6)
    turn = np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2)
    folded = solve_bands(device, 4, waves @ turn.T)
    plain = lattice_device(board, radius, board[:0], radius)
    both = np.concatenate([waves, waves + np.pi / (pitch * 1e-6)])
    narrow = solve_bands(plain, 4, both).frequency
    expected = np.sort(np.concatenate([narrow[:2], narrow[2:]], axis=1), axis=1)[:, :4]
    np.testing.assert_allclose(folded.frequency, expected, rtol=2e-6)


def honeycomb(turns: float) -> Model:
    """A honeycomb of holes with six of them left out, turned."""
    steps = 160.0 * np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])
    cells = np.array([i * steps[0] + j * steps[1] for i, j in product(range(-6, 7), repeat=2)])
    shift = np.array([0.0, 160 / np.sqrt(3)])
    every = np.concatenate([cells + shift, cells - shift])
    away = np.hypot(*every.T)
    kept = every[(away > 100) & (away < 700)]
    c = np.cos(turns)
    s = np.sin(turns)
    return lattice_device(kept @ np.array([[c, s], [-s, c]]), 0.26 * 160, kept[:0], 1.0)


def test_the_honeycomb_of_soft_clamping_is_found_around_its_defect_and_has_a_gap() -> None:
    cell = find_cell(honeycomb(0.3))
    assert cell.lattice.kind == "hexagonal"
    assert cell.lattice.pitch == pytest.approx(160e-6, rel=1e-9)
    assert cell.symmetry == "twelfth"
    bands = solve_bands(honeycomb(0.3), 4, steps=3)
    upright = solve_bands(honeycomb(0.0), 4, steps=3)
    np.testing.assert_allclose(bands.frequency[1:-1], upright.frequency[1:-1], rtol=1e-6)
    (low, high), *_ = bands.gaps
    # Between the second and the first band, wide as narrow bridges make it
    assert (high - low) / (high + low) > 0.05


@pytest.mark.slow
def test_cells_with_two_unequal_mirrors_take_waves_along_both() -> None:
    row, column = np.meshgrid(np.arange(6), np.arange(6))
    board = 20.0 * np.stack([row.ravel(), column.ravel()], axis=1) - 50.0
    device = lattice_device(board, 1.0, board[:0], 1.0)
    oval = ellipse((0.0, 0.0), (8e-6, 3e-6), clamped=False)
    openings = tuple(
        Outline("ellipse", tuple(moved(s, place * 1e-6) for s in oval), None, 16e-6)
        for place in board
    )
    slotted = replace(device, holes=Holes(np.empty((0, 2)), 0.0), openings=openings)
    bands = solve_bands(slotted, 2, steps=2)
    assert [name for name, _ in bands.corners] == ["Γ", "X", "M", "Y", "Γ"]
    places = dict(bands.corners)
    assert bands.frequency[places["X"], 0] != pytest.approx(
        bands.frequency[places["Y"], 0], rel=0.05
    )


def moved(segment: Segment, shift: Array) -> Segment:
    start, end, centre = (
        (float(x + shift[0]), float(y + shift[1]))
        for x, y in (segment.start, segment.end, segment.centre or (0.0, 0.0))
    )
    return replace(segment, start=start, end=end, centre=centre)


def test_a_cell_without_mirror_lines_is_refused() -> None:
    row, column = np.meshgrid(np.arange(6), np.arange(6))
    board = 20.0 * np.stack([row.ravel(), column.ravel()], axis=1) - 50.0
    beside = board + np.array([6.0, 3.0])
    with pytest.raises(ParameterError, match="lacks mirror lines along x and y"):
        find_cell(lattice_device(board, 2.0, beside, 1.0))


def test_paths_go_around_the_irreducible_part() -> None:
    for lattice, names in zip(LATTICES, ("ΓXMΓ", "ΓMKΓ"), strict=True):
        wave, corners = lattice.path(5)
        assert "".join(name for name, _ in corners) == names
        for name, place in corners:
            np.testing.assert_allclose(wave[place], lattice.points[name])
        lengths = np.linalg.norm(np.diff(wave, axis=0), axis=1)
        assert lengths.max() < 1.3 * lengths.min()


def test_every_copy_of_a_shared_eigenvalue_is_found() -> None:
    values = np.concatenate([[1.0], np.full(6, 2.0), np.full(4, 3.0), np.arange(4.0, 60.0)])
    matrix = csc_matrix(diags_array(values))
    mass = csc_matrix(diags_array(np.ones(len(values))))
    np.testing.assert_allclose(lowest_eigenvalues(matrix, mass, 10), values[:10], rtol=1e-10)
    with pytest.raises(ConvergenceError, match="ask for fewer bands"):
        lowest_eigenvalues(matrix, mass, 40)


def test_requests_that_mean_nothing_are_refused(model: Model) -> None:
    lattice = LATTICES[0]
    with pytest.raises(ParameterError, match="count = 0, steps = 12"):
        solve_bands(model, 0)
    with pytest.raises(ParameterError, match="expected more than the diameter"):
        solve_bands(model, 2, lattice=Lattice("square", 1.7e-6))
    with pytest.raises(ParameterError, match="found an array of shape"):
        solve_bands(model, 2, np.zeros(2), lattice=lattice)
    with pytest.raises(ParameterError, match=r"resolution = 0\.1"):
        solve_bands(model, 2, resolution=0.1)
    with pytest.raises(ParameterError, match="0 of them make no lattice"):
        find_lattice(empty(model))
    crooked = np.array([[0, 0], [1, 0], [0, 1.2], [1, 1.3]]) * PITCH
    with pytest.raises(ParameterError, match="on no square or hexagonal lattice"):
        find_lattice(replace(model, holes=Holes(crooked, 1e-7)))
