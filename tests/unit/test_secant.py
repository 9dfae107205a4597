"""Derivatives that are carried on spare evaluations and lead a fit to the same minimum."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.optimize import least_squares

from femnl.core.effect import Effect, Values
from femnl.core.readout import Array
from femnl.fits.minimise import FTOL, XTOL, minimise
from femnl.fits.secant import MANY, STRAIGHT, Place, carried_on
from femnl.fits.tangents import steps_for
from femnl.observe.extended import ExtendedModel
from tests.unit.level import Level, bump

N = 400
X = np.linspace(-1, 1, N)
SEED = 11
RNG = np.random.default_rng(SEED)
SLOPES = RNG.standard_normal((N, 3)) * (1.0, 1e-6, 1e6)
HERE = np.array([1.0, 2e6, -3e-6])
THERE = HERE + np.array([0.1, -2e5, 4e-7])


def test_along_a_line_derivatives_stay() -> None:
    last = Place(HERE, SLOPES @ HERE, SLOPES)
    found = carried_on(last, THERE, SLOPES @ THERE)
    assert found is not None
    np.testing.assert_allclose(found * HERE, SLOPES * HERE, atol=1e-9)


def test_carried_on_they_give_the_change_that_a_step_made_whatever_the_units() -> None:
    """Those of other units are the same ones, and nothing changes across the step."""
    bent = SLOPES @ THERE + 0.9 * STRAIGHT * np.linalg.norm(SLOPES @ (THERE - HERE)) / N**0.5
    found = carried_on(Place(HERE, SLOPES @ HERE, SLOPES), THERE, bent)
    assert found is not None
    np.testing.assert_allclose(found @ (THERE - HERE), bent - SLOPES @ HERE, atol=1e-8)
    units = np.array([1e3, 1e-6, 1e6])
    other = Place(HERE / units, SLOPES @ HERE, SLOPES * units)
    in_units = carried_on(other, THERE / units, bent)
    assert in_units is not None
    np.testing.assert_allclose(in_units, found * units, rtol=1e-9, atol=1e-9 * abs(in_units).max())
    weight = np.sum(SLOPES**2, axis=0) * (THERE - HERE)
    across = np.array([weight[1], -weight[0], 0.0]) / abs(weight).max()
    np.testing.assert_allclose(
        found @ across, SLOPES @ across, atol=1e-8 * abs(SLOPES @ across).max()
    )


@pytest.mark.parametrize(
    ("rows", "bend"), [(MANY - 1, 0.0), (N, 1.1), (N, np.nan)], ids=["few", "bent", "no number"]
)
def test_they_are_not_carried_on(rows: int, bend: float) -> None:
    slopes = SLOPES[:rows]
    step = np.linalg.norm(slopes @ (THERE - HERE))
    residuals = slopes @ THERE + bend * STRAIGHT * step / rows**0.5
    assert carried_on(Place(HERE, slopes @ HERE, slopes), THERE, residuals) is None


def test_what_is_not_fitted_does_not_tell_whether_the_way_is_straight() -> None:
    fitted = np.arange(2 * N) < N
    slopes = np.vstack([SLOPES, 100 * SLOPES])
    residuals = slopes @ THERE
    residuals[fitted] += 2 * STRAIGHT * np.linalg.norm(SLOPES @ (THERE - HERE)) / N**0.5
    last = Place(HERE, slopes @ HERE, slopes)
    assert carried_on(last, THERE, residuals) is not None
    assert carried_on(last, THERE, residuals, fitted) is None


def test_where_nothing_changed_they_are_not_carried_on() -> None:
    at = SLOPES @ HERE
    assert carried_on(Place(HERE, at, SLOPES), HERE, at) is None


class Counted(Level):
    """A level that counts how often it is asked for its residuals."""

    asked = 0

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        self.asked += 1
        return super().residuals(effects, base, values)


BUMP = bump(X, 500.0)
UNKNOWN = 60 * np.sin(9 * X) + RNG.standard_normal(N)
LIFTED = BUMP.changes["placement"](np.full(N, 1.0), {"size": 200.0, "place": 0.2, "width": 0.3})
START = np.array([0.0, 150.0, 0.1, 0.4])


def test_beside_a_large_misfit_a_fit_ends_where_differences_lead_with_fewer_of_them() -> None:
    level = Counted(LIFTED + UNKNOWN, np.arange(N) * 4 // N, 500.0)
    model = ExtendedModel(level, (BUMP,))
    low, high = model.bounds
    reached = []
    asked = []
    for tolerance in (1e-14, FTOL):
        level.asked = 0
        direct = least_squares(
            model.residuals, START, bounds=(low, high), x_scale="jac", xtol=XTOL, ftol=tolerance
        )
        asked.append(level.asked)
        reached.append(2 * direct.cost)
    least, _ = reached
    assert least > 100 * N
    level.asked = 0
    end, _ = minimise(model, START, None, 100, steps_for(model, np.zeros(4)))
    assert level.asked < asked[1]
    assert float(np.sum(model.residuals(end) ** 2)) == pytest.approx(least, rel=1e-6)
