"""`femnl fit` from the command line.

Every kind of measurement, its figures, and one line for what cannot be.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from femnl.cli._main import run
from femnl.core.resonator import Resonator
from femnl.device.geometry import load
from femnl.diagnose import diagnose
from femnl.io import measurement
from femnl.observe.record.free_run import free_run, stages
from femnl.pipeline import solve_modes
from femnl.resonator import duffing_roots, ring_down

DEVICE = "rectangle"


@pytest.fixture(autouse=True)
def _own_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def fit(capsys: pytest.CaptureFixture[str]) -> Callable[..., dict[str, Any]]:
    """Run `femnl fit … --json`; the fits of the file by name."""

    def call(*words: str) -> dict[str, Any]:
        capsys.readouterr()
        assert run(["fit", *words, "--json"]) == 0, capsys.readouterr().err
        return dict(json.loads(capsys.readouterr().out)["fits"])

    return call


def written(folder: str) -> set[str]:
    """Names of the files in a folder, all of them of some size."""
    files = list(Path(folder).iterdir())
    assert all(file.stat().st_size > 4000 for file in files)
    return {file.name for file in files}


def test_an_overview_gives_a_labelled_spectrum_that_the_film_is_fitted_to(
    fit: Callable[..., dict[str, Any]],
) -> None:
    modes = solve_modes(load(DEVICE), 10)
    known = [k for k in range(6) if k != 3]
    f = np.linspace(
        0.8 * modes.frequency[0], 0.5 * 1.05 * (modes.frequency[5] + modes.frequency[6]), 4000
    )
    w = 2e-3 * modes.frequency[0]
    rng = np.random.default_rng(3)
    volts = 3e-4 * np.exp(1j * f / f[0]) + 1e-5 * (
        rng.normal(size=f.size) + 1j * rng.normal(size=f.size)
    )
    for k in known:
        g = 1.05 * modes.frequency[k]
        volts = volts + 1e-3 * g * w / (g**2 - f**2 + 1j * f * w)
    measurement.write(
        measurement.bundle(
            {"wide": measurement.response(f, volts, noise_sd=1e-5)}, geometry=DEVICE
        ),
        "s.nc",
    )
    found = fit("s.nc", "--as", "overview", "--out", "o")["wide"]["assignment"]
    assert found["label"] == [modes.label[k] for k in known]
    assert found["missing"] == [modes.label[3]]
    assert found["probability"] > 0.9
    assert found["runner_up"]["probability"] < 0.1
    assert abs(found["scale"] / 1.05 - 1) < 4 * found["scale_sd"]
    assert written("o") == {"s-wide-overview.png", "s-wide-spectrum.nc"}
    film = fit("o/s-wide-spectrum.nc", "--out", "o")["spectrum"]
    assert film["label"] == [modes.label[k] for k in known]
    assert abs(film["parameters"]["scale"]["value"] - 1.05) < 4 * film["parameters"]["scale"]["sd"]
    assert "s-wide-spectrum-spectrum-film.png" in written("o")


@pytest.mark.slow
def test_an_overview_of_modes_without_names_is_fitted_and_diagnosed(
    fit: Callable[..., dict[str, Any]],
) -> None:
    device = "circle"
    modes = solve_modes(load(device), 10)
    known = [0, 1, 3, 5]
    f = np.linspace(0.8 * modes.frequency[0], 1.08 * modes.frequency[5], 4000)
    rng = np.random.default_rng(3)
    volts = 1e-5 * (rng.normal(size=f.size) + 1j * rng.normal(size=f.size))
    w = 2e-3 * modes.frequency[0]
    for k in known:
        g = 1.05 * modes.frequency[k]
        volts = volts + 1e-3 * g * w / (g**2 - f**2 + 1j * f * w)
    wide = measurement.response(f, volts, noise_sd=1e-5)
    measurement.write(measurement.bundle({"wide": wide}, geometry=device), "s.nc")
    label = fit("s.nc", "--as", "overview", "--out", "o")["wide"]["assignment"]["label"]
    # The second and fourth line are pairs, of which either mode may be named
    assert label[0] == "mode 1"
    assert label[1] in ("mode 2", "mode 3")
    assert label[2] in ("mode 4", "mode 5")
    assert label[3] == "mode 6"
    film = fit("o/s-wide-spectrum.nc")["spectrum"]
    assert film["label"] == label
    scale = film["parameters"]["scale"]
    assert abs(scale["value"] - 1.05) < 4 * scale["sd"]
    assert diagnose("o/s-wide-spectrum.nc", effects=[]).verdict


def test_an_overview_without_a_device_lists_lines_without_labels(
    fit: Callable[..., dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    f = np.linspace(1e6, 2e6, 1000)
    rng = np.random.default_rng(3)
    volts = 1e-3 * 1.5e6 * 9e3 / (1.5e6**2 - f**2 + 9e3j * f) + 1e-5 * (
        rng.normal(size=1000) + 1j * rng.normal(size=1000)
    )
    measurement.write(
        measurement.bundle({"wide": measurement.response(f, volts, noise_sd=1e-5)}), "s.nc"
    )
    found = fit("s.nc", "--as", "overview")["wide"]
    assert found["lines"]["frequency"] == [
        pytest.approx(1.5e6, abs=4 * found["lines"]["frequency_sd"][0])
    ]
    assert "assignment" not in found
    assert run(["fit", "s.nc", "--as", "overview"]) == 0
    assert "lines carry no labels; give --geometry" in capsys.readouterr().out


def line_of_responses(path: str) -> None:
    """Up-sweeps at α_y/α_c = 4 and five places, the shape a cosine."""
    rng = np.random.default_rng(8)
    f0 = 1e6
    w = 100.0
    x = np.linspace(-100e-6, 100e-6, 5)
    f = f0 + np.linspace(-400, 700, 161)
    stiffening = 8 * np.sqrt(3) / 9 * 4
    roots = duffing_roots(2 * (f0 - f) / w, stiffening)
    size = np.where(np.isfinite(roots[2]), roots[2], roots[0])
    one = 1 / (2 * (f0 - f) / w + stiffening * size + 1j)
    volts = 1e-2 * np.cos(np.pi * x / 270e-6)[:, None] * one
    volts = volts + 2e-5 * (rng.normal(size=volts.shape) + 1j * rng.normal(size=volts.shape))
    data = measurement.response(
        np.tile(f, (5, 1)),
        volts,
        drive=[1.0] * 5,
        direction=[1] * 5,
        x=x,
        y=[0.0] * 5,
        noise_sd=2e-5,
    )
    measurement.write(measurement.bundle({"line": data}), path)


def test_a_line_scan_lists_every_place_and_finds_the_normalised_parameter_the_same_at_all(
    fit: Callable[..., dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    line_of_responses("l.nc")
    found = fit("l.nc", "--as", "line-scan", "--out", "o")["line"]
    assert found["positions"]["x"] == pytest.approx(np.linspace(-100e-6, 100e-6, 5))
    shape = np.cos(np.pi * np.array(found["positions"]["x"]) / 270e-6)
    np.testing.assert_allclose(
        np.array(found["positions"]["alpha_y"]) * shape**2,
        found["positions"]["alpha_y"][2],
        rtol=0.02,
    )
    assert found["uniform"]
    assert abs(found["mean"]["alpha_ratio"] - 4) < 4 * found["mean"]["alpha_ratio_sd"]
    assert written("o") == {"l-line-line-scan.png"}
    assert run(["fit", "l.nc", "--as", "line-scan"]) == 0
    assert "5 places, each fitted on its own" in capsys.readouterr().out
    together = fit("l.nc", "--out", "o", "--use", "phase-mod-pi")["line"]["parameters"]
    assert (
        abs(together["alpha_ratio"]["value"] - found["mean"]["alpha_ratio"])
        < 4 * together["alpha_ratio"]["sd"]
    )
    assert written("o") == {"l-line-line-scan.png", "l-line-fit.png"}


def test_ring_downs_and_their_envelopes_give_frequency_and_quality_factor(
    fit: Callable[..., dict[str, Any]],
) -> None:
    mode = Resonator(1e5, 2000.0, alpha=1e9)
    rng = np.random.default_rng(2)
    time = np.arange(40_000) / 1e6
    slow = 1e4 * ring_down(mode, 1e-6, time)
    volts = slow.real + 1e-4 * rng.normal(size=time.size)
    measurement.write(
        measurement.bundle({"decay": measurement.trace(time, volts[None], drive_frequency=[1e5])}),
        "d.nc",
    )
    found = fit("d.nc", "--as", "ring-down", "--out", "o")["decay"]["parameters"]
    for name, truth in (("frequency", 1e5), ("quality_factor", 2000.0)):
        assert abs(found[name]["value"] - truth) < 4 * found[name]["sd"]
        assert found[name]["sd"] < 0.02 * truth
    size = np.abs(slow[::50] + 1e-4 * (rng.normal(size=800) + 1j * rng.normal(size=800)))
    measurement.write(
        measurement.bundle(
            {"decay": measurement.trace(time[::50], size[None], drive_frequency=[1e5])}
        ),
        "e.nc",
    )
    found = fit("e.nc", "--as", "envelope", "--out", "o")["decay"]["parameters"]
    assert abs(found["quality_factor"]["value"] - 2000) < 4 * found["quality_factor"]["sd"]
    assert written("o") == {"d-decay-ring-down.png", "e-decay-ring-down.png"}


def driven_record(path: str) -> None:
    """Return a record of an oscillator of 60 Hz under a noisy drive, sampled at 1 kHz.

    With k₂, k₃ and an offset; it does not begin at rest.
    """
    rng = np.random.default_rng(6)
    spectrum = np.fft.rfft(rng.normal(size=1400))
    spectrum[np.fft.rfftfreq(1400, 1e-3) > 150] = 0
    drive = np.fft.irfft(spectrum, 1400) * np.where(np.arange(1400) < 800, 0.3, 0.2)
    k = (2 * np.pi * 60) ** 2
    coefficients = np.array([k, 0.01, 300.0, 0.0, k, 0.5 * k, 6.0 * k])[:, None]
    output = free_run(coefficients, stages(drive, 1e-3, "band-limited"))[
        0
    ].real + 1e-5 * rng.normal(size=1400)
    data = measurement.trace(
        np.arange(1200) * 1e-3, output[None, 200:], drive_voltage=drive[None, 200:]
    )
    measurement.write(measurement.bundle({"box": data}), path)


def test_an_oscillator_is_fitted_term_by_term_and_judged_on_what_was_held_out(
    fit: Callable[..., dict[str, Any]],
) -> None:
    driven_record("b.nc")
    models = fit("b.nc", "--as", "oscillator", "--held-out", "0:600", "--out", "o")["box"]["models"]
    assert [len(model["terms"]) for model in models] == [0, 1, 2, 3, 4]
    held_out = [model["rms_held_out"] for model in models]
    assert held_out[0] > held_out[1] > 2 * held_out[2] > 20 * held_out[3]
    assert held_out[3] == pytest.approx(1e-5, rel=0.3)
    assert models[3]["rms_fitted"] == pytest.approx(1e-5, rel=0.1)
    full = models[3]["parameters"]
    assert abs(full["alpha"]["value"] - 6.0) < 4 * full["alpha"]["sd"]
    assert full["frequency"]["value"] == pytest.approx(60, rel=1e-4)
    assert written("o") == {"b-box-oscillator.png"}


def test_harmonics_of_a_sweep_of_traces_are_drawn(fit: Callable[..., dict[str, Any]]) -> None:
    rng = np.random.default_rng(1)
    f = 1e6 + np.linspace(-300, 300, 7)
    time = np.arange(512) / 1e8
    volts = np.array(
        [np.cos(2 * np.sin(2 * np.pi * g * time) + 0.5) for g in f]
    ) + 1e-4 * rng.normal(size=(7, 512))
    measurement.write(
        measurement.bundle({"scope": measurement.trace(time, volts, drive_frequency=f)}), "t.nc"
    )
    found = fit("t.nc", "--harmonics", "6", "--out", "o")["scope"]
    # |V_1| = 2 J_1(2) |sin 0.5| by Jacobi and Anger.
    assert np.hypot(found["real"][1][0], found["imag"][1][0]) == pytest.approx(
        2 * 0.5767248 * np.sin(0.5), abs=1e-4
    )
    one = measurement.trace(time, volts[:1], drive_frequency=f[:1], wavelength=632.8e-9)
    measurement.write(measurement.bundle({"scope": one}, geometry=DEVICE), "one.nc")
    motion = fit("one.nc", "--harmonics", "6", "--out", "o")["scope, motion"]
    # cos(2 sin ωt + ½) is a fringe at θ = ½ with z = 4πU/λ = 2.
    assert motion["amplitude"] == [
        pytest.approx(2 * 632.8e-9 / (4 * np.pi), abs=4 * motion["amplitude_sd"][0])
    ]
    assert written("o") == {"t-scope-harmonics.png", "one-scope-harmonics.png"}


def test_maps_are_drawn_beside_their_fit(fit: Callable[..., dict[str, Any]]) -> None:
    assert (
        run(["maps", DEVICE, "--z", "3", "--points", "15", "--harmonics", "3", "--out", "m.nc"])
        == 0
    )
    found = fit("m.nc", "--out", "o")["map"]["parameters"]
    assert found["modulation"]["value"] == pytest.approx(3, rel=1e-3)
    assert written("o") == {"m-map-fit.png"}


def test_a_fit_of_maps_with_noise_leaves_that_noise(fit: Callable[..., dict[str, Any]]) -> None:
    words = ["maps", DEVICE, "--z", "3", "--points", "31", "--harmonics", "3", "--out", "m.nc"]
    assert run([*words, "--noise", "3 mV", "--seed", "7"]) == 0
    found = fit("m.nc", "--out", "o")["map"]
    assert found["chi2_reduced"] == pytest.approx(1, abs=0.1)
    modulation = found["parameters"]["modulation"]
    assert modulation["value"] == pytest.approx(3, abs=5 * modulation["sd"])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ["--as", "magic"],
            "--as magic: expected one of overview, line-scan, ring-down, envelope, oscillator, "
            "decay",
        ),
        (["--as", "overview"], "--as overview: takes a response, but b.nc holds trace"),
        (["--held-out", "0:10"], "--held-out: is for oscillator, and has no effect on trace"),
        (
            ["--as", "oscillator", "--fringe", "sine"],
            "--fringe: is for map and trace, and has no effect on oscillator",
        ),
        (
            ["--as", "oscillator", "--held-out", "10"],
            "--held-out 10: expected FIRST:END in samples, such as 0:40000",
        ),
        (
            ["--as", "oscillator", "--held-out", "9:9000"],
            "--held-out 9:9000: box has only 1200 samples",
        ),
        (["--mode", "0"], "--mode 0: modes are counted from 1"),
    ],
)
def test_what_cannot_be_fitted_is_one_line_and_status_2(
    words: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    driven_record("b.nc")
    assert run(["fit", "b.nc", *words]) == 2
    captured = capsys.readouterr()
    assert captured.err.splitlines() == [f"femnl: {expected}"]
    assert not captured.out


def test_an_oscillator_without_its_drive_and_a_line_of_one_place_are_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    trace = measurement.trace(
        np.arange(500) * 1e-3, np.zeros((2, 500)), drive_frequency=[10.0, 11.0]
    )
    measurement.write(measurement.bundle({"box": trace}), "t.nc")
    assert run(["fit", "t.nc", "--as", "oscillator"]) == 2
    assert (
        "an oscillator is fitted to one step with its drive_voltage, here are 2 steps without it"
        in capsys.readouterr().err
    )
    series = measurement.series({"pressure": [1.0, 2.0]}, [1e6, 1e6], [1.0, 1.0])
    measurement.write(measurement.bundle({"leak": series}), "s.nc")
    assert run(["fit", "s.nc"]) == 2
    assert "2 usable points of frequency; a law needs 3" in capsys.readouterr().err


def test_a_drive_of_many_tones_is_no_sine_with_harmonics(
    capsys: pytest.CaptureFixture[str],
) -> None:
    driven_record("b.nc")
    assert run(["fit", "b.nc"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("femnl: drive_voltage: the best sine")
    assert "so it has no harmonics; fit an oscillator (--as oscillator)" in line


@pytest.mark.slow
def test_a_wide_sweep_read_as_one_mode_is_told_so(capsys: pytest.CaptureFixture[str]) -> None:
    f = np.linspace(1e6, 2e6, 600)
    rng = np.random.default_rng(3)
    volts = sum(1e-3 * g * 9e3 / (g**2 - f**2 + 9e3j * f) for g in (1.2e6, 1.5e6, 1.8e6))
    volts = volts + 1e-5 * (rng.normal(size=600) + 1j * rng.normal(size=600))
    measurement.write(
        measurement.bundle({"wide": measurement.response(f, volts, noise_sd=1e-5)}), "s.nc"
    )
    assert run(["fit", "s.nc"]) == 0
    assert (
        capsys.readouterr().err
        == "wide: one mode does not explain this wide sweep; --as overview finds its lines, "
        "--modes N fits so many\n"
    )


def test_every_fit_of_the_commands_page_is_understood(capsys: pytest.CaptureFixture[str]) -> None:
    page = Path(__file__).parents[2] / "docs" / "reference" / "commands.md"
    lines = [line.strip() for line in page.read_text(encoding="utf-8").splitlines()]
    commands = [line.split("#")[0].split()[1:] for line in lines if line.startswith("femnl fit ")]
    assert len(commands) > 8
    for words in commands:
        assert run(words) == 2
        assert capsys.readouterr().err == f"femnl: {words[1]}: no such file; check the path\n"


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_noise_of_traces_that_is_not_white_is_told(
    rho: float, capsys: pytest.CaptureFixture[str]
) -> None:
    time = np.arange(1024) / 125e6
    white = np.random.default_rng(4).standard_normal((4, 1024))
    noise = lfilter([np.sqrt(1 - rho**2)], [1.0, -rho], white, axis=-1)
    volts = 0.02 * np.cos(2 * np.pi * 1.466e6 * time) + 3e-4 * noise
    data = measurement.trace(time, volts, drive_frequency=np.full(4, 1.466e6))
    measurement.write(measurement.bundle({"scope": data}), "t.nc")
    assert run(["fit", "t.nc"]) == 0
    assert ("the noise is not white" in capsys.readouterr().out) == (rho > 0)
