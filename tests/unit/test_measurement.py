"""Measurement files: what is written is what is read, whoever wrote it."""

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from femnl.io import measurement

DATA = Path(__file__).parents[3] / "shared" / "data"
RNG = np.random.default_rng(20250219)


def samples() -> dict[str, xr.Dataset]:
    """Build one measurement of every kind, with all that the kind can hold."""
    volts = RNG.normal(size=(3, 5)) + 1j * RNG.normal(size=(3, 5))
    picture = RNG.normal(size=(2, 4, 3)) + 1j * RNG.normal(size=(2, 4, 3))
    return {
        "spectrum": measurement.spectrum(
            [1e6, 2e6], [3.0, 4.0], ["1,1", "2,1"], [0.0, 60.0], [1e5, 2e5], [1e3, 1e3]
        ),
        "response": measurement.response(
            np.linspace(1e6, 1.1e6, 5),
            volts,
            drive=[0.1, 0.2, 0.3],
            direction=[1, -1, 1],
            x=1e-6,
            y=0.0,
            time=[0.0, 1.0, 2.0],
            noise_sd=1e-5,
            wavelength=632.8e-9,
            mode="1,1",
        ),
        "map": measurement.harmonic_map(
            [-1e-6, 0, 2e-6],
            [0, 1e-6, 2e-6, 3e-6],
            [1, 3],
            picture,
            noise_sd=1e-4,
            wavelength=532e-9,
            drive=0.1,
            drive_frequency=1e6,
        ),
        "trace": measurement.trace(
            np.arange(6) * 1e-3,
            RNG.normal(size=(2, 6)),
            drive_frequency=[1e6, 1.1e6],
            drive_voltage=RNG.normal(size=(2, 6)),
            noise_sd=1e-3,
            wavelength=1.55e-6,
            x=0.0,
            y=1e-6,
        ),
        "series": measurement.series(
            {"pressure": [1.0, 10.0, 100.0]},
            [1e6, 1e6 - 1, 1e6 - 9],
            [0.1, 0.1, 0.1],
            [1e5, 5e4, 1e4],
            [1e2, 1e2, 1e2],
        ),
    }


def test_every_kind_comes_back_from_the_file_as_it_was_written(tmp_path: Path) -> None:
    sources = samples()
    tree = measurement.bundle(sources, geometry="square-270um", title="five kinds", sample="J10")
    assert tree.attrs["repairs"] == ()
    measurement.write(tree, tmp_path / "all.nc")
    back = measurement.read(tmp_path / "all.nc")
    assert back.identical(tree)
    for name, dataset in sources.items():
        assert set(back[name].to_dataset().variables) == set(dataset.variables)
        for key, variable in dataset.variables.items():
            np.testing.assert_array_equal(back[name][str(key)].values, variable.values)


def test_a_written_file_is_plain_hdf5_with_units_and_dimension_scales(tmp_path: Path) -> None:
    measurement.write(measurement.bundle(samples()), tmp_path / "all.nc")
    with h5py.File(tmp_path / "all.nc") as file:
        assert file.attrs["femnl_measurement"] == "1.2"
        real = file["map/real"]
        assert real.attrs["units"] == "V"
        assert real.dtype == np.float64
        assert [real.dims[axis][0].name for axis in range(3)] == [
            "/map/harmonic",
            "/map/y",
            "/map/x",
        ]
        assert file["response/direction"][()].tolist() == [1, -1, 1]
        assert file["spectrum/label"].asstr()[0] == "1,1"


@pytest.mark.parametrize("kind", ["spectrum", "response", "map", "trace", "series"])
def test_a_file_without_dimension_scales_gets_the_names_of_the_contract(
    kind: str, tmp_path: Path
) -> None:
    source = samples()[kind]
    with h5py.File(tmp_path / "plain.nc", "w") as file:
        file.attrs["femnl_measurement"] = "1.0"
        group = file.create_group("g")
        for key, value in source.attrs.items():
            group.attrs[key] = value
        for key, variable in source.variables.items():
            group[str(key)] = variable.values
            group[str(key)].attrs.update(variable.attrs)
    tree = measurement.read(tmp_path / "plain.nc")
    assert tree.attrs["repairs"] == ()
    xr.testing.assert_equal(tree["g"].to_dataset(), source)


