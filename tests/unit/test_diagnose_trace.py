"""Traces: harmonics of a fringe at one spot, and free runs of one oscillator.

Nothing is found where nothing is hidden.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

from femnl.core.diagnosis import Diagnosis
from femnl.core.errors import MeasurementError
from femnl.device.geometry import load
from femnl.diagnose import diagnose
from femnl.diagnose.criticism import criticise
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import fit
from femnl.fits.trace.pose import pose as pose_trace
from femnl.io import measurement
from femnl.observe.extended import ExtendedModel
from femnl.observe.film import SimulatedFilm

Array = NDArray[np.float64]
GEOMETRY = "square-270um"
WAVELENGTH = 632.8e-9
CONTRAST = 0.02
NOISE = 5e-4
STEPS = 8
SAMPLES = 600
TAU = 1.5e-8
OVERTONE = 5e-9
LIMIT = 0.85


@cache
def fundamental() -> float:
    """Frequency of the film's lowest mode."""
    return float(SimulatedFilm(load(GEOMETRY), 12).modes.frequency[0])


def voltage(cause: str, phase: Array, amplitude: float) -> Array:
    """V(t) at phases of the drive.

    Harmonics of the motion and of the detector are summed one by one.
    """
    u = amplitude * np.cos(phase)
    if cause == "mechanical_overtones":
        u = u + OVERTONE * (amplitude / 4e-7) ** 2 * np.cos(2 * phase + 0.4)
    v = CONTRAST * np.cos(4 * np.pi / WAVELENGTH * u + 0.8)
    if cause == "detector_saturation":
        v = np.clip(v, -LIMIT * CONTRAST, LIMIT * CONTRAST)
    return v


def slowed(phase: Array, amplitude: float, omega: float) -> Array:
    """The same behind a low pass, which answers each harmonic with its own lag."""
    turn = 2 * np.pi * np.arange(256) / 256
    series = np.fft.rfft(voltage("", turn, amplitude)) / 128
    lag = 1 / (1 + 1j * np.arange(40) * omega * TAU)
    return np.asarray(
        series[0].real / 2
        + sum((series[n] * lag[n] * np.exp(1j * n * phase)).real for n in range(1, 40))
    )


def traces(cause: str, path: Path) -> Diagnosis:
    """Diagnose traces at steps of the drive through a resonance."""
    rng = np.random.default_rng(4)
    time = np.arange(SAMPLES) / (60 * fundamental())
    frequency = fundamental() + np.linspace(-15, 15, STEPS)
    rows = []
    for step, f in enumerate(frequency):
        amplitude = 4e-7 / np.hypot(1, (f - fundamental()) / 6)
        phase = 2 * np.pi * f * time - 0.4 * step
        row = (
            slowed(phase, amplitude, 2 * np.pi * f)
            if cause == "detector_bandwidth"
            else voltage(cause, phase, amplitude)
        )
        if cause == "crosstalk":
            row = row + 3e-4 * np.cos(2 * np.pi * f * time + 1.0)
        rows.append(row + NOISE * rng.standard_normal(SAMPLES))
    trace = measurement.trace(
        time, np.array(rows), drive_frequency=frequency, noise_sd=NOISE, wavelength=WAVELENGTH
    )
    measurement.write(measurement.bundle({"spot": trace}, geometry=GEOMETRY), path)
    return diagnose(path)


def test_traces_of_a_sine_are_adequate(tmp_path: Path) -> None:
    found = traces("", tmp_path / "trace.nc")
    assert (found.verdict, found.causes) == ("adequate", ()), found.where
    amplitude = found.parameters["base"]["amplitude[3]"]
    truth = 4e-7 / np.hypot(1, 15 / 7 / 6)
    assert abs(amplitude.value - truth) < 4 * amplitude.sd


@pytest.mark.parametrize(
    ("cause", "parameter", "truth"),
    [
        ("mechanical_overtones", "cos2", OVERTONE * np.cos(0.4) / (1 + (15 / 7 / 6) ** 2)),
        ("detector_bandwidth", "time_constant", TAU),
        ("crosstalk", "real", 3e-4 * np.cos(1.0)),
        pytest.param("detector_saturation", "clipped", 1 - LIMIT, marks=pytest.mark.slow),
    ],
)
def test_a_cause_hidden_in_traces_is_named_with_its_size(
    cause: str, parameter: str, truth: float, tmp_path: Path
) -> None:
    found = traces(cause, tmp_path / "trace.nc")
    assert (found.verdict, found.causes) == ("explained", (cause,)), (
        found.where,
        found.alternatives,
    )
    size = found.parameters[cause][parameter]
    assert abs(size.value - truth) < 4 * size.sd + 0.02 * abs(truth)
    assert found.gain > 1


