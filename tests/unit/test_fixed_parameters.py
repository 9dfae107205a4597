"""Parameters that are held: in every kind of fit, in Python and by `femnl fit --fix`.

A parameter that is held at its own optimum leaves all others where they are, and their covariance
becomes that given this parameter: C_aa − C_ab C_ba/C_bb, the Schur complement.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from femnl.cli._main import run
from femnl.core.device import Film
from femnl.core.errors import ParameterError
from femnl.core.fit import Fit
from femnl.fits.decay.power import fit_decay
from femnl.fits.decay.ringdown import fit_ringdown
from femnl.fits.map.fit import fit_map
from femnl.fits.record.oscillator import fit_oscillator
from femnl.fits.record.terms import fit_terms
from femnl.fits.response.fit import fit_response
from femnl.fits.response.linescan import fit_line_scan
from femnl.fits.response.modes import fit_modes
from femnl.fits.series.law import fit_series
from femnl.fits.spectrum.film import fit_film
from femnl.fits.trace.decompose import decompose
from femnl.fits.trace.spot import fit_spot
from femnl.io import measurement
from femnl.optics.fringe import SineFringe
from femnl.optics.harmonics import harmonics, trace

Array = NDArray[np.float64]
Fixed = Mapping[str, float]
RED = 632.8e-9
SIDE = 270e-6
FRINGE = SineFringe(RED, 0.1, 0.02, 0.6)
FILM = Film(thickness=1e-7, young=2.5e11, poisson=0.23, density=3000.0, stress=1e9)
RATE = 610.0


def a_series(fixed: Fixed) -> Fit:
    x = np.linspace(280, 320, 12)
    y = 1e4 - 0.03 * (x - 300) + 0.01 * np.random.default_rng(1).normal(size=12)
    sd = np.linspace(0.005, 0.02, 12)
    return fit_series(measurement.series({"temperature": x}, y, sd), "power", fixed=fixed)[0].fit


def a_response(fixed: Fixed) -> Fit:
    return fit_response(sweep(), background="constant", duffing=False, delay=False, fixed=fixed)


def sweep(places: int = 1) -> xr.Dataset:
    """A linear line on a background, at one place or more."""
    rng = np.random.default_rng(2)
    f = np.linspace(1e6 - 500, 1e6 + 500, 81)
    volts = 1e6 * 100 / ((1e6 - f) * (1e6 + f) + 1j * f * 100) + 0.05 + 0.02j
    clean = np.array([volts * (1 + k) for k in range(places)])
    noise = 5e-3 * (rng.normal(size=clean.shape) + 1j * rng.normal(size=clean.shape))
    x = 1e-6 * np.arange(places)
    return measurement.response(f, clean + noise, drive=1.0, x=x, y=0.0, noise_sd=5e-3)


def a_ringdown(fixed: Fixed) -> Fit:
    rng = np.random.default_rng(3)
    time = np.linspace(0, 0.4, 8000)
    volts = 0.2 * np.exp(-8.0 * time) * np.cos(2 * np.pi * 2e3 * time + 0.4)
    noisy = volts + 2e-3 * rng.normal(size=time.size)
    return fit_ringdown(time, noisy, nonlinear=False, noise_sd=2e-3, fixed=fixed)


def a_decay(fixed: Fixed) -> Fit:
    return fit_decay(decay_record(), fixed=fixed).fit


def decay_record() -> xr.Dataset:
    """A decay of Q = 10⁶ at 1 MHz into its floor."""
    rng = np.random.default_rng(4)
    time = np.arange(500) * 2e-3
    noise = 1e-3 * (rng.normal(size=500) + 1j * rng.normal(size=500))
    level = np.where(time < 0.1, 1.0, np.exp(-np.pi * (time - 0.1)))
    wander = 1 + 0.02 * rng.normal(size=500)
    power = 20 * np.log10(np.abs(level * wander + noise))
    return measurement.decay(time, power, attributes={"frequency": 1e6})


def a_film(fixed: Fixed) -> Fit:
    rng = np.random.default_rng(5)
    simulated = 1e6 * np.array([1.41, 2.2, 2.9, 3.2, 3.6])
    labels = ["(1,1)", "(1,2)", "(2,1)", "(2,2)", "(1,3)"]
    f = 1.05 * simulated * (1 + 1e-3 * rng.normal(size=5))
    plain = [label.strip("()") for label in labels]
    data = measurement.spectrum(f, np.full(5, 50.0), plain)
    return fit_film(data, labels, simulated, FILM, fixed).fit


def square(x: Array, y: Array) -> Array:
    inside = (np.abs(x) < SIDE / 2) & (np.abs(y) < SIDE / 2)
    return np.where(inside, np.cos(np.pi * x / SIDE) * np.cos(np.pi * y / SIDE), 0.0)


def a_map(fixed: Fixed) -> Fit:
    return fit_map(maps(), square, registration=("x", "y", "scale"), fixed=fixed).fit


def maps(seed: int = 6) -> xr.Dataset:
    """Harmonics 1f … 4f of a film that moves by 300 nm."""
    rng = np.random.default_rng(seed)
    axis = np.linspace(-160e-6, 160e-6, 21)
    xi = square(*np.meshgrid(axis - 3e-6, axis))
    n = np.arange(1, 5)
    clean = harmonics(FRINGE, n, 3e-7 * xi, 0.3)
    noise = 3e-4 * (rng.normal(size=clean.shape) + 1j * rng.normal(size=clean.shape))
    return measurement.harmonic_map(axis, axis, n, clean + noise, noise_sd=3e-4, wavelength=RED)


def a_spot(fixed: Fixed) -> Fit:
    return fit_spot(decompose(traces(), 12), RED, fixed=fixed).fit


def traces(size: float = 4e-7) -> xr.Dataset:
    """Nine steps of a drive through a resonance, of that amplitude [m]."""
    rng = np.random.default_rng(7)
    detuning = np.linspace(-3, 3, 9)
    time = np.arange(1024) / 125e6
    f = 1.466e6 + 70 * detuning
    rows = zip(f, size / np.hypot(1, detuning), strict=True)
    clean = np.array([trace(FRINGE, time, one, moves, 0.2) for one, moves in rows])
    noisy = clean + 1e-3 * rng.normal(size=clean.shape)
    return measurement.trace(time, noisy, drive_frequency=f, noise_sd=1e-3, wavelength=RED)


def an_oscillator(fixed: Fixed) -> Fit:
    drive, output = driven()
    return fit_oscillator(drive, output, RATE, (), hold="zero-order", fixed=fixed)


def driven() -> tuple[Array, Array]:
    """A linear oscillator under a drive that is held between samples, by its exact recursion."""
    rng = np.random.default_rng(8)
    drive = 0.1 * rng.normal(size=1200)
    mass, damping, stiffness = 5e-6, 4e-4, 0.98
    dynamics = np.array([[0, 1], [-stiffness / mass, -damping / mass]])
    size, vectors = np.linalg.eig(dynamics)
    step = (vectors @ np.diag(np.exp(size / RATE)) @ np.linalg.inv(vectors)).real
    push = np.linalg.solve(dynamics, step - np.eye(2)) @ np.array([0, 1 / mass])
    state = np.zeros(2)
    output = np.zeros(drive.size)
    for k in range(drive.size - 1):
        state = step @ state + push * drive[k]
        output[k + 1] = state[0]
    return drive, output + 1e-3 * rng.normal(size=drive.size)


KINDS: dict[str, tuple[Callable[[Fixed], Fit], str, float]] = {
    "series": (a_series, "exponent", 1e-6),
    "response": (a_response, "linewidth", 1e-4),
    "ring-down": (a_ringdown, "decay_rate", 1e-3),
    "ring-down, frequency": (a_ringdown, "frequency", 1e-3),
    "decay": (a_decay, "decay_rate", 0.06),
    "decay, floor": (a_decay, "floor", 0.02),
    "map": (a_map, "contrast", 1e-3),
    "map, amplitude": (a_map, "amplitude", 1e-3),
    "map, placement": (a_map, "scale", 1e-3),
    "oscillator": (an_oscillator, "mass", 1e-3),
}
"""Each kind with a parameter and by how much rounding and correlated noise may change errors."""


@pytest.mark.parametrize("kind", list(KINDS))
def test_holding_a_parameter_at_its_optimum_leaves_the_conditional_errors(kind: str) -> None:
    fit, name, close = KINDS[kind]
    free = fit({})
    held = fit({name: free[name]})
    assert held.parameters[name].sd == 0
    assert held[name] == pytest.approx(free[name], rel=1e-12, abs=0)
    assert held.n_parameters == free.n_parameters - 1
    names = list(free.parameters)[: free.n_parameters]
    at = names.index(name)
    others = [k for k in range(len(names)) if k != at]
    assert list(held.parameters)[: held.n_parameters] == [names[k] for k in others]
    given = free.covariance[np.ix_(others, others)]
    given = (
        given
        - np.outer(free.covariance[others, at], free.covariance[at, others])
        / (free.covariance[at, at])
    )
    # Errors that are scaled by what is left count one parameter less
    scale = held.chi2_reduced / free.chi2_reduced if _scaled(free) else 1.0
    sd = np.sqrt(np.diag(given) * scale)
    np.testing.assert_allclose(
        np.sqrt(np.diag(held.covariance)), sd, rtol=close + 1e-2 * (scale != 1)
    )
    for k, size in zip(others, sd, strict=True):
        assert abs(held[names[k]] - free[names[k]]) < 0.02 * size + 1e-9 * abs(free[names[k]])
        assert held.parameters[names[k]].sd <= free.parameters[names[k]].sd * (1 + close)
    assert any(name in note for note in held.notes if note.startswith("held at a given value"))


def _scaled(fit: Fit) -> bool:
    return any("scaled" in note for note in fit.notes)


def test_the_error_of_a_line_through_a_held_slope_is_that_of_a_mean() -> None:
    rng = np.random.default_rng(9)
    x = np.linspace(0, 1, 25)
    y = 1e6 + 40.0 * x + 2.0 * rng.normal(size=25)
    data = measurement.series({"voltage": x}, y, np.full(25, 2.0))
    (free,) = fit_series(data)
    (held,) = fit_series(data, fixed={"slope": 40.0})
    (through,) = fit_series(data, fixed={"value": 1e6 + 20.0})
    assert held.fit["value"] == pytest.approx(np.mean(y - 40.0 * (x - 0.5)), rel=1e-12)
    assert held.fit.parameters["value"].sd == pytest.approx(2 / np.sqrt(25), rel=1e-9)
    exact = 2 / np.sqrt(np.sum((x - 0.5) ** 2))
    assert through.fit.parameters["slope"].sd == pytest.approx(exact, rel=1e-9)
    assert free.fit.n_parameters == held.fit.n_parameters + 1 == 2


def test_a_wrong_value_shows_as_misfit() -> None:
    assert a_ringdown({"decay_rate": 12.0}).chi2_reduced > 2 * a_ringdown({}).chi2_reduced
    assert a_map({"amplitude": 2e-7}).chi2_reduced > 3


def test_the_motion_at_a_spot_is_surer_where_the_contrast_is_known() -> None:
    # So little motion, z = 0.8, hardly tells its size from the contrast
    spectrum = decompose(traces(4e-8), 4)
    free = fit_spot(spectrum, RED)
    held = fit_spot(spectrum, RED, fixed={"contrast": 0.02})
    assert held.fit.parameters["contrast"].sd == 0
    assert held.fit["contrast"] == 0.02
    assert np.all(held.amplitude_sd < free.amplitude_sd)
    assert held.amplitude_sd[4] < 0.5 * free.amplitude_sd[4]
    known = np.abs(held.amplitude - 4e-8 / np.hypot(1, np.linspace(-3, 3, 9)))
    assert np.all(known < 4.5 * held.amplitude_sd)
    both = fit_spot(spectrum, RED, fixed={"contrast": 0.02, "fringe_phase": 0.6})
    assert both.fit.n_parameters == free.fit.n_parameters - 2
    assert both.fit.covariance.shape == (0, 0)


@pytest.mark.parametrize("turn", [(-1.0, np.pi), (1.0, 0.0)])
def test_a_map_keeps_the_signs_that_are_held(turn: tuple[float, float]) -> None:
    sign, shift = turn
    fixed = {"contrast": sign * 0.02, "fringe_phase": 0.6 + shift}
    found = a_map(fixed)
    assert found.chi2_reduced == pytest.approx(1, abs=0.15)
    assert {name: found[name] for name in fixed} == fixed
    assert abs(found["amplitude"] - 3e-7) < 4 * found.parameters["amplitude"].sd


def test_of_several_maps_the_name_of_one_goes_with_it() -> None:
    pair = {"a": maps(6), "b": maps(7)}
    found = fit_map(pair, square, registration=("x", "y"), fixed={"contrast:b": 0.02}).fit
    assert found.parameters["contrast:b"].sd == 0
    assert 0 < found.parameters["contrast:a"].sd < np.inf


def test_a_film_is_held_by_its_stress_or_its_speed_alike() -> None:
    free = a_film({})
    by = {
        "stress": 1e9 * 1.05**2,
        "wave_speed": 1.05 * float(np.sqrt(1e9 / 3000)),
        "scale": 1.05,
    }
    for name, value in by.items():
        found = a_film({name: value})
        assert found["scale"] == pytest.approx(1.05, rel=1e-12)
        assert found.parameters["stress"].sd == found.parameters["scale"].sd == 0
        assert found.n_parameters == 0
        # The scatter about a mean that is known has one degree of freedom more
        assert found.parameters["scatter"].sd == pytest.approx(found["scatter"] / np.sqrt(10))
    assert a_film({"scatter": 0.0}).parameters["scale"].sd < free.parameters["scale"].sd
    with pytest.raises(ParameterError, match="scale and stress are one parameter of a film"):
        a_film({"stress": 1e9, "scale": 1.0})


def test_modes_and_places_of_a_response_are_held_by_their_number() -> None:
    f = np.linspace(1e6 - 800, 1e6 + 800, 161)
    pair = ((1e6 - 200, 60.0, 1.0), (1e6 + 150, 80.0, 0.5))
    volts = sum(size * f0 * w / ((f0 - f) * (f0 + f) + 1j * f * w) for f0, w, size in pair)
    rng = np.random.default_rng(10)
    noise = 4e-3 * (rng.normal(size=161) + 1j * rng.normal(size=161))
    data = measurement.response(f, volts + noise, drive=1.0, noise_sd=4e-3)
    free = fit_modes(data, 2).fit
    held = fit_modes(data, 2, fixed={"linewidth[2]": 80.0, "phase[1]": 0.0}).fit
    assert held["linewidth[2]"] == 80.0
    assert held.parameters["linewidth[2]"].sd == held.parameters["phase[1]"].sd == 0
    assert held.parameters["quality_factor[2]"].sd < free.parameters["quality_factor[2]"].sd
    for name, truth in (("frequency[1]", 1e6 - 200), ("amplitude[2]", 0.5), ("linewidth[1]", 60.0)):
        assert abs(held[name] - truth) < 4.5 * held.parameters[name].sd
        assert held.parameters[name].sd < 1.02 * free.parameters[name].sd
    scan = fit_line_scan(sweep(3), fixed={"linewidth": 100.0, "alpha_ratio": 0.0})
    assert np.all(scan["linewidth_sd"].values == 0)
    assert scan.attrs["alpha_ratio"] == scan.attrs["alpha_ratio_sd"] == 0


def test_terms_of_an_oscillator_are_held_in_every_model_that_has_them() -> None:
    drive, output = driven()
    data = measurement.trace(
        np.arange(1200) / RATE, output, drive_voltage=drive, drive_frequency=None
    )
    models = fit_terms(data, fixed={"mass": 5e-6, "cubic": 0.0})
    assert all(model.fit.parameters["mass"].sd == 0 for model in models)
    assert models[-1].fit.parameters["cubic"].sd == 0
    assert models[-1].fit.n_parameters == 5


UNKNOWN: dict[str, Callable[[Fixed], object]] = {
    "a series with the law power; it has value, exponent": a_series,
    "a response; it has frequency, linewidth, alpha_ratio,": a_response,
    "a ring-down; it has amplitude, decay_rate, phase, frequency, offset": a_ringdown,
    "this decay; it has level, decay_rate, floor, wander": a_decay,
    "a film; it has scale, wave_speed, stress, scatter": a_film,
    "these maps; it has amplitude, contrast, fringe_phase, motion_phase, x, y, scale": a_map,
    "the motion at a spot; it has contrast, fringe_phase": a_spot,
    "this oscillator; it has mass, damping, stiffness": an_oscillator,
}


@pytest.mark.parametrize("told", list(UNKNOWN))
def test_an_unknown_name_is_one_line_that_lists_the_names(told: str) -> None:
    with pytest.raises(ParameterError) as caught:
        UNKNOWN[told]({"nonsense": 1.0})
    assert str(caught.value).startswith(f"fixed: 'nonsense' is no parameter of {told}")
    assert "\n" not in str(caught.value)


def test_nothing_left_to_fit_and_no_number_are_one_line_each() -> None:
    with pytest.raises(ParameterError, match="nothing of the law power is left to fit"):
        a_series({"value": 1.0, "exponent": 1.0})
    with pytest.raises(ParameterError, match="decay_rate = nan: give a finite number"):
        a_ringdown({"decay_rate": np.nan})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of each kind."""
    path = tmp_path_factory.mktemp("files")
    voltage = np.linspace(-1, 1, 15)
    groups = {
        "series": measurement.series(
            {"voltage": voltage}, 1e6 + 40 * voltage + np.sin(7 * voltage), np.ones(15)
        ),
        "decay": decay_record(),
        "trace": traces(),
        "response": sweep(),
        "map": maps(),
    }
    for name, data in groups.items():
        tree = measurement.bundle({name: data}, geometry="square-270um")
        measurement.write(tree, path / f"{name}.nc")
    time = np.linspace(0, 0.4, 4000)
    volts = np.exp(-8.0 * time) * np.cos(2e3 * np.pi * time) + 1e-3 * np.sin(77e3 * time)
    ring = measurement.trace(time, volts, drive_frequency=1e3)
    measurement.write(measurement.bundle({"ring": ring}), path / "ring.nc")
    return path