def test_arrays_stored_column_first_are_turned_and_the_turn_is_told(tmp_path: Path) -> None:
    source = samples()["response"]
    with h5py.File(tmp_path / "matlab.nc", "w") as file:
        file.attrs["femnl_measurement"] = np.bytes_("1.0")
        group = file.create_group("g")
        group.attrs["kind"] = np.array([b"response"])
        for key, variable in source.variables.items():
            group[str(key)] = np.atleast_2d(variable.values).T
            group[str(key)].attrs.update(variable.attrs)
    tree = measurement.read(tmp_path / "matlab.nc")
    np.testing.assert_array_equal(tree["g"]["real"].values, source["real"].values)
    np.testing.assert_array_equal(tree["g"]["drive"].values, source["drive"].values)
    assert any("real: shape (5, 3) turned to (3, 5)" in line for line in tree.attrs["repairs"])


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    values=arrays(
        np.float64,
        st.tuples(st.integers(1, 3), st.integers(2, 6)),
        # What is below 1e-30 V is taken as 0, and told
        elements=st.floats(-1e3, 1e3).map(lambda v: v if abs(v) >= 1e-30 else 0.0),
    ),
    missing=st.sets(st.integers(0, 17), max_size=4),
    noise=st.floats(1e-9, 1.0),
    name=st.text("abcXYZ 01_äµ", min_size=1, max_size=8).filter(lambda text: text.strip() == text),
)
def test_any_response_survives_the_file(
    values: np.ndarray, missing: set[int], noise: float, name: str, tmp_path: Path
) -> None:
    volts = values + 1j * values[:, ::-1]
    volts.ravel()[[index for index in missing if index < volts.size - 1]] = np.nan + 1j * np.nan
    frequency = np.linspace(1e6, 1e6 + 1, values.shape[1])
    usable = np.isfinite(volts).any(axis=1)
    tree = measurement.bundle({name: measurement.response(frequency, volts, noise_sd=noise)})
    measurement.write(tree, tmp_path / "any.nc")
    back = measurement.read(tmp_path / "any.nc")
    np.testing.assert_array_equal(
        measurement.amplitude(back[name].to_dataset()).values, volts[usable]
    )
    assert back[name].attrs["noise_sd"] == noise
    assert len(tree.attrs["repairs"]) == (not usable.all()) + bool(np.isnan(volts[usable]).any())


def test_repairs_stay_in_the_history_of_the_written_file(tmp_path: Path) -> None:
    dataset = measurement.spectrum([1e6, np.nan], [1.0, 1.0])
    tree = measurement.bundle({"s": dataset})
    measurement.write(tree, tmp_path / "s.nc")
    back = measurement.read(tmp_path / "s.nc")
    assert back.attrs["repairs"] == ()
    assert "left out: 1 of 2 (rows 1)" in back.attrs["history"]


def test_a_failed_write_leaves_the_earlier_file_and_no_litter(tmp_path: Path) -> None:
    (tmp_path / "s.nc").write_bytes(b"earlier")
    program = (
        "import resource\nfrom femnl import measurement\nfrom femnl.core.errors import "
        "MeasurementError\n"
        "tree = measurement.bundle({'s': measurement.spectrum([1e6], [1.0])})\n"
        # a disk with room for so many bytes of the file
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try:\n    measurement.write(tree, 's.nc')\nexcept MeasurementError as error:\n    "
        "print(error)\n"
    )
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (
        done.stdout
        == "s.nc: cannot be written (File too large); choose a folder that exists and has room\n"
    )
    assert done.stderr == ""
    assert (tmp_path / "s.nc").read_bytes() == b"earlier"
    assert [child.name for child in tmp_path.iterdir()] == ["s.nc"]


@pytest.mark.shared
@pytest.mark.skipif(not DATA.is_dir(), reason="the shared data are not beside the repository")
@pytest.mark.parametrize("path", sorted(DATA.glob("*.nc")), ids=lambda path: path.stem)
def test_open_data_are_read_clean_with_named_dimensions(path: Path) -> None:
    tree = measurement.read(path)
    assert tree.attrs["repairs"] == ()
    for node in tree.children.values():
        assert set(node.sizes) == set(measurement.KINDS[node.attrs["kind"]].dims)


@pytest.mark.parametrize(
    ("kind", "slack"), [("response", 0.06), ("map", 0.06), ("trace", 0.06), ("series", 0.25)]
)
def test_noise_estimated_from_the_data_is_the_noise_put_in(kind: str, slack: float) -> None:
    sd = 3e-4
    rng = np.random.default_rng(7)
    f = np.linspace(-10, 10, 801)
    line = 0.1 / (1 + 1j * (f[None] - np.array([[-1], [2], [0.5]])))
    axis = np.linspace(-1, 1, 91)
    bowl = 0.05 * np.sin(6 * np.outer(1 - axis**2, 1 - axis**2))[None] * np.ones((2, 1, 1))
    t = np.arange(4096) / 4096
    moments = np.sort(rng.uniform(0, 10, 120))
    wave = 0.2 * np.cos(2 * np.pi * 40 * t)[None] + 0.05 * np.cos(2 * np.pi * (120 * t + 0.3))

    def noisy(values: np.ndarray) -> np.ndarray:
        scatter = rng.normal(size=values.shape) * sd
        return np.asarray(
            values
            + scatter
            + (1j * rng.normal(size=values.shape) * sd if np.iscomplexobj(values) else 0)
        )

    datasets = {
        "response": measurement.response(1e6 + f, noisy(line)),
        "map": measurement.harmonic_map(axis, axis, [1, 2], noisy(bowl + 0j)),
        "trace": measurement.trace(t, noisy(wave), drive_frequency=[40.0]),
        "series": measurement.series({"time": moments}, noisy(1e6 + 0.01 * moments**2)),
    }
    estimate, sentence = measurement.noise_sd(datasets[kind])
    assert estimate == pytest.approx(sd, rel=slack)
    assert "estimated" in sentence


def test_noise_in_the_file_goes_before_an_estimate() -> None:
    sd, sentence = measurement.noise_sd(samples()["response"])
    assert sd == 1e-5
    assert "as stored" in sentence
