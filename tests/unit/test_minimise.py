"""The optimiser sees triangles in the place of all residuals, and ends where they would lead it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import OptimizeResult, least_squares

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.fits import minimise as module
from femnl.fits.minimise import minimise
from femnl.fits.tangents import steps_for
from femnl.observe.extended import ExtendedModel
from tests.unit.level import Level

N = 300
X = np.linspace(-1, 1, N)
HALF = 20.0
SEED = 5


def bump(value: Array, values: Values) -> Array:
    """Something of a size, at a place, of a width."""
    return np.asarray(
        value + values["size"] * np.exp(-(((X - values["place"]) / values["width"]) ** 2))
    )


MODEL = ExtendedModel(
    Level(
        bump(np.full(N, 1.0), {"size": 6.0, "place": 0.2, "width": 0.3})
        + np.random.default_rng(SEED).standard_normal(N),
        np.arange(N) * 4 // N,
        HALF,
    ),
    (
        Effect(
            "bump",
            "",
            (
                ParameterSpec("size", "1", -HALF, HALF),
                ParameterSpec("place", "1", -1, 1, False),
                ParameterSpec("width", "1", 0.05, 1, False),
            ),
            {"placement": bump},
            "",
            "",
            "",
        ),
    ),
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


def test_a_triangle_has_the_square_and_the_gradient_of_all_residuals(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And no place where χ² did not fall looks better than the one before."""
    low, high = MODEL.bounds

    def chi2(part: Array) -> float:
        return float(np.sum(MODEL.residuals(low + (high - low) * part) ** 2))

    seen = []

    def solve(
        residuals: Callable[[Array], Array],
        part: Array,
        jac: Callable[[Array], Array],
        **options: Any,
    ) -> OptimizeResult:
        here = residuals(part)
        assert here.shape == (5,)
        assert here @ here == pytest.approx(chi2(part), rel=1e-12)
        steps = 1e-6 * np.eye(4)
        gradient = [(chi2(part + h) - chi2(part - h)) / 2e-6 for h in steps]
        slopes = jac(part)
        np.testing.assert_allclose(2 * slopes.T @ here, gradient, rtol=0.01)  # from one side
        worse = residuals(np.array([0.9, 0.1, 0.9, 0.5]))
        assert worse @ worse > here @ here
        np.testing.assert_array_equal(jac(part), slopes)  # those of the place that is gone on from
        np.testing.assert_array_equal(residuals(part), here)
        assert jac(part).shape == (5, 4)
        seen.append(part)
        return least_squares(residuals, part, jac=jac, **options)

    monkeypatch.setattr(module, "least_squares", solve)
    minimise(MODEL, START, None, 100, steps_for(MODEL, np.zeros(4)))
    assert seen
