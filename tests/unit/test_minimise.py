"""Fits see triangles in the place of all residuals, and end where these would lead them."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.fits.minimise import minimise
from femnl.fits.tangents import steps_for
from femnl.fits.triangle import Triangle
from femnl.observe.extended import ExtendedModel
from tests.unit.level import Level, bump

N = 300
X = np.linspace(-1, 1, N)
HALF = 20.0
SEED = 5


BUMP = bump(X, HALF)
LIFTED = {"size": 6.0, "place": 0.2, "width": 0.3}
MODEL = ExtendedModel(
    Level(
        BUMP.changes["placement"](np.full(N, 1.0), LIFTED)
        + np.random.default_rng(SEED).standard_normal(N),
        np.arange(N) * 4 // N,
        HALF,
    ),
    (BUMP,),
)
START = np.array([0.0, 1.0, 0.0, 0.5])


@pytest.mark.parametrize("left_out", [0, 3])
def test_a_fit_ends_where_one_that_sees_all_residuals_does(left_out: int) -> None:
    keep = MODEL.base_model.blocks != left_out
    end, _ = minimise(MODEL, START, keep, 100, steps_for(MODEL, np.zeros(4)))
    low, high = MODEL.bounds

    def all_rows(vector: Array) -> Array:
        return np.asarray(MODEL.residuals(vector)[keep])

    direct = least_squares(all_rows, START, bounds=(low, high), x_scale="jac", xtol=1e-12)
    reached = float(np.sum(MODEL.residuals(end)[keep] ** 2))
    assert reached == pytest.approx(2 * direct.cost, rel=1e-7)
    np.testing.assert_allclose(end, direct.x, atol=1e-3)


def valley(value: Array, values: Values) -> Array:
    """H. H. Rosenbrock's valley, Computer Journal 3, 175 (1960), along which χ² falls slowly."""
    x, y = values["x"], values["y"]
    return np.asarray(value + np.pad([10 * (y - x * x), 1 - x], (0, N - 2)))


def test_a_fit_that_is_not_worth_more_ends_in_a_slow_valley() -> None:
    level = Level(np.zeros(N), np.zeros(N, np.int64), HALF)
    parameters = (ParameterSpec("x", "1", -5, 5), ParameterSpec("y", "1", -5, 5))
    model = ExtendedModel(
        level, (Effect("valley", "", parameters, {"placement": valley}, "", "", ""),)
    )
    start = np.array([0.0, -1.2, 1.0])
    left = [
        float(np.sum(model.residuals(end) ** 2))
        for worth in (np.inf, 1e-6)
        for end, _ in [
            minimise(model, start, None, 100, steps_for(model, np.zeros(3)), worth=worth)
        ]
    ]
    assert left[0] < 1e-6
    assert left[1] > 1


@pytest.mark.parametrize("count", [0, 3, 10_000])
def test_the_triangle_of_any_rows_has_their_squares(count: int) -> None:
    """There are none where a block that is left out holds all data."""
    rows = np.random.default_rng(SEED).standard_normal((count, 4))
    triangle = Triangle(lambda _: rows[:, 3], lambda _: rows[:, :3])
    here = np.zeros(3)
    residuals = triangle.residuals(here)
    found = np.column_stack([triangle.slopes(here), residuals])
    np.testing.assert_allclose(found.T @ found, rows.T @ rows, rtol=1e-10, atol=1e-8)


def test_a_triangle_has_the_square_and_the_gradient_of_all_residuals() -> None:
    """Of r = (x² − 4, xy, y − 3, 1), whose slopes are known in closed form."""
    triangle = Triangle(
        lambda v: np.array([v[0] ** 2 - 4, v[0] * v[1], v[1] - 3, 1.0]),
        lambda v: np.array([[2 * v[0], 0.0], [v[1], v[0]], [0.0, 1.0], [0.0, 0.0]]),
    )
    here = np.array([1.5, 0.5])
    shown = triangle.residuals(here)
    slopes = triangle.slopes(here)
    assert shown.shape == (3,)
    assert slopes.shape == (3, 2)
    x, y = here
    chi2 = (x**2 - 4) ** 2 + (x * y) ** 2 + (y - 3) ** 2 + 1
    assert shown @ shown == pytest.approx(chi2, rel=1e-14)
    gradient = [2 * x * (x**2 - 4) + x * y**2, x**2 * y + y - 3]
    np.testing.assert_allclose(slopes.T @ shown, gradient, rtol=1e-13)
    curvature = [[4 * x**2 + y**2, x * y], [x * y, x**2 + 1]]
    np.testing.assert_allclose(slopes.T @ slopes, curvature, rtol=1e-13)


def test_where_chi2_did_not_fall_a_triangle_stays_and_nothing_looks_better() -> None:
    triangle = Triangle(
        lambda v: np.array([v[0] ** 2, 1.0, 1.0]), lambda v: np.array([[2 * v[0]], [0.0], [0.0]])
    )
    best = triangle.residuals(np.array([0.5]))
    slopes = triangle.slopes(np.array([0.5]))
    for other in (0.7, -0.5, 1e8):
        seen = triangle.residuals(np.array([other]))
        assert seen @ seen >= best @ best
        assert seen @ seen == pytest.approx(other**4 + 2)
        np.testing.assert_array_equal(triangle.slopes(np.array([0.5])), slopes)
        np.testing.assert_array_equal(triangle.residuals(np.array([0.5])), best)
    lower = triangle.residuals(np.array([0.1]))
    assert lower @ lower == pytest.approx(2.0001)
    assert abs(triangle.slopes(np.array([0.1]))[0, 0]) == pytest.approx(0.2)
