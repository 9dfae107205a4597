"""Hundreds of modes: error bars against exact spectra, or a refusal that counts what is known."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import jn_zeros

from femnl import load
from femnl.core.device import Model
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.modes import Modes
from femnl.device.geometry import parse
from femnl.device.mesh import shortest_wave, wave_at
from femnl.mechanics.modes import certified
from femnl.pipeline import solve_modes, solve_modes_near, solve_nonlinearity

Array = NDArray[np.float64]

# Films of 1 kg/m³ and 1 Pa: waves of 1 m/s
FILM = """[film]
thickness = "1 nm"
young = "1 GPa"
poisson = 0.25
density = "1 kg/m^3"
stress = "1 Pa"
"""
OUTLINES = {
    "square": 'kind = "square"\nside = "1 m"',
    "rectangle": 'kind = "rectangle"\nwidth = "3 m"\nheight = "1 m"',
    "circle": 'kind = "circle"\ndiameter = "2 m"',
}


def membrane(name: str) -> Model:
    return replace(parse(f'name = "{name}"\n[outline]\n{OUTLINES[name]}\n{FILM}'), bending=False)


def exact(name: str, count: int) -> Array:
    """The lowest frequencies [Hz] of an ideal membrane."""
    if name == "circle":
        zeros = [np.repeat(jn_zeros(m, 50), 2 if m else 1) for m in range(90)]
        return np.asarray(np.sort(np.concatenate(zeros))[:count] / (2 * np.pi))
    width = 3.0 if name == "rectangle" else 1.0
    orders = np.arange(1, 150)
    return np.sort(np.hypot(orders[:, None] / width, orders).ravel())[:count] / 2


@pytest.mark.parametrize(
    "name", [pytest.param("square", marks=pytest.mark.slow), "rectangle", "circle"]
)
@pytest.mark.parametrize("count", [200, pytest.param(500, marks=pytest.mark.slow)])
def test_error_bars_of_hundreds_of_modes_hold_and_are_narrow(name: str, count: int) -> None:
    modes = solve_modes(membrane(name), count, cache=False)
    known = exact(name, count)
    held = np.abs(modes.frequency - known) <= modes.frequency_error
    ratio_held = np.abs(modes.ratio - known / known[0]) <= modes.ratio_error
    assert held.mean() >= 0.99
    assert ratio_held.mean() >= 0.99
    assert np.all(modes.frequency_error < 1e-4 * known)
    assert np.all(np.abs(modes.frequency - known) < 1e-5 * known)


@pytest.mark.parametrize("name", OUTLINES)
def test_the_shortest_wave_is_that_of_the_highest_mode(name: str) -> None:
    for count in (50, 200, 500):
        wave = shortest_wave(membrane(name), count)
        assert wave == pytest.approx(1 / exact(name, count)[-1], rel=0.03)
    assert wave_at(membrane(name), 4.0) == pytest.approx(0.25)


def test_modes_near_a_high_frequency_have_error_bars_that_hold() -> None:
    modes = solve_modes_near(membrane("rectangle"), 9.7, 10, cache=False)
    known = exact("rectangle", 1100)
    assert modes.first > 800
    near = known[modes.first - 1 : modes.first + 9]
    assert np.all(np.abs(modes.frequency - near) <= modes.frequency_error)
    assert np.all(modes.frequency_error < 1e-3 * near)


def test_errors_of_nonlinearity_are_known_for_every_high_mode() -> None:
    found = solve_nonlinearity(solve_modes(membrane("circle"), 120, cache=False), cache=False)
    assert np.all(np.isfinite(found.alpha_error))


@pytest.mark.parametrize("resolution", [0.1, 0.5])
def test_high_modes_are_certified_at_low_resolutions_too(resolution: float) -> None:
    modes = solve_modes(membrane("square"), 100, resolution=resolution, cache=False)
    known = exact("square", 100)
    held = np.abs(modes.frequency - known) <= modes.frequency_error
    assert held.mean() >= 0.99
    assert np.all(modes.frequency_error < 2e-2 * known)


@pytest.mark.parametrize(
    ("count", "resolution"),
    [
        (36, 1.0),
        (36, 2.0),
        (40, 1.5),
        (100, 1.5),
        pytest.param(200, 2.0, marks=pytest.mark.slow),
    ],
)
def test_no_mode_of_a_multiple_frequency_is_missed(count: int, resolution: float) -> None:
    """(1,7), (7,1) and (5,5) have one frequency and lie in one class of symmetry."""
    film = replace(load("square-270um"), bending=False)
    known = exact("square", count)
    modes = solve_modes(film, count, resolution=resolution, cache=False)
    assert modes.ratio == pytest.approx(known / known[0], rel=1e-5)


@pytest.fixture(scope="module")
def six() -> tuple[Modes, Modes]:
    """Modes, and the same of which the fifth has no counterpart at a lower degree."""
    modes = solve_modes(membrane("circle"), 6, cache=False)
    assert modes.coarse is not None
    frequency = modes.coarse.frequency.copy()
    frequency[4] = np.nan
    return modes, replace(modes, coarse=replace(modes.coarse, frequency=frequency))


def test_a_mesh_on_which_a_mode_has_no_counterpart_is_refined(six: tuple[Modes, Modes]) -> None:
    whole, lost = six
    tried = []

    def solve(resolution: float) -> Modes:
        tried.append(resolution)
        return lost if resolution < 1.5 else whole

    assert certified(membrane("circle"), solve, 1.0) is whole
    np.testing.assert_allclose(tried, [1.0, 1.4, 1.96])


def test_modes_that_no_mesh_certifies_are_refused_with_the_number_of_those_before(
    six: tuple[Modes, Modes],
) -> None:
    message = r"circle: 6 modes: mode 5 has no counterpart .* the first 4 modes are certified: "
    with pytest.raises(ConvergenceError, match=message + "ask for at most 4, or for a finer"):
        certified(membrane("circle"), lambda _: six[1], 1.0)

    def until_memory_ends(resolution: float) -> Modes:
        if resolution > 1:
            raise ParameterError("no memory")
        return six[1]

    with pytest.raises(ConvergenceError, match=message + r".*4 \(a finer mesh .* no memory\)"):
        certified(membrane("circle"), until_memory_ends, 1.0)
