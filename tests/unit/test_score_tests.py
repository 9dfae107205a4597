"""Score tests of effects with shapes, and what is kept of them."""

from typing import Any

import numpy as np
import pytest

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose import criticism
from femnl.diagnose.criticism import criticise
from femnl.diagnose.score_test import ScoreTest
from femnl.diagnose.score_tests import score_tests
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
    beside: tuple[Effect, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Directions of a large map take a fifth of a gigabyte, and are asked for by p-values alone."""
    result = narrow_peak(*beside)
    lean = score_tests(result, [BUMP, BEND], starts_alone=True)
    assert 3 < sum(len(test.basis) > 0 for test in lean) < 12 < len(lean)
    asked = []

    def made(*given: Any, **options: Any) -> list[ScoreTest]:
        asked.append(options["starts_alone"])
        return score_tests(*given, **options)

    monkeypatch.setattr(criticism, "score_tests", made)
    found = criticise(result, [BUMP, BEND])
    monkeypatch.setattr(criticism, "is_refuted", lambda *given: False)
    whole = criticise(result, [BUMP, BEND])
    assert asked == [True, False]
    assert (found.p_value, found.worst) == (whole.p_value, whole.worst)
    assert found.pointers == whole.pointers
    assert [len(pointer.shapes) for pointer in found.pointers or ()] == [4, 4]
