"""Error bars of annuli, single holes, notches and elliptical holes, drawn by a seed."""

import numpy as np
import pytest

from tests.physics.drawn_films import drawn
from tests.physics.error_battery import QUANTITIES, measure


@pytest.mark.slow
def test_99_in_100_error_bars_hold_on_28_drawn_films() -> None:
    found = [measure(film) for film in drawn(28, 24)]
    for quantity in QUANTITIES:
        bars, errors = (np.concatenate([one[quantity][k] for one in found]) for k in (0, 1))
        assert np.mean(bars >= errors) >= 0.99, quantity
