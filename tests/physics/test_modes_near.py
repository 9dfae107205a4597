"""Modes near a frequency against closed forms and against all modes from the lowest on."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import jn_zeros

from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.modes import Modes
from femnl.device.geometry import parse
from femnl.device.mesh import mesh
from femnl.mechanics.fem.solvers import FACTOR_BYTES
from femnl.mechanics.modes import solve_modes as solve_on_mesh
from femnl.mechanics.modes import with_counterparts
from femnl.mechanics.modes.dilution import bending_share
from femnl.mechanics.modes.near import side_by_side
from femnl.mechanics.prestress import solve_prestress
from femnl.pipeline import solve_modes, solve_modes_near

Array = NDArray[np.float64]

FILM = """
[film]
thickness = "50 nm"
young = "270 GPa"
poisson = 0.27
density = "1000 kg/m^3"
stress = "1 GPa"
[model]
bending = false
"""
CIRCLE = f'name = "drum"\n[outline]\nkind = "circle"\ndiameter = "200 um"\n{FILM}'
SQUARE = f'name = "square"\n[outline]\nkind = "square"\nside = "200 um"\n{FILM}'
SPEED = 1000.0


def drum_frequencies() -> Array:
    """All frequencies [Hz] of the drum, those with nodal diameters twice, rising."""
    found = [jn_zeros(0, 15)]
    for order in range(1, 40):
        found += 2 * [jn_zeros(order, 15)]
    return np.sort(np.concatenate(found)) * SPEED / (2 * np.pi * 100e-6)


def square_frequencies() -> Array:
    """All frequencies [Hz] of the square, rising."""
    squares = np.add.outer(np.arange(1, 40) ** 2, np.arange(1, 40) ** 2)
    return np.asarray(np.sort(np.sqrt(squares).ravel()) * SPEED / (2 * 200e-6))


@pytest.mark.parametrize("symmetry", ["auto", "half", "full"])
def test_modes_of_a_drum_near_a_frequency_have_the_numbers_of_bessel_functions(
    symmetry: str,
) -> None:
    exact = drum_frequencies()
    target = float(exact[39] + exact[40]) / 2  # between two different modes
    assert exact[40] > 1.001 * exact[39]
    found = solve_modes_near(parse(CIRCLE), target, 6, symmetry, cache=False)
    number = np.argsort(np.abs(exact**2 - target**2), kind="stable")[:6]
    assert found.first == number.min() + 1
    np.testing.assert_allclose(found.frequency, exact[found.number - 1], rtol=5e-6)
    assert np.all(np.abs(found.frequency - exact[found.number - 1]) < found.frequency_error)
    assert np.all(np.isnan(found.ratio))


@pytest.mark.parametrize("target", [1e3, 7.3e6, 2.03e7])
def test_every_mode_of_a_square_is_found_twice_where_it_is_double(target: float) -> None:
    exact = square_frequencies()
    found = solve_modes_near(parse(SQUARE), target, 9, cache=False)
    np.testing.assert_allclose(found.frequency, exact[found.number - 1], rtol=3e-6)
    away = np.abs(exact**2 - target**2)
    assert set(found.number - 1) >= set(np.flatnonzero(away < np.sort(away)[8] * (1 - 1e-9)))


def test_they_are_the_same_as_among_all_modes() -> None:
    model = parse(SQUARE.replace("bending = false", "bending = true"))
    every = solve_modes(model, 20, resolution=0.7, cache=False)
    near = solve_modes_near(
        model, float(every.frequency[12:14].mean()), 4, resolution=0.7, cache=False
    )
    among = near.number - 1
    np.testing.assert_allclose(near.frequency, every.frequency[among], rtol=1e-9)
    np.testing.assert_allclose(near.effective_mass, every.effective_mass[among], rtol=1e-6)
    np.testing.assert_allclose(bending_share(near), bending_share(every)[among], rtol=1e-5)
    assert near.label == tuple(every.label[k] for k in among)


def test_a_target_on_a_mode_and_one_below_zero_are_refused_in_one_line() -> None:
    with pytest.raises(ParameterError, match="expected a target above 0"):
        solve_modes_near(parse(SQUARE), -1.0, 2, cache=False)
    with pytest.raises(ParameterError, match="no mesh follows"):
        solve_modes_near(parse(SQUARE), 1e300, 2, cache=False)
    with pytest.raises(ParameterError, match="expected at least one mode"):
        solve_modes_near(parse(SQUARE), 1e6, 0, cache=False)


def test_a_film_that_buckles_is_refused_although_its_lowest_modes_are_not_solved() -> None:
    # A strip clamped at its ends alone and drawn in by less than nothing: its springs push
    words = SQUARE.replace("bending = false", "bending = true") + (
        '[clamp]\nnormal = "1e15 Pa"\nshear = "1e15 Pa"\ndraw = "10 um"\n'
    )
    for target in (5e4, 2e7):
        with pytest.raises(ConvergenceError, match="under compression"):
            solve_modes_near(parse(words), target, 2, resolution=0.5, cache=False)


def test_as_many_sectors_are_solved_at_once_as_cores_and_half_of_the_memory_allow() -> None:
    one = FACTOR_BYTES * 1000
    assert side_by_side(1000, 100 * one, 4) == 4
    assert side_by_side(1000, 100 * one, 1) == 1
    assert side_by_side(1000, 7 * one, 4) == 3
    assert side_by_side(1000, one, 4) == 1


def test_degrees_solved_at_once_give_the_modes_of_one_after_another() -> None:
    model = parse(SQUARE)
    domain = mesh(model, "auto", 0.5, 4)

    def at_degree(count: int, degree: int) -> Modes:
        return solve_on_mesh(solve_prestress(domain, degree), count, degree)

    one, both = (with_counterparts(model, at_degree, 4, 4, 4, threads) for threads in (1, 2))
    for own, other in zip(one.grades, both.grades, strict=True):
        assert np.array_equal(own.frequency, other.frequency)
        assert np.array_equal(own.shapes, other.shapes)