@pytest.mark.parametrize(
    ("words", "name", "expected"),
    [
        (["series.nc", "--fix", "slope=0.04 Hz/mV"], "slope", 40.0),
        (["decay.nc", "--fix", "decay_rate=6.4"], "decay_rate", 6.4),
        (["trace.nc", "--fix", "contrast=21 mV"], "contrast", 0.021),
        (["response.nc", "--fix", "linewidth=0.1 kHz"], "linewidth", 100.0),
        (["response.nc", "--modes", "1", "--fix", "linewidth[1]=0.1 kHz"], "linewidth[1]", 100.0),
        (["map.nc", "--fix", "amplitude=290 nm"], "amplitude", 290e-9),
        (["ring.nc", "--as", "ring-down", "--fix", "frequency=1 kHz"], "frequency", 1e3),
    ],
)
def test_the_command_line_holds_values_with_their_units(
    words: list[str],
    name: str,
    expected: float,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    assert run(["fit", *words, "--json"]) == 0, capsys.readouterr().err
    fits: dict[str, Any] = json.loads(capsys.readouterr().out)["fits"]
    (found,) = [
        fit["parameters"][name] for fit in fits.values() if name in fit.get("parameters", {})
    ]
    assert found["value"] == pytest.approx(expected, rel=1e-12, abs=0)
    assert found["sd"] == 0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["series.nc", "--fix", "slop=1"], "'slop' is no parameter of a series with the law line"),
        (["series.nc", "--fix", "slope=1 kg"], "--fix slope: unit 'kg' is not a unit of this"),
        (["decay.nc", "--fix", "decay_rate=fast"], "--fix decay_rate: 'fast' is not a quantity"),
        (["map.nc", "--fix", "nonsense=1 m"], "'nonsense' is no parameter of these maps"),
        (["map.nc", "--fix", "amplitude=-1"], "amplitude = -1 m: no film is read as far as"),
        (["trace.nc", "--fix", "amplitude=1 nm"], "'amplitude' is no parameter of the motion"),
        (["trace.nc", "--fix", "contrast"], "--fix contrast: expected NAME=VALUE"),
        (
            ["response.nc", "--as", "overview", "--fix", "frequency=1 MHz"],
            "--fix: is for response and line-scan and spectrum",
        ),
    ],
)
def test_what_cannot_be_held_is_one_line(
    words: list[str],
    expected: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    assert run(["fit", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
