"""Units in headings: read where they are known, told where they are not."""

from pathlib import Path

import numpy as np
import pytest

from femnl.core.errors import MeasurementError
from femnl.io import measurement
from femnl.io.labfiles import import_file


def imported(folder: Path, text: str, spec: str) -> tuple[tuple[str, ...], dict[str, float]]:
    """Import a table; the repairs, and the first value of each dataset."""
    (folder / "a.csv").write_text(text, encoding="utf-8")
    (folder / "a.toml").write_text(spec, encoding="utf-8")
    repairs = import_file(folder / "a.csv", folder / "a.nc").attrs["repairs"]
    found = measurement.read(folder / "a.nc")["measurement"].to_dataset()
    return repairs, {str(name): float(v.values.ravel()[0]) for name, v in found.variables.items()}


@pytest.mark.parametrize(
    ("heading", "name", "value"),
    [
        ("p / mbar", "pressure", 0.1),
        ("p_mbar", "pressure", 0.1),
        ("p / Torr", "pressure", 0.1333224),
        ("T / °C", "temperature", 273.151),
        ("T_degC", "temperature", 273.151),
        ("t / min", "time", 0.06),
        ("t / h", "time", 3.6),
        ("t_min", "time", 0.06),
    ],
)
def test_units_behind_a_slash_or_an_underscore_are_read(
    tmp_path: Path, heading: str, name: str, value: float
) -> None:
    spec = f'kind = "series"\n[columns]\n{name} = "{heading}"\nquality_factor = "Q"\n'
    table = f"{heading},Q\n0.001,100000\n0.003,90000\n0.01,70000\n"
    repairs, first = imported(tmp_path, table, spec)
    assert first[name] == pytest.approx(value, rel=1e-6)
    assert any("as the file says" in repair for repair in repairs)


DECAY = 'kind = "decay"\n[columns]\ntime = "t (s)"\npower = "{}"\n[values]\nfrequency = "1 MHz"\n'
POWERS = np.exp(-6 * np.linspace(0, 2, 50))


def table(head: str, powers: np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    rows = [f"{k / 25:.2f},{p:.9e}" for k, p in enumerate(powers)]
    return "\n".join([f"t (s),{head}", *rows]) + "\n"


def test_a_unit_that_is_not_known_is_told(tmp_path: Path) -> None:
    head = "P (counts)"
    repairs, _ = imported(tmp_path, table(head, np.log(POWERS)), DECAY.format(head))
    (told,) = [repair for repair in repairs if "counts" in repair]
    assert "is no unit of it that is known, so that numbers are taken in dB" in told


def test_a_power_in_watts_becomes_a_level_by_one_milliwatt(tmp_path: Path) -> None:
    repairs, first = imported(tmp_path, table("P (uW)", POWERS), DECAY.format("P (uW)"))
    assert first["power"] == pytest.approx(-30.0)
    assert any("columns.power: in uW, as the file says" in repair for repair in repairs)
    with pytest.raises(MeasurementError, match="W has no level in decibel; subtract no background"):
        imported(tmp_path, table("P (uW)", POWERS - 0.5), DECAY.format("P (uW)"))
