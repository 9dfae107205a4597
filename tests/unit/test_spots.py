"""The average over a laser spot.

Of smooth signals in closed form, of kinks and on uneven grids, and down to no spot at all.
"""

import numpy as np
import pytest
from scipy.special import erf

from femnl.core.readout import Array
from femnl.observe.map.spots import REACH, Axis, Finer, Grid

WIDE = np.linspace(-1.6e-4, 1.6e-4, 41)


def kinked(x: Array, sd: float) -> Array:
    """max(x, 0) averaged over a Gaussian."""
    root = x / (np.sqrt(2) * sd)
    return np.asarray(x * (1 + erf(root)) / 2 + sd / np.sqrt(2 * np.pi) * np.exp(-(root**2)))


@pytest.mark.parametrize("sd", [2e-7, 1e-6, 3e-6, 7e-6])
def test_a_wave_is_damped_as_a_gaussian_damps_it(sd: float) -> None:
    axis = Axis.beside(WIDE)
    k = 2 * np.pi / 5e-5
    inner = np.abs(WIDE) < 1e-4
    step = np.diff(axis.nodes).max()
    damped = axis.spread(sd) @ np.cos(k * axis.nodes)
    np.testing.assert_allclose(
        damped[inner],
        (np.exp(-((k * sd) ** 2) / 2) * np.cos(k * WIDE))[inner],
        atol=(k * sd * k * step) ** 2 / 20,
    )


@pytest.mark.parametrize("sd", [1.5e-6, 3e-6, 7e-6])
def test_the_kink_at_a_film_s_edge_is_rounded_as_a_gaussian_rounds_it(sd: float) -> None:
    axis = Axis.beside(WIDE)
    for edge in np.linspace(0, 8e-6, 9):
        rounded = axis.spread(sd) @ np.maximum(axis.nodes - edge, 0)
        inner = np.abs(WIDE) < 1e-4
        # Steps of 2 µm
        assert np.abs(rounded - kinked(WIDE - edge, sd))[inner].max() < 0.08 * (2e-6) ** 2 / sd


def test_uneven_steps_and_their_order_change_nothing() -> None:
    rng = np.random.default_rng(1)
    points = rng.permutation(np.cumsum(rng.uniform(4e-6, 9e-6, 40)))
    found = Axis.beside(points).spread(5e-6) @ np.sin(Axis.beside(points).nodes / 2e-5)
    inner = (points > 4e-5) & (points < points.max() - 4e-5)
    exact = np.exp(-((5e-6 / 2e-5) ** 2) / 2) * np.sin(points / 2e-5)
    np.testing.assert_allclose(found[inner], exact[inner], atol=2e-3)


def test_without_a_spot_each_point_is_its_own_and_a_single_one_is_averaged_too() -> None:
    axis = Axis.beside(WIDE)
    np.testing.assert_allclose(axis.spread(0.0), np.eye(len(axis.nodes))[axis.place], atol=1e-12)
    assert axis.nodes[axis.place] == pytest.approx(WIDE, abs=1e-15)
    alone = Axis.beside(np.array([3e-6]))
    assert alone.spread(4e-6) @ (alone.nodes - 3e-6) ** 2 == pytest.approx((4e-6) ** 2, rel=0.05)
    assert alone.nodes[[0, -1]] - 3e-6 == pytest.approx([-REACH, REACH], abs=3e-6)


def test_the_average_over_a_map_is_taken_along_both_axes_at_its_own_points() -> None:
    x = np.linspace(0, 1e-4, 21)
    y = np.linspace(0, 6e-5, 13)
    finer = Finer(Axis.beside(x), Axis.beside(y))
    at = Grid(x[[10, 9]], y[[6, 7]], np.array([6, 7]), np.array([10, 9]), (13, 21))
    volts = ((finer.grid.x - 5e-5) ** 2 + 1j * (finer.grid.y - 3e-5) ** 2)[None]
    found = finer.average(volts, 3e-6, at)[0]
    np.testing.assert_allclose(found.real, (at.x - 5e-5) ** 2 + 9e-12, rtol=1e-3)
    np.testing.assert_allclose(found.imag, (at.y - 3e-5) ** 2 + 9e-12, rtol=1e-3)


def test_a_map_of_very_close_points_needs_no_more_nodes_beyond_it_than_any_other() -> None:
    points = np.linspace(0, 1e-6, 101)
    axis = Axis.beside(points)
    assert len(axis.nodes) < len(points) + 2 * (REACH / 2e-6 + 1)
    found = axis.spread(4e-6) @ (axis.nodes / 1e-5) ** 2
    np.testing.assert_allclose(found, (points / 1e-5) ** 2 + 0.16, rtol=1e-5)
