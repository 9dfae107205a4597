"""Odd but legal input: a step without signal, missing rows, one row, numbers without errors."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from femnl import load, measurement
from femnl.chip.measured import measured
from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.resources import find_geometry, geometries
from femnl.core.stages import Points
from femnl.diagnose import one_file
from femnl.diagnose.noise_level import noise_level
from femnl.diagnose.one_file import settings_of
from femnl.effects.electrostatic_softening import soften
from femnl.fits.record.terms import fit_terms
from femnl.fits.series.law import fit_series
from femnl.fits.spectrum.peaks import find_peaks
from femnl.fits.trace.decompose import decompose, drive_frequencies, most_harmonics
from femnl.fits.trace.glitches import without_glitches
from femnl.io.measurement import estimate_noise
from femnl.mechanics.static_deflection import solve_static_deflection
from femnl.observe.map.layout import where_most
from femnl.observe.map.spots import Grid
from femnl.observe.residuals import apart
from femnl.pipeline import solve_modes_near

SEED = 20261130
TIME = np.arange(4000) * 1e-5
TONE = 250.0


def traces(rows: list[np.ndarray[tuple[int], np.dtype[np.float64]]]) -> xr.Dataset:
    """Return traces at one drive frequency."""
    return measurement.trace(TIME, np.stack(rows), drive_frequency=np.full(len(rows), TONE))


def wave(seed: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return a tone of 1 V with noise of 1 mV."""
    noise = np.random.default_rng([SEED, seed]).normal(size=len(TIME))
    return np.asarray(np.cos(2 * np.pi * TONE * TIME) + 1e-3 * noise)


def test_a_step_in_which_nothing_scatters_weighs_no_more_than_the_others() -> None:
    found = decompose(traces([wave(0), wave(1), np.full(len(TIME), 0.3)]), 3)
    assert found.noise_sd[2] == pytest.approx(np.median(found.noise_sd[:2]), rel=0.1)
    np.testing.assert_allclose(found.values_sd[:, 2], found.values_sd[:, 0], rtol=0.1)


def test_a_drive_that_stands_still_tells_no_frequency() -> None:
    data = measurement.trace(
        TIME, np.stack([wave(0)] * 2), drive_voltage=np.stack([wave(1), np.zeros(len(TIME))])
    )
    with pytest.raises(MeasurementError, match="drive_voltage of step 2 does not change"):
        drive_frequencies(data)


def test_a_step_without_a_sample_is_named() -> None:
    with pytest.raises(MeasurementError, match="step 2 has no sample; leave it out"):
        most_harmonics(traces([wave(0), np.full(len(TIME), np.nan)]))


def test_glitches_are_sought_where_only_the_drive_was_recorded() -> None:
    output = wave(0)
    output[1234] += 1
    data = measurement.trace(TIME, output[None], drive_voltage=wave(1)[None])
    kept, left_out = without_glitches(data, 3)
    assert np.isnan(kept["voltage"].values[0, 1234])
    assert len(left_out) == 1


def test_a_record_with_missing_rows_is_no_even_one() -> None:
    rng = np.random.default_rng(SEED)
    kept = np.setdiff1d(np.arange(4000), np.arange(1000, 1030))
    data = measurement.trace(
        TIME[kept], rng.normal(size=(1, len(kept))), drive_voltage=rng.normal(size=(1, len(kept)))
    )
    with pytest.raises(MeasurementError, match="samples are not even in time"):
        fit_terms(data)


def test_lines_are_not_sought_in_magnitudes() -> None:
    f = np.linspace(1e5, 1.1e5, 200)
    data = measurement.magnitudes_alone(measurement.response(f, 1 / (1 + 1j * (f - 1.05e5) / 50)))
    with pytest.raises(MeasurementError, match="magnitudes alone"):
        find_peaks(data)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_the_noise_of_a_map_of_few_rows_is_not_its_signal(rows: int) -> None:
    rng = np.random.default_rng(SEED)
    x = np.linspace(-1e-4, 1e-4, 200)
    signal = 1e-3 * np.cos(np.pi * x / 2e-4)
    noise = 1e-6 * (rng.normal(size=(1, rows, 200)) + 1j * rng.normal(size=(1, rows, 200)))
    y = 1e-6 * np.arange(rows)
    data = measurement.harmonic_map(x, y, [1], signal + noise)
    assert estimate_noise(data) == pytest.approx(1e-6, rel=0.2)


def test_a_law_needs_several_values_of_what_it_is_against() -> None:
    pressure = np.array([1.0, 1, 1, 1, 2, 3])
    quality = np.array([1e4, 1.1e4, 0.9e4, 1e4, np.nan, np.nan])
    data = measurement.series({"pressure": pressure}, quality_factor=quality)
    with pytest.raises(MeasurementError, match="known at one value of pressure only"):
        fit_series(data)


def test_a_held_value_that_no_law_can_have_is_refused() -> None:
    data = measurement.series(
        {"temperature": np.linspace(250, 350, 8)}, quality_factor=np.linspace(1e4, 2e4, 8)
    )
    with pytest.raises(ParameterError, match="no arrhenius law can have what is held"):
        fit_series(data, "arrhenius", fixed={"activation_energy": 0.5})


def chip_file(path: Path, **groups: xr.Dataset) -> Path:
    """Write measurements of a device."""
    measurement.write(measurement.bundle(groups), path)
    return path


