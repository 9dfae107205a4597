"""What where and how a film is drawn must not change: f and α agree within their error bars."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.core.errors import GeometryError
from femnl.core.modes import Modes
from femnl.core.nonlinearity import Nonlinearity
from femnl.core.outline import Holes, Outline, Segment
from femnl.device.geometry import load, parse
from femnl.device.geometry.placing import moved
from femnl.device.mesh import mesh
from femnl.io.results.netcdf import read_modes, write_modes
from femnl.io.results.surface import unfold
from femnl.mechanics.compression import released_stress
from femnl.mechanics.modes import shapes_at
from femnl.pipeline import solve_modes, solve_modes_near, solve_nonlinearity

Array = NDArray[np.float64]
Solved = tuple[Modes, Nonlinearity]

FEW = settings(derandomize=True, database=None, deadline=None, max_examples=3)
CORNERS = np.array([[-50.0, -40.0], [50.0, -40.0], [60.0, 10.0], [0.0, 45.0], [-50.0, 40.0]])  # µm
HOLES = np.array([[10.0, 0.0], [-20.0, 3.0], [20.0, -25.0]])
SQUARE = np.array([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])
COUNT = 4


def drawn(corners: Array, holes: Array, radius: float = 5.0, thickness: float = 100.0) -> Model:
    """Return a polygon with round holes, all in µm, of a film in nm."""

    def points(places: Array) -> str:
        return ", ".join(f'["{float(x)!r} um", "{float(y)!r} um"]' for x, y in places)

    inner = (
        f'[holes]\nlattice = "list"\ncentres = [{points(holes)}]\nradius = "{radius} um"\n'
        if len(holes)
        else ""
    )
    return parse(
        f'name = "drawn"\n[outline]\nkind = "polygon"\npoints = [{points(corners)}]\n{inner}'
        f'[film]\nthickness = "{thickness} nm"\nyoung = "250 GPa"\npoisson = 0.23\n'
        'density = "3100 kg/m^3"\nstress = "1 GPa"\n'
    )


def solved(model: Model, resolution: float = 0.5) -> Solved:
    modes = solve_modes(model, COUNT, resolution=resolution, cache=False)
    return modes, solve_nonlinearity(modes, cache=False)


def agree(one: Solved, other: Solved, frequency: float = 1.0, alpha: float = 1.0) -> None:
    """Check f and α of one film, times factors, against those of another."""
    f_error = frequency * one[0].frequency_error + other[0].frequency_error
    alpha_error = alpha * one[1].alpha_error + other[1].alpha_error
    assert np.all(np.abs(frequency * one[0].frequency - other[0].frequency) < f_error)
    assert np.all(np.abs(alpha * one[1].alpha - other[1].alpha) < alpha_error)
    # Bars that hold because they are wide would prove nothing
    assert np.all(f_error < 1e-3 * other[0].frequency)
    assert np.all(alpha_error < 0.05 * np.abs(other[1].alpha))


@pytest.fixture(scope="module")
def plain() -> Solved:
    return solved(drawn(CORNERS, HOLES))


@given(st.integers(-(10**10), 10**10), st.integers(-(10**10), 10**10))
@FEW
def test_a_film_rings_the_same_wherever_it_is_drawn(plain: Solved, x: int, y: int) -> None:
    step = np.array([x, y]) / 1000  # whole nanometres: geometry files have no lengths below 1e-12 m
    agree(plain, solved(drawn(CORNERS + step, HOLES + step)))


@pytest.mark.parametrize("away", [pytest.param(1e3, marks=pytest.mark.slow), 5e7])
def test_modes_of_one_frequency_are_turned_alike_far_from_the_origin(away: float) -> None:
    # (1,2) and (2,1) share a frequency, and α depends on how they are mixed. A mesh of half the
    # resolution, which has no symmetry, splits ω² by more than what counts as sharing.
    near = solved(drawn(SQUARE, HOLES[:0]), 1.0)
    agree(near, solved(drawn(SQUARE + away, HOLES[:0]), 1.0))


@given(st.floats(0.1, 6.2), st.booleans())
@FEW
def test_a_film_turned_or_mirrored_rings_the_same(
    plain: Solved, angle: float, mirrored: bool
) -> None:
    c = np.cos(angle)
    s = np.sin(angle)
    turn = np.array([[c, -s], [s, c]]) @ np.diag([1.0, -1.0 if mirrored else 1.0])
    corners = (CORNERS @ turn.T)[:: -1 if mirrored else 1]
    agree(plain, solved(drawn(corners, HOLES @ turn.T)))


@pytest.mark.slow
@given(st.permutations(range(len(HOLES))), st.integers(0, len(CORNERS) - 1))
@FEW
def test_the_order_of_holes_and_corners_does_not_matter(
    plain: Solved, order: list[int], first: int
) -> None:
    agree(plain, solved(drawn(np.roll(CORNERS, first, axis=0), HOLES[order])))


@given(st.floats(0.05, 20))
@FEW
def test_a_film_scaled_in_all_lengths_rings_in_proportion(plain: Solved, scale: float) -> None:
    scaled = solved(drawn(scale * CORNERS, scale * HOLES, 5 * scale, 100 * scale))
    # α is an inverse square length
    agree(plain, scaled, 1 / scale, scale**-2)


@pytest.mark.parametrize("away", [2e8, 9e8])
def test_a_film_too_far_from_the_origin_for_its_coordinates_is_refused(away: float) -> None:
    message = r"the film lies .* m from the origin.*move it and its holes nearer to the origin"
    with pytest.raises(GeometryError, match=message):
        mesh(drawn(SQUARE + away, HOLES[:0]))


def shipped(name: str, by: tuple[float, float] = (0.0, 0.0)) -> Model:
    model = load(name)
    return moved(model, by) if any(by) else model


@pytest.mark.parametrize(
    "name", ["square-270um", "hexagon-278um", "trampoline", "square-270um-etched"]
)
@pytest.mark.parametrize("by", [(1e-3, -2e-3), (1.0, 0.3)])
def test_symmetry_is_found_about_the_middle_of_a_film(name: str, by: tuple[float, float]) -> None:
    here = mesh(shipped(name), resolution=0.5)
    there = mesh(shipped(name, by), resolution=0.5)
    assert here.copies == there.copies == 4
    assert here.diagonal == there.diagonal
    assert there.middle == pytest.approx(by, rel=1e-9)
    # gmsh grows other triangles from coordinates rounded elsewhere
    assert there.mesh.nelements == pytest.approx(here.mesh.nelements, rel=0.05)


@pytest.mark.parametrize("by", [pytest.param((3e-4, 0.0), marks=pytest.mark.slow), (-2e-3, 5e-3)])
def test_all_that_is_drawn_of_a_film_moves_with_it(by: tuple[float, float], tmp_path: Path) -> None:
    here = solve_modes(shipped("trampoline"), 4, cache=False)
    model = shipped("trampoline", by)
    there = solve_modes(model, 4, cache=False)
    write_modes(tmp_path / "modes.nc", there)
    kept = read_modes(tmp_path / "modes.nc", model)
    x, y = np.random.default_rng(7).uniform(-40e-6, 40e-6, (2, 200))
    expected = shapes_at(here, x, y)
    assert np.abs(expected).max() > 0.9
    for found in (there, kept):
        sign = np.sign(np.sum(shapes_at(found, x + by[0], y + by[1]) * expected, axis=1))
        np.testing.assert_allclose(
            sign[:, None] * shapes_at(found, x + by[0], y + by[1]), expected, atol=1e-4
        )
    surface = unfold(there).points - by
    np.testing.assert_allclose(surface.min(axis=0), unfold(here).points.min(axis=0), rtol=1e-6)
    np.testing.assert_allclose(surface.max(axis=0), unfold(here).points.max(axis=0), rtol=1e-6)
    corners = released_stress(there.domain).corners - by
    at_home = released_stress(here.domain).corners
    np.testing.assert_allclose(corners.min(axis=(0, 1)), at_home.min(axis=(0, 1)), rtol=1e-6)
    np.testing.assert_allclose(corners.max(axis=(0, 1)), at_home.max(axis=(0, 1)), rtol=1e-6)


@pytest.mark.slow
def test_modes_near_a_frequency_move_with_the_film() -> None:
    here = solve_modes_near(shipped("square-270um"), 5e6, 5, cache=False)
    there = solve_modes_near(shipped("square-270um", (2e-3, 1e-3)), 5e6, 5, cache=False)
    assert here.domain.copies == there.domain.copies == 4
    assert here.first == there.first
    errors = here.frequency_error + there.frequency_error
    assert np.all(np.abs(here.frequency - there.frequency) < errors)


@pytest.mark.slow
@pytest.mark.parametrize("by", [(1e-3, 0.0), (0.3, -1.0)])
def test_a_lattice_of_holes_is_condensed_wherever_the_film_lies(by: tuple[float, float]) -> None:
    home = replace(load("square-270um-perforated"), bending=False)
    near = Holes(home.holes.centres[np.abs(home.holes.centres).max(axis=1) < 40e-6], 0.9e-6)
    half = float(np.abs(near.centres).max()) + 8e-6
    side = ((-half, -half), (half, -half), (half, half), (-half, half))
    edges = tuple(Segment(a, b) for a, b in zip(side, side[1:] + side[:1], strict=True))
    # Whatever a rectangle is drawn as
    film = replace(home, outline=Outline("polygon", edges, None, 2 * half), holes=near)
    here, there = solved(film, 1.0), solved(moved(film, by), 1.0)
    assert here[0].domain.tiles == there[0].domain.tiles == 1.0
    assert there[0].domain.middle == pytest.approx(by, rel=1e-9)
    agree(here, there)
    places = np.array([[0.0, 0.0], [31e-6, -40e-6]])
    shapes = [
        np.abs(shapes_at(modes, *(places + shift).T))
        for modes, shift in ((here[0], (0.0, 0.0)), (there[0], by))
    ]
    assert shapes[0][0, 0] > 0.9
    np.testing.assert_allclose(shapes[0][0], shapes[1][0], atol=1e-4)


@pytest.mark.slow
def test_a_film_with_an_electrode_can_be_moved() -> None:
    drum = load("metallised-drum")
    there = moved(drum, (1e-3, -2e-3))
    assert there.layers[0].rims != drum.layers[0].rims
    agree(solved(drum, 1.0), solved(there, 1.0))
