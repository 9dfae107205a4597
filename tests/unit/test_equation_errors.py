"""What the accuracy of equations adds to the errors of fitted values."""

from pathlib import Path

import numpy as np
import pytest

from femnl import measurement
from femnl.core.diagnosis import Diagnosis
from femnl.diagnose import diagnose
from femnl.diagnose.files import record
from femnl.effects import library
from femnl.report.parameters import parameter_rows

SEED = 20261126
FREQUENCY = 1.4e6
RATE = 2e-8
TIME = np.linspace(0, 3600, 25)
SD = 0.05
ACCURACY = library()["frequency_drift"].accuracy


def drifting(folder: Path, rate: float) -> Diagnosis:
    """Diagnose a series whose frequency drifts steadily."""
    noise = SD * np.random.default_rng(SEED).standard_normal(len(TIME))
    frequency = FREQUENCY * (1 + rate * TIME) + noise
    data = measurement.series({"time": TIME}, frequency, np.full(len(TIME), SD))
    path = folder / f"drift-{rate}.nc"
    measurement.write(measurement.bundle({"series": data}, geometry="square-270um"), path)
    return diagnose(path)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    return drifting(tmp_path_factory.mktemp("drift"), RATE)


def test_values_move_as_straight_lines_through_what_the_equation_may_miss(
    found: Diagnosis,
) -> None:
    assert found.causes == ("frequency_drift",)
    drift = FREQUENCY * RATE * TIME
    size = TIME / TIME[-1]
    place = np.linspace(-1, 1, len(TIME))
    ways = [drift * part for part in (1 + 0 * size, size, size**2, place, place**2, place**3)]
    slopes, ends = np.transpose([np.polyfit(TIME, ACCURACY * way, 1) for way in ways])
    moved = found.parameters["base"]["frequency"].equation_sd
    assert moved == pytest.approx(np.hypot.reduce(ends), rel=0.01)
    moved = found.parameters["frequency_drift"]["rate"].equation_sd
    assert moved == pytest.approx(np.hypot.reduce(slopes) / FREQUENCY, rel=0.01)


def test_a_drift_that_the_equation_misses_by_its_accuracy_is_within_the_error(
    found: Diagnosis, tmp_path: Path
) -> None:
    other = drifting(tmp_path, RATE * (1 + ACCURACY))
    rate = found.parameters["frequency_drift"]["rate"]
    away = abs(other.parameters["frequency_drift"]["rate"].value - rate.value)
    assert rate.sd < away / 10
    assert away < rate.whole_sd


def test_a_model_without_causes_has_no_inexact_equations(tmp_path: Path) -> None:
    still = drifting(tmp_path, 0.0)
    assert still.verdict == "adequate"
    assert all(p.equation_sd == 0 for p in still.parameters["base"].values())
    assert len(parameter_rows(still)[0]) == 4


def test_the_errors_of_equations_are_in_the_file_and_the_table(found: Diagnosis) -> None:
    rate = found.parameters["frequency_drift"]["rate"]
    told = record(found)["parameters"]["frequency_drift"]["rate"]
    assert told["equation_sd"] == rate.equation_sd
    (row,) = [row for row in parameter_rows(found) if row[1] == "rate"]
    assert row[2:] == ["–", "(2.00035 ± 0.00066)·10⁻⁸", "± 4.3·10⁻⁹", "1/s"]
