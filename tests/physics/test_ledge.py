"""How far the edge of device J10 moves: closed forms, meshes, and two methods compared."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from benchmarks.ledge_film import Sheet, held_film, sheet_of
from benchmarks.ledge_modes import F11, detuning
from benchmarks.ledge_section import OXIDE, USUAL, line_force, solve_ledge
from benchmarks.ledge_solid import Grid, Wafer, solve_solid
from benchmarks.ledge_wafer import edge_motion, side_force, square_force
from femnl import load
from femnl.core.outline import Holes

PRESSURE = 280e6
SIDE = 270e-6


@pytest.mark.parametrize("box", [0.25e-3, 1e-3, 4e-3])
def test_the_push_does_not_depend_on_the_box(box: float) -> None:
    near, far = (solve_ledge(240e-9, far=length) for length in (box, 2 * box))
    assert abs(near.push - far.push) * PRESSURE < 0.02e-9
    assert abs(near.pull / far.pull - 1) < 0.001


def test_the_push_does_not_depend_on_the_elements() -> None:
    coarse, fine = (solve_ledge(240e-9, layers=layers) for layers in (4, 8))
    assert abs(coarse.push - fine.push) * PRESSURE < 0.02e-9


def test_layers_of_silicon_twice_as_thick_move_by_the_logarithm_of_two_less() -> None:
    thin = 20e-9
    materials = replace(USUAL, young=(160e9,) * 3, poisson=(0.22,) * 3)
    ledges = [solve_ledge(thin, oxide=thin, foot=0.0, materials=materials)]
    ledges += [solve_ledge(2 * thin, oxide=2 * thin, foot=0.0, materials=materials)]
    gain = ledges[0].pull - ledges[1].pull
    # the only length is the layers', so twice of it takes K ln 2 away
    assert gain == pytest.approx(materials.logarithm * np.log(2), rel=1e-4)


def test_the_field_of_a_line_has_a_free_surface_and_carries_the_force() -> None:
    """Stresses by differences: none at the surface, and their pull on a circle is F."""
    radius, step = 1.0, 1e-5
    angles = (np.arange(400) + 0.5) / 400 * -np.pi
    x, y = radius * np.cos(angles), radius * np.sin(angles)
    along_x = (line_force(x + step, y) - line_force(x - step, y)) / 2 / step
    along_y = (line_force(x, y + step) - line_force(x, y - step)) / 2 / step
    young, poisson = USUAL.young[2], USUAL.poisson[2]
    shear = young / 2 / (1 + poisson)
    lame = young * poisson / (1 + poisson) / (1 - 2 * poisson)
    xx = lame * (along_x[0] + along_y[1]) + 2 * shear * along_x[0]
    yy = lame * (along_x[0] + along_y[1]) + 2 * shear * along_y[1]
    xy = shear * (along_x[1] + along_y[0])
    pull = np.sum(xx * np.cos(angles) + xy * np.sin(angles)) * np.pi / 400
    assert pull == pytest.approx(1.0, rel=1e-4)  # towards +x, in balance with 1 N/m towards −x
    assert max(abs(yy[0]), abs(xy[0]), abs(yy[-1]), abs(xy[-1])) < 0.02


@pytest.mark.parametrize("place", [(3e-6, 0.0), (-40e-6, 100e-6), (5e-6, 300e-6)])
def test_a_side_moves_the_wafer_as_cerruti_says(place: tuple[float, float]) -> None:
    x, y = place
    young, poisson = USUAL.young[2], USUAL.poisson[2]

    def point(across: float, along: float) -> tuple[float, float]:
        """Love's form, by the shear modulus."""
        radius = np.hypot(across, along)
        shear = young / 2 / (1 + poisson)
        whole = 1 / (4 * np.pi * shear * radius)
        return (
            whole * 2 * (1 - poisson + poisson * across**2 / radius**2),
            whole * 2 * poisson * across * along / radius**2,
        )

    found = side_force(np.array([x]), np.array([y]), SIDE / 2)[:, 0]
    for axis in (0, 1):
        wanted = quad(
            lambda s, axis=axis: point(x, y - s)[axis],
            -SIDE / 2,
            SIDE / 2,
            points=[y] if abs(y) < SIDE / 2 else None,
            epsabs=1e-20,
            epsrel=1e-10,
        )[0]
        assert found[axis] == pytest.approx(wanted, rel=1e-8, abs=1e-18)


def test_four_sides_cancel_far_away() -> None:
    near, far = square_force(np.array([3e-3, 6e-3]), np.zeros(2), SIDE)[0]
    assert near / far == pytest.approx(4, rel=0.02)


@pytest.mark.slow
def test_section_and_sides_agree_with_the_solid() -> None:
    """The film over the gap is made soft, as the section knows none."""
    device = load("square-270um-perforated")
    film = replace(device.film, thickness=240e-9)
    sheet = sheet_of(device, film, 8.56e-6, SIDE)
    soft = (1.0, 0.2, 0.4)
    sheet = replace(sheet, stiffness=(soft, soft, sheet.stiffness[2]))
    moved = solve_solid(sheet, Wafer(), Grid(4e-6, 2.4, 2))
    places = np.array([0.0, 60e-6, 110e-6])
    pull, push = edge_motion(solve_ledge(240e-9), places, SIDE, OXIDE)
    pushed = np.interp(places, moved.places, moved.inwards[0])
    assert pushed == pytest.approx(push[0], rel=0.03)
    # a sheet without thickness, on coarse elements, is held closer to the oxide
    pulled = -np.interp(places, moved.places, moved.inwards[1])
    assert pulled == pytest.approx(pull[0], rel=0.09)


@pytest.mark.parametrize("bow", [0.0, 0.3])
def test_an_edge_that_moves_unevenly_changes_an_even_film_as_first_order_says(bow: float) -> None:
    """Sines and a sheet against femnl's modes, without bending and nearly without holes."""
    device = load("square-270um-perforated")
    device = replace(device, bending=False, holes=Holes(np.array(device.holes.centres), 0.1e-6))
    sheet = sheet_of(device, device.film, 8.56e-6, SIDE)
    inwards = 0.2e-9

    def motion(s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return inwards * (1 - bow * (2 * s / SIDE) ** 2), 0 * s

    first = F11 * (held_film(sheet, 1e-6, motion)[0] @ [-1, 1]) / sheet.tension[0]
    rigid = detuning(device, lambda s: (0 * s, 0 * s))
    assert detuning(device, motion) - rigid == pytest.approx(first, rel=0.03)


def test_a_film_that_shrinks_evenly_keeps_its_ratios() -> None:
    stiffness = ((60e3, 14e3, 23e3),) * 3
    sheet = Sheet(stiffness, (200.0,) * 3, 6.6e-6, SIDE)
    found = held_film(sheet, 2e-6, lambda s: (1e-9 + 0 * s, 2e-9 * s / SIDE))[0]
    assert found[0] == pytest.approx(found[1], rel=1e-9)
    assert found[0] == pytest.approx(-(60e3 + 14e3) * 2e-9 / SIDE, rel=1e-9)
