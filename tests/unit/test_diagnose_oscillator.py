"""Which samples of a record of drive and output are compared, and what is said of it."""

import numpy as np
import pytest
import xarray as xr

from femnl.diagnose.oscillation import OscillationProblem
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


def test_a_record_too_short_to_forget_its_begin_is_told_apart(whole: tuple[xr.Dataset, float]) -> None:
    record, linewidth = whole
    needed = SETTLED / (np.pi * linewidth) * RATE
    problem = OscillationProblem(record.isel(time=slice(0, int(1.8 * needed))))
    assert any("in so short a record later ones, too" in note for note in problem.notes)
