"""Units in headings: read where they are known, told where they are not."""

from pathlib import Path

import numpy as np
import pytest

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


def test_a_unit_that_is_not_known_is_told(tmp_path: Path) -> None:
    time = np.linspace(0, 2, 50)
    rows = [f"{t:.4f},{np.exp(-6 * t):.6e}" for t in time]
    spec = (
        'kind = "decay"\n[columns]\ntime = "t (s)"\npower = "P (uW)"\n'
        '[values]\nfrequency = "1 MHz"\n'
    )
    repairs, _ = imported(tmp_path, "\n".join(["t (s),P (uW)", *rows]) + "\n", spec)
    (told,) = [repair for repair in repairs if "uW" in repair]
    assert "is no unit of it that is known, so that numbers are taken in dB" in told
