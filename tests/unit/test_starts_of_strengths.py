"""Starts of a strength that may grow further on one side of zero than on the other."""

import numpy as np
import pytest

from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.diagnose.multistart import extended
from femnl.diagnose.part_of_data import best_in_all
from femnl.fits.least_squares import fit
from femnl.observe.extended import ExtendedModel
from tests.unit.level import Level

PLACE = np.linspace(0, 1, 40)


def wane(level: Array, values: Values) -> Array:
    """Divide by what must stay above zero."""
    below = 1 + values["loss"] * PLACE
    assert below.min() > 0
    return np.asarray(level / below)


WANE = Effect("wane", "", (ParameterSpec("loss", "1", -0.9, 1e5),), {"placement": wane}, "", "", "")


@pytest.mark.parametrize("loss", [-0.5, 0.3, 300.0])
def test_no_start_lies_beyond_the_bound_of_its_side(loss: float) -> None:
    noise = np.random.default_rng(1).standard_normal(40)
    data = 1e3 / (1 + loss * PLACE) + noise
    base = ExtendedModel(Level(data, np.arange(40) // 10, 1e4))
    before = fit(base, base.base_model.start)
    found = best_in_all(extended(before, WANE, [{"loss": np.sign(loss) * 1e-9}]), before)
    assert found.vector[1] == pytest.approx(loss, rel=0.03)
    assert found.chi2 < 60
