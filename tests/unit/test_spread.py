"""Points that fill a cube evenly."""

import numpy as np
import pytest
from scipy.stats import qmc

from femnl.diagnose.spread import spread

COUNT = 128


@pytest.mark.parametrize("dimensions", [1, 2, 3, 4, 6])
def test_each_slice_along_each_direction_has_one_point(dimensions: int) -> None:
    points = spread(COUNT, dimensions)
    middles = (np.arange(COUNT) + 0.5) / COUNT
    assert np.sort(points, axis=0) == pytest.approx(np.tile(middles[:, None], dimensions))


@pytest.mark.parametrize("dimensions", [2, 3, 4, 6])
def test_points_are_spread_more_evenly_than_at_random(dimensions: int) -> None:
    points = spread(COUNT, dimensions)
    by_chance = np.random.default_rng(0).random((20, COUNT, dimensions))
    least = min(qmc.discrepancy(one) for one in by_chance)
    assert qmc.discrepancy(points) < least
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    # Of the sides of a cube for each point
    assert apart[~np.eye(COUNT, dtype=bool)].min() > 0.5 * COUNT ** (-1 / dimensions)
