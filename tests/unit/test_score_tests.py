"""Score tests of effects with shapes, and what is kept of them."""

import numpy as np
import pytest

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.adequacy import Adequacy, is_refuted
from femnl.diagnose.criticism import MANY, criticise
from femnl.diagnose.score_tests import SHAPES, promising, score_tests, unlike
from femnl.fits.least_squares import FitResult, fit
from femnl.observe.extended import ExtendedModel
from tests.unit.level import Level

N = 48
X = np.linspace(-1, 1, N)
BLOCKS = np.arange(N) * 4 // N
HALF = 30.0
"""Half of the range of every parameter."""
SIZE = ParameterSpec("size", "1", -HALF, HALF)
PLACE = ParameterSpec("place", "1", -1.0, 1.0, strength=False)
NUMBER = ParameterSpec("number", "", 1.0, 3.0, strength=False, whole=True)


class Map(Level):
    """Data whose neighbours tell their noise."""

    tells_noise = True


def bump(value: Array, values: Values) -> Array:
    return np.asarray(value + values["size"] * np.exp(-(((X - values["place"]) / 0.3) ** 2)))


def bend(value: Array, values: Values) -> Array:
    phase = np.pi * values["number"] * X + values["place"]
    return np.asarray(value + values["size"] * np.cos(phase))


def slope(value: Array, values: Values) -> Array:
    return np.asarray(value + values["size"] * X)


BUMP = Effect("bump", "", (SIZE, PLACE), {"placement": bump}, "", "", "")
BEND = Effect("bend", "", (SIZE, PLACE, NUMBER), {"placement": bend}, "", "", "")
SLOPE = Effect("slope", "", (SIZE,), {"placement": slope}, "", "", "")


def narrow_peak(*effects: Effect) -> FitResult:
    """Return a fit that misses a peak of 40σ."""
    data = 40 * np.exp(-(((X - 0.3) / 0.2) ** 2)) + np.random.default_rng(9).standard_normal(N)
    model = ExtendedModel(Map(data, BLOCKS, HALF, {"halves": np.sign(X)}), effects)
    return fit(model, model.pack({"level": 0.0}, [{"size": 0.1}] * len(effects)))


@pytest.mark.parametrize("beside", [(), (SLOPE,)])
def test_a_clearly_refuted_model_points_to_the_same_starts_without_the_directions_of_others(
    beside: tuple[Effect, ...],
) -> None:
    """Directions of a large map take a fifth of a gigabyte, and are asked for by p-values alone."""
    result = narrow_peak(*beside)
    assert is_refuted(result, MANY)
    lean, whole = (score_tests(result, [BUMP, BEND], starts_alone=alone) for alone in (True, False))
    assert 3 < sum(len(test.basis) > 0 for test in lean) < 12 < len(lean)
    assert all(len(test.basis) > 0 for test in whole)
    assert Adequacy(result, lean).p_value() == Adequacy(result, whole).p_value()
    for effect in (BUMP, BEND):
        few, all_of_them = (
            unlike([test for test in promising(result, found) if test.effect is effect])
            for found in (lean, whole)
        )
        assert [test.values for test in few] == [test.values for test in all_of_them]
        assert len(few) == SHAPES
    found = criticise(result, [BUMP, BEND])
    assert (found.p_value, found.worst) == Adequacy(result, whole).p_value()


def test_where_one_strength_meets_its_bound_the_others_do_what_is_left() -> None:
    """Each brought back to its bound by itself would leave most of what both can do."""
    beside = X**2 - np.mean(X**2)
    few = ParameterSpec("few", "1", 0.0, 2.0)
    more = ParameterSpec("more", "1", 0.0, 10.0)

    def lift(value: Array, values: Values) -> Array:
        return np.asarray(value + values["few"] * X + values["more"] * (0.9 * X + beside))

    result = fit(ExtendedModel(Map(8 * X, BLOCKS, HALF)), np.zeros(1))
    pair = Effect("pair", "", (few, more), {"placement": lift}, "", "", "")
    (test,) = score_tests(result, [pair], patterns=False)
    few_, more_ = np.meshgrid(np.linspace(0, 2, 81), np.linspace(0, 10, 401))
    shapes = np.stack([X, 0.9 * X + beside])
    rest = result.residuals - (np.stack([few_.ravel(), more_.ravel()]).T @ shapes)
    rest -= rest.mean(axis=1, keepdims=True)
    best = result.chi2 - np.sum(rest**2, axis=1).min()
    assert test.gain == pytest.approx(best, rel=2e-3)
    most = np.argmin(np.sum(rest**2, axis=1))
    assert test.values == {
        "few": pytest.approx(2.0),
        "more": pytest.approx(float(more_.ravel()[most]), rel=0.02),
    }