def test_modes_of_a_device_are_numbered_by_frequency_and_known_as_far_as_they_are(
    tmp_path: Path,
) -> None:
    lines = measurement.spectrum(
        [3e5, 1e5, 2e5],
        [1.0, 1.0, 1.0],
        quality_factor=[3e4, 1e4, 2e4],
        quality_factor_sd=[1e2, np.nan, 1e2],
    )
    found = {one.mode: one for one in measured(chip_file(tmp_path / "a.nc", lines=lines))}
    assert {mode: one.frequency for mode, one in found.items()} == {"1": 1e5, "2": 2e5, "3": 3e5}
    assert found["1"].quality is None
    assert found["2"].quality == pytest.approx(2e4)


def test_measurements_of_two_modes_without_names_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(SEED)
    responses = {}
    for name, f0 in (("one", 1e5), ("two", 2.2e5)):
        f = f0 + np.linspace(-500, 500, 101)
        noise = 1e-3 * (rng.normal(size=101) + 1j * rng.normal(size=101))
        line = 1 / (1 + 2j * (f - f0) / 50) + noise
        responses[name] = measurement.response(f, line, drive=0.1, noise_sd=1e-3)
    with pytest.raises(MeasurementError, match="name no mode; give each its attribute mode"):
        list(measured(chip_file(tmp_path / "a.nc", **responses)))


def test_the_place_that_is_told_is_that_of_the_harmonic() -> None:
    places = np.array([0.0, 1e-5, 2e-5])
    grid = Grid(places, places, np.zeros(3, int), np.arange(3), (1, 3))
    power = np.array([[1.0, 1.0, 9.0], [10.0, 1.0, 4.0]])
    residuals = np.concatenate([np.sqrt(2 * power).ravel(), np.zeros(6)])
    told = where_most(residuals, np.array([1, 2]), grid, np.ones((2, 3), dtype=bool))
    assert "harmonic 2 deviates most, and most strongly near x = 0 µm" in told


def test_a_film_that_is_pulled_in_has_no_imaginary_frequency() -> None:
    points = Points(np.full(3, 1e6), np.full(3, 1e4), {"voltage": np.array([-3.0, 0.0, 3.0])})
    found = soften(points, {"softening": 0.2, "offset": 5.0})
    assert np.isfinite(found.frequency).all()


def test_modes_that_are_not_the_lowest_are_not_bent() -> None:
    modes = solve_modes_near(load(find_geometry("circle")), 3e6, 2, resolution=0.3)
    assert modes.first > 1
    with pytest.raises(ParameterError, match="follow from the lowest ones"):
        solve_static_deflection(modes, pressure=10.0)


def test_one_value_given_as_an_attribute_is_that_of_every_sweep(tmp_path: Path) -> None:
    f = np.tile(np.linspace(1e5, 1.1e5, 20), (5, 1))
    with h5py.File(tmp_path / "all.nc", "w") as file:
        file.attrs["femnl_measurement"] = "1.2"
        group = file.create_group("sweep")
        group.attrs.update({"kind": "response", "drive": 0.2})
        for name, values in {"frequency": f, "real": np.cos(f), "imag": np.sin(f)}.items():
            group[name] = values
    (found,) = measurement.read(tmp_path / "all.nc").children.values()
    np.testing.assert_array_equal(found.to_dataset()["drive"].values, np.full(5, 0.2))


def test_one_error_given_as_an_attribute_is_that_of_every_mode(tmp_path: Path) -> None:
    path = tmp_path / "all.nc"
    lines = measurement.spectrum([1e5, 2e5, 3e5], [1.0, 2.0, 3.0])
    measurement.write(measurement.bundle({"lines": lines}), path)
    with h5py.File(path, "r+") as file:
        del file["lines/frequency_sd"]
        file["lines"].attrs["frequency_sd"] = 5.0
    (group,) = measurement.read(path).children.values()
    np.testing.assert_array_equal(group.to_dataset()["frequency_sd"].values, np.full(3, 5.0))


def test_a_value_for_all_that_must_be_positive_is(tmp_path: Path) -> None:
    path = tmp_path / "all.nc"
    measurement.write(measurement.bundle({"trace": traces([wave(0)])}), path)
    with h5py.File(path, "r+") as file:
        del file["trace/drive_frequency"]
        file["trace"].attrs["drive_frequency"] = -1e5
    with pytest.raises(MeasurementError, match="drive_frequency is -100000; give a positive"):
        measurement.read(path)


def test_data_that_repeat_what_is_predicted_tell_no_noise() -> None:
    residuals = np.random.default_rng(SEED).normal(size=2000)
    residuals[:1300] = 0
    layout = replace(apart(np.zeros(2000, np.int64)), previous=np.arange(2000) - 1)
    dropped = np.zeros(2000, dtype=bool)
    assert noise_level(residuals, layout, dropped, bare=True) == (1.0, 0.0)
    assert noise_level(np.zeros(2000), layout, dropped, bare=False) == (1.0, 0.0)


def test_rows_of_a_table_are_of_the_shipped_geometries_that_there_were(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for source in geometries().glob("*.toml"):
        (tmp_path / source.name).write_bytes(source.read_bytes())
    before = settings_of(None, None).digest
    monkeypatch.setattr(one_file, "geometries", lambda: tmp_path)
    assert settings_of(None, None).digest == before
    with (tmp_path / "circle.toml").open("a") as file:
        file.write("# thinner now\n")
    assert settings_of(None, None).digest != before
