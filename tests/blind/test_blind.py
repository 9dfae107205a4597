"""Causes hidden in files of the virtual laboratory are found again, and nothing is found where nothing is hidden."""

from pathlib import Path

import pytest

from femnl.diagnose import diagnose
from femnl.effects import library
from tests.blind.lab import Case, make

HIDDEN = [
    ("spectrum", "added_mass"),
    ("spectrum", "frequency_drift"),
    ("spectrum", "shear_stress"),
    ("spectrum", "gas_loading"),
    ("response", "nonlinear_damping"),
    ("response", "drive_compression"),
    pytest.param("response", "crosstalk", marks=pytest.mark.slow),
    ("map", "phase_tilt"),
    ("series", "gas_damping"),
    ("series", "thermal_stress"),
]
LACKING = [
    pytest.param("spectrum", "frequency_drift", marks=pytest.mark.slow),
    pytest.param("response", "nonlinear_damping", marks=pytest.mark.slow),
    ("series", "gas_damping"),
]


@pytest.mark.parametrize("kind", ["spectrum", "response", "map", "series"])
def test_nothing_is_found_where_nothing_is_hidden(kind: str, tmp_path: Path) -> None:
    make(Case(kind, (), 1), tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert (found.verdict, found.causes) == ("adequate", ()), found.where


@pytest.mark.parametrize(("kind", "cause"), HIDDEN)
def test_a_hidden_cause_is_named_and_the_gain_is_real(kind: str, cause: str, tmp_path: Path) -> None:
    make(Case(kind, (cause,), 2), tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert (found.verdict, found.causes) == ("explained", (cause,)), (found.where, found.alternatives)
    assert found.gain > 1


def test_anisotropy_in_frequencies_is_a_tie_with_the_aspect_ratio(tmp_path: Path) -> None:
    make(Case("spectrum", ("stress_anisotropy",), 3), tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc")
    assert found.verdict == "ambiguous"
    assert {("stress_anisotropy",), ("aspect_ratio",)} <= {other.causes for other in found.alternatives}


@pytest.mark.parametrize(("kind", "cause"), LACKING)
def test_a_cause_that_the_library_lacks_is_called_unexplained(kind: str, cause: str, tmp_path: Path) -> None:
    make(Case(kind, (cause,), 2), tmp_path / "file.nc")
    found = diagnose(tmp_path / "file.nc", effects=[effect for effect in library().values() if effect.name != cause])
    assert (found.verdict, found.causes) == ("unexplained", ())
    assert found.p_value < 0.01
