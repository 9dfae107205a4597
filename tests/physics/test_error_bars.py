"""Error bars: upper estimates of true errors, and not far too large.

Tolerances that are met, or said to be out of reach.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.core.device import Model
from femnl.core.discretisation_error import MOST, remainder
from femnl.core.errors import ConvergenceError, ParameterError
from femnl.core.modes import Modes
from femnl.core.outline import Holes
from femnl.device.geometry import load
from femnl.pipeline import solve_modes, solve_modes_to, solve_nonlinearity
from tests.physics.error_battery import QUANTITIES, Film, films, measure, outline, stiff

Array = NDArray[np.float64]
Device = Callable[..., Model]

QUICK = (
    "square, coarse",
    "rectangle",
    "circle, coarse",
    "hexagon, coarse",
    "quadrangle, stiff",
    "square, holes, coarse",
)
HEXAGON = 7.155339133926055  # λ₁ of side 1: Jones, Adv. Comput. Math. 43, 1325 (2017)


def shares(battery: list[Film]) -> dict[str, tuple[float, float]]:
    """By quantity, how many error bars hold, and the median of bar over error."""
    found = [measure(film) for film in battery]
    result = {}
    for quantity in QUANTITIES:
        bars, errors = (np.concatenate([one[quantity][k] for one in found]) for k in (0, 1))
        result[quantity] = (
            float(np.mean(bars >= errors)),
            float(np.median(bars / np.maximum(errors, 1e-13))),
        )
    return result


@pytest.mark.slow
def test_error_bars_hold_on_films_with_references() -> None:
    for quantity, (held, over) in shares([film for film in films() if film.name in QUICK]).items():
        assert held == 1, quantity
        assert over < 100, quantity


@pytest.mark.slow
def test_99_in_100_error_bars_hold_on_fifty_films() -> None:
    battery = films()
    assert len(battery) >= 50
    found = shares(battery)
    assert all(held >= 0.99 for held, _ in found.values()), found
    assert all(over < 10 for _, over in found.values()), found


def sequence(pace: float) -> list[Array]:
    """1 + pace⁰, 1 + pace, 1 + pace², finest first: geometric convergence to 1 of errors 1e-3."""
    return [np.full(3, 1 + 1e-3 * pace**k) for k in (2, 1, 0)]


@pytest.mark.parametrize("pace", [0.03, 0.1, 0.3])
def test_the_remainder_of_geometric_convergence_is_bounded_and_not_far_off(pace: float) -> None:
    bar = remainder(sequence(pace), np.ones(3), 0.0)
    assert np.all(bar >= 1e-3 * pace**2)
    assert np.all(bar <= 5e-3 * pace**2 + 1e-10)


def test_without_convergence_three_times_the_last_difference_is_left() -> None:
    values = [np.array([1.0, 2.0]), np.array([1.1, 2.2]), np.array([1.0, 2.0])]
    np.testing.assert_allclose(
        remainder(values, np.array([1.0, 2.0]), 0.0), MOST * np.array([0.1, 0.2]), rtol=1e-9
    )


def test_a_number_that_agrees_by_chance_takes_its_share_from_the_others() -> None:
    values = sequence(0.1)
    values[1][0] = values[0][0]
    bar = remainder(values, np.ones(3), 0.0)
    assert bar[0] >= 0.2 * bar[1] > 0


def test_the_pace_of_a_number_that_settles_unlike_the_others_lies_halfway_in_the_logarithm() -> (
    None
):
    # Nine that fall a hundredfold, and one as large that falls fourfold: the bar is 5 √(own × usual
    # pace) of its last difference.
    last = np.full(10, 1e-5)
    before = np.array([1e-3] * 9 + [4e-5])
    values = [np.ones(10), 1 + last, 1 + last + before]
    usual = 1e-5 / np.sqrt(np.mean(before**2))
    bar = remainder(values, np.ones(10), 0.0)
    assert bar[9] == pytest.approx(5 * np.sqrt(0.25 * usual) * 1e-5, rel=1e-4)
    assert bar[0] == pytest.approx(5 * np.sqrt(0.01 * usual) * 1e-5, rel=1e-4)


def test_missing_approximations_leave_an_infinite_or_a_cautious_bar() -> None:
    fine, coarse, coarsest = sequence(0.1)
    np.testing.assert_array_equal(
        remainder([fine, np.full(3, np.nan), coarsest], np.ones(3), 0.0), np.inf
    )
    lost = np.array([np.nan, coarsest[1], coarsest[2]])
    bar = remainder([fine, coarse, lost], np.ones(3), 0.0)
    assert bar[0] == pytest.approx(MOST * abs(fine[0] - coarse[0]), rel=1e-3)


def exact(modes: Modes) -> Array:
    """√(m² + n²)/2, the frequencies of a square film of side 1 m and wave speed 1 m/s."""
    return np.sort([np.hypot(m, n) / 2 for m in range(1, 6) for n in range(1, 6)])[
        : len(modes.frequency)
    ]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-9])
def test_a_tolerance_is_met_in_truth(tolerance: float) -> None:
    modes = solve_modes_to(outline("square"), tolerance, 4, cache=False)
    assert np.all(modes.frequency_error <= tolerance * modes.frequency)
    assert np.all(modes.ratio_error <= tolerance * modes.ratio)
    np.testing.assert_allclose(modes.frequency, exact(modes), rtol=tolerance)


def test_the_hexagons_first_eigenvalue_comes_to_ten_digits_in_seconds() -> None:
    modes = solve_modes_to(outline("hexagon"), 4e-11, 1, cache=False)
    assert (2 * np.pi * modes.frequency[0]) ** 2 == pytest.approx(HEXAGON, rel=5e-11)


def test_a_tolerance_below_rounding_is_refused() -> None:
    with pytest.raises(
        ParameterError, match="tolerance = 1e-15: expected a relative error from 2e-11"
    ):
        solve_modes_to(outline("square"), 1e-15)


@pytest.mark.slow
def test_a_tolerance_is_met_where_bending_dominates() -> None:
    """Entries of K are 1e10 times ω²M there: their rounding left 5e-9 from mesh to mesh."""
    film = stiff(outline("square"), 1.0)
    modes = solve_modes_to(film, 3e-10, 1, cache=False)
    finer = solve_modes(film, 1, resolution=2.2, degree=6, cache=False)
    assert finer.frequency_error[0] < 1.2e-10 * finer.frequency[0]
    assert abs(modes.frequency[0] - finer.frequency[0]) <= modes.frequency_error[0]


def test_a_tolerance_that_rounding_forbids_says_how_far_it_came() -> None:
    with pytest.raises(
        ConvergenceError,
        match=r"relative error of \d\.\de-11 \(mode \d+\), which degree 6 .* no longer",
    ):
        solve_modes_to(outline("circle"), 2e-11, 20, cache=False)


def test_a_tolerance_that_needs_more_memory_than_there_is_says_how_far_it_came(
    allow_memory: Callable[[int], None],
) -> None:
    allow_memory(6 * 2**20)  # enough for the first mesh
    with pytest.raises(
        ConvergenceError,
        match=r"stopped at a relative error of .*e-\d+, because .* and this process may take "
        r"0\.0059 GiB",
    ):
        solve_modes_to(stiff(outline("square"), 0.1), 1e-10, 1, cache=False)


def test_error_bars_come_without_lower_degrees_as_infinity() -> None:
    modes = replace(solve_modes(outline("square"), 2, resolution=0.5, cache=False), coarse=None)
    assert np.all(np.isinf(modes.frequency_error))
    assert np.all(np.isinf(solve_nonlinearity(modes, cache=False).alpha_error))


@pytest.mark.slow
def test_where_two_degrees_less_are_too_crude_it_is_said_and_the_error_bars_hold_all_the_more(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = load("square-270um-perforated")
    line = 8.56e-6 * (np.arange(10) - 4.5)
    centres = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    film = replace(model, holes=Holes(centres, 0.4e-6))
    with monkeypatch.context() as crude:
        # Nine curved edges around a hole: meshes of coarse resolutions no longer are so crude
        crude.setattr("femnl.device.mesh.grading.HOLE_SEGMENTS", 9)
        crude.setattr("femnl.device.mesh.grading.HOLE_GROWTH", 4 / 3)
        crude.setattr("femnl.device.mesh.grading.GROWTH", 0.7 * 4 / 3)
        modes = solve_modes(film, 4, resolution=0.6, cache=False)
    assert len(modes.grades) == 2, "degree 2 has become able to solve this film; find another"
    assert "degree 2 is too crude for this mesh" in caplog.text
    finer = solve_modes(film, 4, resolution=1.0, cache=False, degree=5)
    error = np.abs(modes.frequency - finer.frequency)
    assert np.all(finer.frequency_error < 0.3 * error)
    assert np.all(error < modes.frequency_error)
    assert np.all(modes.frequency_error < 5e-4 * modes.frequency)
