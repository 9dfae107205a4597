"""Fits of a record: where they start, which samples they compare, and which records are refused."""

from pathlib import Path

import numpy as np
import pytest

from femnl import measurement
from femnl.core.checkpoint import open_checkpoint
from femnl.core.comparison import Curves
from femnl.core.effect import Effect, ParameterSpec
from femnl.core.errors import MeasurementError, ParameterError
from femnl.diagnose import diagnose
from femnl.diagnose.freeform import fitted_forms
from femnl.effects import library
from femnl.fits.least_squares import fit
from femnl.fits.record.pose import pose as pose_record
from femnl.observe.extended import ExtendedModel
from femnl.observe.record.free_run import EDGE
from femnl.observe.record.model import RecordModel
from tests.blind.lab.record import RecordBench


def driven(strength: float, seed: int = 0) -> RecordModel:
    """Return the model of a record under a part of the common drive.

    The oscillator is stiff and rings for long.
    """
    rng = np.random.default_rng(seed)
    bench = RecordBench(rng)
    bench.drive *= strength * 0.1 / np.std(bench.drive)
    bench.noise = 3e-4
    truth = {"frequency": 67.5, "linewidth": 5.2, "stiffness": 0.98, "offset": 1.5e-3, "alpha": 4.3}
    return pose_record(bench.measured(truth, {}, rng)["record"])


def test_motion_that_the_record_began_with_is_fitted_and_no_sample_wasted() -> None:
    rng = np.random.default_rng(4)
    bench = RecordBench(rng)
    truth = bench.draw(rng) | {"linewidth": 0.5}
    bench.drive *= 0.3
    record = bench.measured(truth, {}, rng)["record"].isel(time=slice(0, 600))
    base_model = pose_record(record)
    found = fit(ExtendedModel(base_model), base_model.start)
    # The amplitude decays by exp(−π w t) = 0.2 over the whole record.
    assert len(base_model.blocks) == 600 - 2 * EDGE
    assert found.chi2 / found.degrees == pytest.approx(1.0, abs=0.2)
    base, _ = found.model.split(found.vector)
    for k, name in enumerate(("frequency", "linewidth", "stiffness", "offset")):
        assert abs(base[name] - truth[name]) < 4 * np.sqrt(found.covariance[k, k]), name


def test_a_record_whose_first_samples_are_lost_begins_at_the_first_that_is_known() -> None:
    rng = np.random.default_rng(4)
    bench = RecordBench(rng)
    truth = bench.draw(rng) | {"linewidth": 0.5}
    bench.drive *= 0.3
    record = bench.measured(truth, {}, rng)["record"]
    record["voltage"][:, :200] = np.nan
    base_model = pose_record(record)
    found = fit(ExtendedModel(base_model), base_model.start)
    assert len(base_model.blocks) == record.sizes["time"] - 200 - 2 * EDGE
    assert found.chi2 / found.degrees == pytest.approx(1.0, abs=0.15)
    base, _ = found.model.split(found.vector)
    (curves,) = base_model.compare([("base", (), base, [])])
    assert isinstance(curves, Curves)
    assert set(curves.curves[0].x) < set(record["time"].values)


def test_a_record_that_is_posed_again_is_not_followed_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    bench = RecordBench(rng)
    record = bench.measured(bench.draw(rng), {}, rng)["record"].isel(time=slice(0, 900))
    checkpoint = open_checkpoint(tmp_path / "fits.jsonl")
    first = pose_record(record, None, checkpoint)
    # The last line is what following came to; without those of its fits, each would be made anew
    last = checkpoint.path.read_bytes().splitlines(keepends=True)[-1]
    checkpoint.path.write_bytes(last)
    again = pose_record(record, None, open_checkpoint(checkpoint.path))
    assert checkpoint.path.read_bytes() == last
    assert np.array_equal(again.start, first.start)
    assert again.notes == first.notes
    record["voltage"][:, 500] += 1e-6
    pose_record(record, None, open_checkpoint(checkpoint.path))
    assert len(checkpoint.path.read_bytes()) > len(last)


def test_free_forms_of_what_a_record_knows_nothing_of_are_left_out() -> None:
    base_model = driven(0.5)
    found = fitted_forms(fit(ExtendedModel(base_model), base_model.start))
    assert [result.model.effects[0].sentence for result in found] == [
        "restoring and damping forces of free form"
    ]


@pytest.mark.parametrize(("strength", "seed"), [(1.1, 1), (1.5, 3)])
def test_the_base_model_of_a_strong_motion_that_does_not_begin_at_rest_finds_its_way(
    strength: float, seed: int
) -> None:
    base_model = driven(strength, seed)
    found = fit(ExtendedModel(base_model), base_model.start)
    assert found.chi2 / found.degrees == pytest.approx(1.0, abs=0.15)
    base, _ = found.model.split(found.vector)
    assert base["alpha"] == pytest.approx(4.3, rel=2e-3)


def test_a_quintic_force_larger_than_the_linear_one_is_found(tmp_path: Path) -> None:
    """The base model takes half of it for a weaker cubic force, which says nothing of its range."""
    rng = np.random.default_rng(2)
    bench = RecordBench(rng)
    truth = {"frequency": 73.2, "linewidth": 9.4, "stiffness": 1.13, "offset": 4e-4, "alpha": 3.5}
    hidden = {"quintic_stiffness": {"alpha5": -5.3}}
    groups = bench.measured(truth, hidden, rng)
    largest = float(np.abs(groups["record"]["voltage"]).max())
    assert 5.3 * largest**4 > 1.1
    measurement.write(measurement.bundle(groups), tmp_path / "a.nc")
    found = diagnose(tmp_path / "a.nc", effects=[library()["quintic_stiffness"]])
    assert (found.verdict, found.causes) == ("explained", ("quintic_stiffness",))
    alpha5 = found.parameters["quintic_stiffness"]["alpha5"]
    assert abs(alpha5.value + 5.3) < 4 * alpha5.sd < 0.2


@pytest.mark.slow
def test_a_chaotic_record_is_refused() -> None:
    with pytest.raises(
        MeasurementError, match=r"the motion is chaotic: changes of its begin grow .* times"
    ):
        driven(2.2, seed=1)  # changes of the start grow 1e12 times: no processor rounds that away


def test_a_drive_that_belongs_to_another_output_is_refused() -> None:
    rng = np.random.default_rng(0)
    bench = RecordBench(rng)
    record = bench.measured(bench.draw(rng), {}, rng)["record"]
    record["voltage"] = record["voltage"].roll(time=40)
    with pytest.raises(MeasurementError, match="check that drive and output belong together"):
        pose_record(record)


def test_an_effect_whose_parameter_has_no_range_in_volts_is_refused() -> None:
    odd = Effect(
        "stiction",
        "",
        (ParameterSpec("delay", "s", 0.0, 1.0),),
        {"equation": lambda forces, values: forces},
        "",
        "",
        "",
    )
    with pytest.raises(
        ParameterError,
        match=r"effect stiction: its parameter delay has no range in volts .* takes kappa2, "
        r"eta, alpha5",
    ):
        driven(0.5).usable_effects([odd])
