"""Which samples of a record of drive and output are compared, and what is said of it."""

import numpy as np
import pytest
import xarray as xr

from femnl.diagnose.fit import fit
from femnl.diagnose.freeform import fitted_forms
from femnl.diagnose.oscillation import OscillationProblem
from femnl.diagnose.problem import Extended
from femnl.errors import MeasurementError
from femnl.fits.oscillation import EDGE, SETTLED
from tests.blind.lab.record import RATE, RecordBench


@pytest.fixture(scope="module")
def whole() -> tuple[xr.Dataset, float]:
    """A record of an oscillator whose forces are nearly linear, and its linewidth [Hz]."""
    rng = np.random.default_rng(4)
    bench = RecordBench(rng)
    truth = bench.draw(rng) | {"linewidth": 11.0, "alpha": 0.3}
    return bench.measured(truth, {}, rng)["record"], truth["linewidth"]


def test_samples_are_compared_once_the_begin_is_forgotten(whole: tuple[xr.Dataset, float]) -> None:
    record, linewidth = whole
    problem = OscillationProblem(record)
    first = SETTLED / (np.pi * linewidth)
    count = record.sizes["time"] - EDGE - first * RATE
    note = next(note for note in problem.notes if "samples are compared" in note)
    assert len(problem.blocks) == pytest.approx(count, abs=4)
    assert f"of {record.sizes['time']} samples are compared, from {first:.2g}" in note
    assert "so short a record" not in note


def test_free_forms_of_what_a_record_knows_nothing_of_are_left_out(whole: tuple[xr.Dataset, float]) -> None:
    problem = OscillationProblem(whole[0])
    found = fitted_forms(fit(Extended(problem), problem.start))
    assert [solution.model.effects[0].sentence for solution in found] == ["restoring and damping forces of free form"]


def test_a_record_too_short_to_forget_its_begin_is_told_apart(whole: tuple[xr.Dataset, float]) -> None:
    record, linewidth = whole
    needed = SETTLED / (np.pi * linewidth) * RATE
    problem = OscillationProblem(record.isel(time=slice(0, int(1.8 * needed))))
    assert any("in so short a record later ones, too" in note for note in problem.notes)


def driven(strength: float) -> OscillationProblem:
    """The problem of a record under this part of the common drive, of an oscillator that is stiff and rings for long."""
    rng = np.random.default_rng(0)
    bench = RecordBench(rng)
    bench.drive *= strength * 0.1 / np.std(bench.drive)
    bench.noise = 3e-4
    truth = {"frequency": 67.5, "linewidth": 5.2, "stiffness": 0.98, "offset": 1.5e-3, "alpha": 4.3}
    return OscillationProblem(bench.measured(truth, {}, rng)["record"])


def test_the_base_model_of_a_strong_motion_that_does_not_begin_at_rest_finds_its_way_in_noise() -> None:
    problem = driven(1.1)
    found = fit(Extended(problem), problem.start)
    assert found.chi2 / found.degrees == pytest.approx(1.0, abs=0.15)
    base, _ = found.model.split(found.vector)
    assert base["alpha"] == pytest.approx(4.3, rel=2e-3)


def test_a_record_whose_begin_is_never_forgotten_is_refused() -> None:
    with pytest.raises(MeasurementError, match="samples do not depend on what the record began with"):
        driven(2.0)
