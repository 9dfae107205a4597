"""Gas, light, charge and chip are told from their rivals, or both are named."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from femnl.core.diagnosis import Diagnosis
from femnl.device.geometry import load
from femnl.diagnose import diagnose
from femnl.io import measurement

Array = NDArray[np.float64]
MODEL = load("square-270um")
FILM = MODEL.film
GAP = 3.22625e-6
POINTS = 24
F0 = 1.5e6
Q0 = 5e5


def told(path: Path, control: dict[str, Array], f: Array, q: Array, f_sd: float) -> Diagnosis:
    """Diagnose a series with noise of f_sd [Hz] and of 1 % of Q."""
    rng = np.random.default_rng(7)
    group = measurement.series(
        control,
        f + f_sd * rng.standard_normal(POINTS),
        np.full(POINTS, f_sd),
        q * (1 + 0.01 * rng.standard_normal(POINTS)),
        0.01 * q,
    )
    return written(path, group)


def written(path: Path, group: xr.Dataset) -> Diagnosis:
    measurement.write(measurement.bundle({"data": group}, geometry="square-270um"), path)
    return diagnose(path)


def even(value: float) -> Array:
    return np.full(POINTS, value)


FLOOR = (
    2
    * np.pi
    * (2 / np.pi) ** 1.5
    * np.sqrt(0.0280134 / (8.314462618 * 295))
    / (2 * np.pi * FILM.density * FILM.thickness * F0)
)
"""Loss in nitrogen that bounces off both sides [1/Pa]."""


@pytest.mark.parametrize("part", [1.0, 1 / 70, 20.0])
def test_damping_by_gas_is_named_only_where_molecules_can_do_it(
    part: float, tmp_path: Path
) -> None:
    largest = {1.0: 10.0, 1 / 70: 700.0, 20.0: 1.0}[part]
    pressure = np.asarray(largest * np.geomspace(1e-3, 1, POINTS), np.float64)
    q = 1 / (1 / Q0 + part * FLOOR * pressure)
    found = told(tmp_path / "gas.nc", {"pressure": pressure}, even(F0), q, 100.0)
    if part == 1:
        assert (found.verdict, found.causes) == ("explained", ("gas_damping",))
    else:
        assert "gas_damping" not in found.causes


def test_gas_that_raises_f_is_trapped_and_gas_that_lowers_it_a_load(tmp_path: Path) -> None:
    pressure = np.linspace(0, 100, POINTS)
    inertia = FILM.density * FILM.thickness
    stiff = F0 * np.sqrt(1 + pressure / (inertia * GAP) / (2 * np.pi * F0) ** 2)
    up = told(tmp_path / "up.nc", {"pressure": pressure}, stiff, even(Q0), 2.0)
    assert (up.verdict, up.causes) == ("explained", ("trapped_gas",)), up.alternatives
    p = up.parameters["trapped_gas"]["pressure"]
    assert abs(p.value - 100) < 4 * p.sd
    wavenumber = 2 * np.pi * F0 / np.sqrt(FILM.stress / FILM.density)
    gas = 5.9e-5 * pressure / (wavenumber**2 * GAP) / inertia
    down = told(tmp_path / "down.nc", {"pressure": pressure}, F0 / np.sqrt(1 + gas), even(Q0), 2.0)
    assert (down.verdict, down.causes) == ("explained", ("gas_loading",)), down.alternatives


def test_light_that_stiffens_is_no_heat(tmp_path: Path) -> None:
    power = np.linspace(0, 1e-4, POINTS)
    f = F0 * np.sqrt(1 + 0.3 * power)
    found = told(tmp_path / "light.nc", {"laser_power": power}, f, even(Q0), 2.0)
    assert (found.verdict, found.causes) == ("explained", ("optical_spring",)), found.alternatives


def test_light_that_softens_is_told_as_both_with_the_place_that_decides(tmp_path: Path) -> None:
    power = np.linspace(0, 1e-4, POINTS)
    f = F0 * (1 - 0.2 * power)
    found = told(tmp_path / "light.nc", {"laser_power": power}, f, even(Q0), 2.0)
    assert found.verdict == "ambiguous"
    assert {one.causes for one in found.alternatives[:2]} == {
        ("optical_spring",),
        ("photothermal",),
    }
    assert "the laser on a nodal line" in found.measure_next


def test_a_parabola_in_voltage_is_charge_with_its_offset(tmp_path: Path) -> None:
    voltage = np.linspace(-10, 10, POINTS)
    softening = 8.8541878128e-12 / (FILM.density * FILM.thickness * (2 * np.pi * F0) ** 2 * GAP**3)
    f = F0 * np.sqrt(1 - 0.2 * softening * (voltage - 1.5) ** 2)
    control: dict[str, Array] = {"voltage": voltage, "time": np.linspace(0, 1440, POINTS)}
    found = told(tmp_path / "volts.nc", control, f, even(Q0), 2.0)
    assert (found.verdict, found.causes) == ("explained", ("electrostatic_softening",))
    offset = found.parameters["electrostatic_softening"]["offset"]
    assert abs(offset.value - 1.5) < 4 * offset.sd
    assert offset.sd < 0.3
