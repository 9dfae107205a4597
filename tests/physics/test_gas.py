"""Gas around a film: potential flow, trapped and thin gas, against closed forms and solvers."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import solve_banded, solve_sylvester

from femnl.core.effect import Effect
from femnl.core.stages import Lines, ModalSystem, Points
from femnl.device.geometry import load
from femnl.effects import library
from femnl.mechanics.airload import airload
from femnl.mechanics.gas import crossing_time, free_molecular_loss
from femnl.observe.film import SimulatedFilm

Array = NDArray[np.float64]
MODEL = load("square-270um")
FILM = MODEL.film
SIDE = 270e-6
GAP = 3.22625e-6
SPEED = float(np.sqrt(FILM.stress / FILM.density))
ORDERS = np.array([(1, 1), (2, 1), (1, 2), (2, 2), (3, 1), (3, 3)])


def effect(name: str) -> Effect:
    return library()[name]


def squares(gap: float, cells: int = 96) -> ModalSystem:
    """The lowest modes sin·sin of a square with the gas that they move above."""
    t = (np.arange(cells) + 0.5) / cells
    shapes = np.array([np.outer(np.sin(n * np.pi * t), np.sin(m * np.pi * t)) for m, n in ORDERS])
    mass = FILM.density * FILM.thickness * SIDE**2 / 4 * np.eye(len(ORDERS))
    k2 = np.sum((np.pi * ORDERS / SIDE) ** 2, axis=1)
    return ModalSystem(
        mass * k2 * SPEED**2,
        mass,
        FILM.stress,
        FILM,
        SimulatedFilm(MODEL, 12).projection,
        (SIDE, SIDE),
        gap=gap,
        airload=airload(shapes, (SIDE / cells, SIDE / cells)),
    )


def test_gas_over_a_clamped_plate_in_a_baffle_weighs_what_lamb_found() -> None:
    # One side of w = (1 − r²/a²)²: 0.6689 ρ_g a/ρh (Lamb 1920; 0.669 in his paper).
    axis = (np.arange(96) + 0.5) / 48 - 1
    x, y = np.meshgrid(axis, axis)
    plate = np.maximum(1 - x**2 - y**2, 0)[None] ** 2
    found = airload(plate, (1 / 48, 1 / 48))[0, 0] / (np.sum(plate**2) / 48**2)
    assert found == pytest.approx(0.6689, abs=5e-5)


def test_the_load_settles_in_third_order_of_the_cell() -> None:
    coarse, middle, fine = (np.diag(squares(np.inf, n).airload) for n in (48, 96, 192))
    assert np.all(np.abs(middle / fine - 1) < 3e-4)
    assert abs(middle[0] / fine[0] - 1) < 8e-5
    assert np.all(np.abs((coarse - middle) / (middle - fine)) > 3.5)


def flow_below(wavenumber: float, gap: float, n: int = 4000) -> float:
    """Return φ at a film with φ' = 1, over a wall with φ' = 0, of φ'' = k²φ by differences."""
    step = gap / n
    rows = np.zeros((3, n + 1))
    rows[1] = -2 - (wavenumber * step) ** 2
    rows[0, 2:] = rows[2, :-2] = 1
    rows[0, 1] = rows[2, -2] = 2
    right = np.zeros(n + 1)
    right[-1] = -2 * step
    return float(solve_banded((1, 1), rows, right)[-1])


def test_a_wall_below_makes_the_gas_of_a_narrow_gap_weigh_ten_times_as_much() -> None:
    density = 1e-2
    system = squares(GAP)
    found = effect("gas_loading").changes["operators"](system, {"gas_density": density})
    share = np.diag(found.mass) / np.diag(system.mass) - 1
    inertia = FILM.density * FILM.thickness
    below = np.array([flow_below(k, GAP) for k in system.wavenumber])
    above = np.diag(system.airload) / (SIDE**2 / 4)
    np.testing.assert_allclose(share, density / inertia * (above + below), rtol=3e-6)
    free = replace(system, gap=np.inf)
    alone = effect("gas_loading").changes["operators"](free, {"gas_density": density})
    assert share[0] > 5 * (alone.mass[0, 0] / system.mass[0, 0] - 1)


def test_gas_of_a_series_weighs_what_a_plane_wave_moves() -> None:
    pressure = np.linspace(0, 100, 6)
    wavenumber = 2e4
    f = np.full(6, wavenumber * SPEED / (2 * np.pi))
    points = Points(f, np.ones(6), {"pressure": pressure}, FILM, GAP)
    found = effect("gas_loading").changes["points"](points, {"gas_density": 1e-3}).frequency
    z = np.linspace(0, 12 / wavenumber, 20001)
    kinetic = np.trapezoid(2 * np.exp(-2 * wavenumber * z), z) + flow_below(wavenumber, GAP)
    film = FILM.density * FILM.thickness
    assert (found[0] / found[-1]) ** 2 - 1 == pytest.approx(1e-3 * kinetic / film, rel=1e-6)


def pressure_under(
    mode: tuple[int, int], diffusivity: float, omega: float, n: int = 120
) -> complex:
    """Return the force of the gas on a mode, in parts of −p₀/d times its displacement.

    (D∇² − iω) q = iω ξ with q = 0 at the rim, by five-point differences.
    """
    step = SIDE / n
    even = np.eye(n - 1)
    line = (-2 * even + np.eye(n - 1, k=1) + np.eye(n - 1, k=-1)) / step**2
    t = np.arange(1, n) / n
    shape = np.outer(np.sin(mode[1] * np.pi * t), np.sin(mode[0] * np.pi * t))
    # D(L q + q L) − iω q = iω ξ is Sylvester's equation
    left = diffusivity * line - 1j * omega * even
    q = solve_sylvester(left, diffusivity * line, 1j * omega * shape)
    return complex(-np.sum(shape * q) / np.sum(shape**2))


@pytest.mark.parametrize("turn", [0.3, 1.0, 30.0])
def test_gas_that_leaves_slowly_is_a_spring_and_damps_as_reynolds_equation_says(
    turn: float,
) -> None:
    system = squares(GAP)
    square = np.diag(system.stiffness) / np.diag(system.mass)
    omega = np.sqrt(square)
    escape = turn / omega[0]
    diffusivity = 1 / (escape * system.wavenumber[0] ** 2)
    values = {"pressure": 1.0, "escape_time": escape}
    moved = effect("trapped_gas").changes["operators"](system, values)
    lines = Lines(omega / (2 * np.pi), np.empty(0), np.zeros(6), np.zeros((3, 6)), FILM, GAP)
    lossy = effect("trapped_gas").changes["frequencies"](lines, values)
    spring = 1.0 / (FILM.density * FILM.thickness * GAP)
    for k, (m, n) in enumerate(ORDERS):
        force = pressure_under((m, n), diffusivity, omega[k])
        change = moved.stiffness[k, k] / system.mass[k, k] - square[k]
        assert change == pytest.approx(spring * force.real, rel=2e-3)
        assert lossy.loss[k] == pytest.approx(spring * force.imag / square[k], rel=2e-3)


def test_a_trapped_gas_of_a_series_is_that_of_the_spectrum() -> None:
    f = 1.5e6
    values = {"pressure": 50.0, "escape_time": 2e-7}
    lines = Lines(np.array([f]), np.empty(0), np.zeros(1), np.zeros((3, 1)), FILM, GAP)
    lossy = effect("trapped_gas").changes["frequencies"](lines, values)
    points = Points(np.full(2, f), np.full(2, 1e30), {"pressure": np.array([0.0, 7.0])}, FILM, GAP)
    found = effect("trapped_gas").changes["points"](points, values)
    assert 1 / found.quality_factor[1] == pytest.approx(lossy.loss[0], rel=1e-9)
    assert found.frequency[1] > found.frequency[0] == f


def test_thin_gas_takes_what_molecules_carry_off() -> None:
    # Molecules that bounce off a plate: 8 p √(M/2πRT) per velocity and area on both sides.
    frequency = 1.5e6
    rate = 8 * np.sqrt(0.0280134 / (2 * np.pi * 8.314462618 * 295))
    inertia = 2 * np.pi * frequency * FILM.density * FILM.thickness
    assert free_molecular_loss(FILM, frequency) == pytest.approx(rate / inertia, rel=1e-9)


def test_gas_that_leaves_at_once_takes_the_loss_of_bao() -> None:
    # Bao's energy transfer: P/(16πd) times the loss of free molecular flow.
    frequency = 1.5e6
    tau = crossing_time(MODEL.outline)
    inertia = FILM.density * FILM.thickness * GAP * 2 * np.pi * frequency
    squeezed = free_molecular_loss(FILM, frequency) * 4 * SIDE / (16 * np.pi * GAP)
    assert tau / inertia == pytest.approx(squeezed, rel=1e-9)