@pytest.mark.parametrize("deviation", ["", "term cos 3φ of the fringe", "cos motion at 2f"])
def test_a_fringe_or_a_motion_of_another_form_is_seen_without_a_cause_to_look_for(
    deviation: str,
) -> None:
    rng = np.random.default_rng(4)
    time = np.arange(SAMPLES) / (60 * fundamental())
    frequency = fundamental() + np.linspace(-15, 15, STEPS)
    amplitude = 4e-7 / np.hypot(1, (frequency - fundamental()) / 6)[:, None]
    turn = 2 * np.pi * frequency[:, None] * time
    u = amplitude * (np.cos(turn) + 2e-3 * (deviation == "cos motion at 2f") * np.cos(2 * turn))
    phase = 4 * np.pi / WAVELENGTH * u + 0.8
    volts = CONTRAST * (
        np.cos(phase) + 4e-3 * (deviation == "term cos 3φ of the fringe") * np.cos(3 * phase)
    )
    volts = volts + NOISE * rng.standard_normal(volts.shape)
    trace = measurement.trace(
        time, volts, drive_frequency=frequency, noise_sd=NOISE, wavelength=WAVELENGTH
    )
    base_model = pose_trace(trace, SimulatedFilm(load(GEOMETRY), 12))
    found = criticise(fit(ExtendedModel(base_model), base_model.start), [])
    assert (found.p_value < THRESHOLDS.base_inadequate) == bool(deviation), (
        found.p_value,
        found.worst,
    )
    assert not deviation or found.worst == deviation


def record(path: Path, quadratic: float) -> Diagnosis:
    """Diagnose a record of an oscillator with cubic stiffness under a noisy drive.

    It is simulated by adaptive integration.
    """
    rate = 610.0
    count = 2400
    rng = np.random.default_rng(1)
    spectrum = np.fft.rfft(rng.normal(size=count))
    spectrum[np.fft.rfftfreq(count, 1 / rate) > 150] = 0
    drive = 0.1 * np.fft.irfft(spectrum, count)
    spline = make_interp_spline(np.arange(count), drive, k=5)
    time = np.arange(count) / rate

    def rates(t: float, s: Array) -> list[float]:
        y, v = s
        return [
            v,
            (float(spline(t * rate)) - 3e-4 * v - 0.98 * (y + quadratic * y**2 + 4.0 * y**3))
            / 5.2e-6,
        ]

    output = solve_ivp(
        rates,
        (0, time[-1]),
        [0.0, 0.0],
        "DOP853",
        rtol=1e-9,
        atol=1e-11,
        t_eval=time,
        max_step=1 / rate,
    ).y[0]
    noisy = output + 2e-4 * rng.standard_normal(count)
    trace = measurement.trace(time, noisy[None], drive_voltage=drive[None], noise_sd=2e-4)
    measurement.write(measurement.bundle({"record": trace}, geometry=GEOMETRY), path)
    return diagnose(path)


@pytest.mark.slow
def test_a_record_of_a_duffing_oscillator_is_adequate_and_its_notes_say_what_the_cubic_term_buys(
    tmp_path: Path,
) -> None:
    found = record(tmp_path / "record.nc", 0.0)
    assert (found.verdict, found.causes) == ("adequate", ()), found.where
    alpha = found.parameters["base"]["alpha"]
    assert abs(alpha.value - 4.0) < 4 * alpha.sd + 1e-3
    assert any("the cubic term of the base model lowers that" in note for note in found.notes)


def test_a_quadratic_force_in_a_record_is_named(tmp_path: Path) -> None:
    found = record(tmp_path / "record.nc", -0.15)
    assert (found.verdict, found.causes) == ("explained", ("quadratic_stiffness",)), (
        found.where,
        found.alternatives,
    )
    kappa = found.parameters["quadratic_stiffness"]["kappa2"]
    assert kappa.unit == "V^-1"
    assert abs(kappa.value + 0.15) < 4 * kappa.sd + 1e-3


def test_a_trace_without_wavelength_or_drive_is_refused_with_the_remedy(tmp_path: Path) -> None:
    trace = measurement.trace(np.arange(64) / 64e6, np.ones((2, 64)), drive_frequency=[1e6, 1.1e6])
    measurement.write(measurement.bundle({"spot": trace}, geometry=GEOMETRY), tmp_path / "trace.nc")
    with pytest.raises(MeasurementError, match="add the laser's wavelength"):
        diagnose(tmp_path / "trace.nc")
