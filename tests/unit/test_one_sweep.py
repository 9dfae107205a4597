"""A single sweep is held out in parts, as decays are: a fit to no data predicts nothing."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from femnl.diagnose.posing import Posing
from femnl.diagnose.sent import sent
from femnl.effects import library
from femnl.fits.least_squares import FitResult, fit
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.response.layout import parts_of_sweep
from femnl.observe.response.model import ResponseModel
from tests.blind.realistic.files import Draw, make

CAUSE = "sloping_background"


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[FitResult, FitResult]:
    """Fit the sweep of the strongest drive, without and with the cause that is hidden in it."""
    path = tmp_path_factory.mktemp("one") / "sweep.nc"
    make(Draw("response", (CAUSE,), "exact", "square-270um", 7), path)
    tree = measurement.read(path)
    dataset = tree["response"].to_dataset()
    last = int(np.argmax(dataset["drive"].values))
    tree["response"] = xr.DataTree(dataset.isel(sweep=[last]))
    measurement.write(tree, path)
    effect = library()[CAUSE]
    model = Posing(path, None, sent([effect], 1))(None)[0]
    bare = fit(ExtendedModel(model), model.start)
    extended = ExtendedModel(model, (effect,))
    none = {spec.name: 0.0 for spec in effect.parameters}
    return bare, fit(extended, extended.pack(bare.model.split(bare.vector)[0], [none]))


def test_each_part_of_one_sweep_lies_between_others(fitted: tuple[FitResult, FitResult]) -> None:
    blocks = fitted[0].model.base_model.blocks
    first, second = np.split(blocks[: len(blocks) // 2 * 2], 2)
    np.testing.assert_array_equal(first, second)
    parts = np.unique(first)
    assert len(parts) == 6
    for part in parts:
        assert np.sum(np.diff((first == part).astype(int)) > 0) >= 2
        assert np.mean(first == part) == pytest.approx(1 / 6, abs=0.05)


def test_what_one_sweep_holds_out_is_predicted_by_fits_that_have_not_seen_it(
    fitted: tuple[FitResult, FitResult],
) -> None:
    bare, right = fitted
    assert right.chi2 / right.degrees < right.cross_validation.chi2_reduced < 1.6
    assert right.cross_validation.p_value > 0.01
    assert bare.cross_validation.chi2_reduced > 1.1 * bare.chi2 / bare.degrees
    assert bare.cross_validation.p_value < 1e-6


def test_no_drift_is_followed_within_one_sweep(fitted: tuple[FitResult, FitResult]) -> None:
    """Its parts have no order in time, whatever hides the mode."""
    model = fitted[0].model.base_model
    assert isinstance(model, ResponseModel)
    assert len(replace(model, hidden=True).order_of_blocks) == 0


@pytest.mark.parametrize("n", [6, 9, 24, 81, 2000])
def test_parts_of_a_sweep_are_alike_in_size(n: int) -> None:
    sizes = np.bincount(parts_of_sweep(n), minlength=6)
    assert len(sizes) == 6
    assert np.ptp(sizes) <= max(n // 18, 1)
    assert np.ptp(sizes) <= 8
