"""Error bars of small perforated films.

Low degrees err alike there before their stress is resolved.
"""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.device.mesh import mesh
from femnl.mechanics.modes import solve_modes as solve_at_degree
from femnl.mechanics.prestress import solve_prestress
from femnl.pipeline import solve_modes
from tests.physics.error_battery import QUANTITIES, Film, finer_modes, measure
from tests.physics.small_films import film, perforated

Array = NDArray[np.float64]


@pytest.mark.parametrize(("n_x", "n_y"), [(3, 4), pytest.param(4, 4, marks=pytest.mark.slow)])
def test_ratios_of_a_tiny_array_without_bending_are_within_their_error_bars(
    n_x: int, n_y: int
) -> None:
    small = Film("array", film(n_x, n_y, bending=False))
    modes = solve_modes(small.model, 6, cache=False)
    finer = finer_modes(small, modes)
    error = np.abs(modes.ratio[1:] - finer.ratio[1:])
    assert np.all(modes.ratio_error[1:] >= error)
    # A ratio keeps the share of its frequencies' bars that it usually changes by, and `UNLIKE` of
    # them besides, which is the lesser: its bar is at most twice as wide as theirs.
    width = modes.frequency_error / np.abs(modes.frequency - finer.frequency)
    assert np.median(modes.ratio_error[1:] / error) < 2 * np.median(width)
    # Theirs are half of the last difference around holes, and no more where each degree gains more
    # than a digit.
    assert modes.coarse is not None
    last = np.abs(modes.frequency - modes.coarse.frequency)
    assert np.all(modes.frequency_error < 0.51 * last)
    relative = modes.frequency_error / modes.frequency
    # Modes do err alike, in part
    assert np.all(modes.ratio_error[1:] / modes.ratio[1:] < 0.3 * (relative[1:] + relative[0]))


@pytest.mark.parametrize(
    ("n_x", "n_y", "margin", "radius", "taper", "bending"),
    [
        (2, 4, 4.95e-6, 0.805e-6, 31.8e-9, False),
        (2, 2, 4.4e-6, 1.48e-6, 60e-9, False),
        (3, 3, 4.4e-6, 1.85e-6, 59e-9, True),
    ],
)
def test_bars_of_tapered_films_hold_though_the_foot_of_the_taper_runs_through_elements(
    n_x: int, n_y: int, margin: float, radius: float, taper: float, bending: bool
) -> None:
    # With the quadrature of even films errors of the first two were up to 33 times their bars, and
    # not seen in the differences.
    tapered = film(n_x, n_y, margin, radius, bending, taper)
    modes = solve_modes(tapered, 4, cache=False)
    known = solve_at_degree(solve_prestress(mesh(tapered, resolution=2.5), 4), 4, 4).frequency
    assert np.all(np.abs(modes.frequency - known) <= modes.frequency_error)
    assert np.all(modes.frequency_error < 1e-4 * modes.frequency)


WIDE = (
    "the largest value of a shape between holes settles unevenly: the median of bar over "
    "error is 15"
)


@cache
def measured() -> list[dict[str, tuple[Array, Array]]]:
    """Bars and errors of films by a seed on which no constant of the bars was chosen."""
    return [measure(one) for one in perforated(40, 41)]


def bars_and_errors(quantity: str) -> tuple[Array, Array]:
    bars, errors = (np.concatenate([one[quantity][k] for one in measured()]) for k in (0, 1))
    return bars, errors


@pytest.mark.slow
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_99_in_100_error_bars_hold_on_forty_perforated_films(quantity: str) -> None:
    bars, errors = bars_and_errors(quantity)
    assert np.mean(bars >= errors) >= 0.99


@pytest.mark.slow
@pytest.mark.parametrize(
    "quantity",
    [
        pytest.param(name, marks=pytest.mark.xfail(reason=WIDE)) if name == "m_eff" else name
        for name in QUANTITIES
    ],
)
def test_error_bars_of_forty_perforated_films_are_not_far_too_large(quantity: str) -> None:
    bars, errors = bars_and_errors(quantity)
    assert np.median(bars / np.maximum(errors, 1e-13)) < 10
