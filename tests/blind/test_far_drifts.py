"""A mode that drifts out of the sweeps, by hundreds of linewidths in all, is followed."""

from pathlib import Path

import numpy as np
import pytest

from femnl.diagnose.multistart import followed
from femnl.diagnose.posing import Posing
from femnl.diagnose.sent import sent
from femnl.effects import library
from femnl.fits.least_squares import fit
from femnl.observe.extended import ExtendedModel
from femnl.observe.model import MeasurementModel
from tests.blind.realistic.files import Draw, make

DRAW = Draw("response", ("frequency_drift",), "correlated noise", "square-270um", 1541494923)
"""The line, 1.7 Hz wide, leaves the sweeps of 43 Hz after the first four of sixteen. Without drift
it looks 62 Hz wide, or as if it softened, and is sought where it was late.
"""


DRIFT = library()["frequency_drift"]


def posed(path: Path) -> MeasurementModel:
    """Return the model of a file."""
    return Posing(path, None, sent([DRIFT], 1))(None)[0]


def test_a_mode_that_leaves_the_sweeps_is_followed_from_the_first_one(tmp_path: Path) -> None:
    path = tmp_path / "drift.nc"
    told = make(DRAW, path)
    model = posed(path)
    first = dict(zip([spec.name for spec in model.base], model.start, strict=True))
    width = told["base"]["linewidth"]
    assert first["frequency"] == pytest.approx(told["base"]["frequency"], abs=width)
    assert first["linewidth"] == pytest.approx(width, rel=0.1)
    np.testing.assert_array_equal(model.order_of_blocks, range(16))
    base = fit(ExtendedModel(model), model.start)
    assert base.chi2 > 100 * base.degrees
    found = followed(base, DRIFT)
    assert found is not None
    assert found.chi2 < 1.05 * found.degrees
    rate = told["causes"]["frequency_drift"]["rate"]
    assert found.vector[-1] == pytest.approx(rate, rel=1e-3)


def test_where_no_sweep_shows_another_mode_none_is_followed(tmp_path: Path) -> None:
    path = tmp_path / "still.nc"
    make(Draw("response", (), "exact", "square-270um", 3), path)
    model = posed(path)
    assert len(model.order_of_blocks) == 0
    assert followed(fit(ExtendedModel(model), model.start), DRIFT) is None
