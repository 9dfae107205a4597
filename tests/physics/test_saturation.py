"""A detector that clips on both sides, or on one."""

from pathlib import Path

import numpy as np
import pytest

from femnl.diagnose import diagnose
from tests.blind.lab import Case, make
from tests.physics.driven_sweeps import PHASES, STRONGEST, Bench, Complex, lock_in

RAILS = {"one_sided_saturation": -np.inf, "detector_saturation": -1.0}


def clipped(bench: Bench, part: float, low: float) -> Complex:
    """Return sweeps of a detector with rails at 1 and `low` times (1 − part) of its largest."""
    volts = bench.volts(bench.amplitude())
    limit = (1 - part) * STRONGEST
    wave = np.clip(np.abs(volts)[..., None] * np.cos(PHASES), low * limit, limit)
    return np.asarray(lock_in(wave) * volts / np.abs(volts))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["one_sided_saturation", "detector_saturation"],
)
def test_rails_on_one_or_both_sides_are_told_apart_where_much_is_clipped(
    name: str, tmp_path: Path
) -> None:
    found = Bench().diagnose(tmp_path / "a.nc", clipped(Bench(), 0.4, RAILS[name]))
    assert (found.verdict, found.causes) == ("explained", (name,)), found.alternatives
    # Of the strongest signal as measured, which the rails have made smaller.
    whole = STRONGEST * (1 - 0.4)
    largest = np.abs(clipped(Bench(), 0.4, RAILS[name])).max()
    assert found.parameters[name]["clipped"].value == pytest.approx(1 - whole / largest, abs=0.01)


@pytest.mark.slow
def test_rails_on_one_or_both_sides_are_both_listed_where_little_is_clipped(
    tmp_path: Path,
) -> None:
    found = Bench().diagnose(tmp_path / "a.nc", clipped(Bench(), 0.03, -1.0))
    assert found.verdict == "ambiguous"
    assert {(other,) for other in RAILS} <= {other.causes for other in found.alternatives}


@pytest.mark.parametrize(
    "name",
    ["detector_saturation", pytest.param("one_sided_saturation", marks=pytest.mark.slow)],
)
@pytest.mark.slow
def test_maps_tell_on_which_sides_the_detector_clips(name: str, tmp_path: Path) -> None:
    truth = make(Case("map", (name,), 1, size=(100.0, 200.0)), tmp_path / "a.nc")["causes"][name]
    found = diagnose(tmp_path / "a.nc")
    assert (found.verdict, found.causes) == ("explained", (name,)), found.alternatives
    clipped = found.parameters[name]["clipped"]
    assert abs(clipped.value - truth["clipped"]) < 4 * clipped.sd
