"""Files of every kind that `femnl fit` takes, with the options that are recorded for each."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from femnl.core.resonator import Resonator
from femnl.io import measurement
from femnl.observe.record.free_run import free_run, stages
from femnl.resonator import duffing_roots, ring_down
from tests.blind.lab import Case, make

DEVICE = "rectangle"


def blind(
    kind: str, causes: tuple[str, ...], geometry: str = "square-270um"
) -> Callable[[str], None]:
    """Return what writes a file of the blind laboratory."""

    def write(path: str) -> None:
        make(Case(kind, causes, 7, geometry), Path(path))

    return write


def wide_sweep(path: str) -> None:
    """Three lines in a sweep of an octave."""
    f = np.linspace(1e6, 2e6, 1500)
    rng = np.random.default_rng(3)
    volts = sum(1e-3 * g * 9e3 / (g**2 - f**2 + 9e3j * f) for g in (1.2e6, 1.5e6, 1.8e6))
    volts = volts + 1e-5 * (rng.normal(size=f.size) + 1j * rng.normal(size=f.size))
    data = measurement.response(f, volts, noise_sd=1e-5)
    measurement.write(measurement.bundle({"wide": data}, geometry=DEVICE), path)


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


def decay(path: str, envelope: bool = False) -> None:
    """A ring-down that begins nonlinear."""
    mode = Resonator(1e5, 2000.0, alpha=1e9)
    rng = np.random.default_rng(2)
    time = np.arange(40_000) / 1e6
    slow = 1e4 * ring_down(mode, 1e-6, time)
    volts = slow.real + 1e-4 * rng.normal(size=time.size)
    if envelope:
        time = time[::50]
        noise = rng.normal(size=time.size) + 1j * rng.normal(size=time.size)
        volts = np.abs(slow[::50] + 1e-4 * noise)
    data = measurement.trace(time, volts[None], drive_frequency=[1e5])
    measurement.write(measurement.bundle({"decay": data}), path)


def driven_record(path: str) -> None:
    """An oscillator of 60 Hz with k₂, k₃ and an offset under a noisy drive."""
    rng = np.random.default_rng(6)
    spectrum = np.fft.rfft(rng.normal(size=1400))
    spectrum[np.fft.rfftfreq(1400, 1e-3) > 150] = 0
    drive = np.fft.irfft(spectrum, 1400) * np.where(np.arange(1400) < 800, 0.3, 0.2)
    k = (2 * np.pi * 60) ** 2
    coefficients = np.array([k, 0.01, 300.0, 0.0, k, 0.5 * k, 6.0 * k])[:, None]
    output = free_run(coefficients, stages(drive, 1e-3, "band-limited"))[0].real
    output = output + 1e-5 * rng.normal(size=1400)
    time = np.arange(1200) * 1e-3
    data = measurement.trace(time, output[None, 200:], drive_voltage=drive[None, 200:])
    measurement.write(measurement.bundle({"box": data}), path)


FITS: dict[str, tuple[Callable[[str], None], list[str]]] = {
    "spectrum": (blind("spectrum", ()), []),
    "spectrum with a particle": (blind("spectrum", ("added_mass",)), []),
    "spectrum of a film with holes": (blind("holes", (), "perforated"), []),
    "response": (blind("response", ()), []),
    "response with damping": (blind("response", ("nonlinear_damping",)), ["--nonlinear-damping"]),
    "response by its phase": (blind("response", ("crosstalk",)), ["--use", "phase"]),
    "response by its phase mod pi": (blind("response", ()), ["--use", "phase-mod-pi"]),
    "response by its magnitude": (blind("response", ()), ["--use", "magnitude"]),
    "map with a sine": (blind("map", ()), []),
    "map with a stack": (blind("map", ("multilayer_fringe",)), ["--fringe", "multilayer"]),
    "map with any fringe": (blind("map", ("multilayer_fringe",)), ["--fringe", "free"]),
    "map under two lasers": (blind("lasers", ()), []),
    "trace": (blind("trace", ()), []),
    "trace with a stack": (blind("trace", ("multilayer_fringe",)), ["--fringe", "multilayer"]),
    "record": (blind("record", ()), ["--as", "oscillator"]),
    "record with holdout": (driven_record, ["--as", "oscillator", "--held-out", "0:600"]),
    "overview": (wide_sweep, ["--as", "overview"]),
    "line scan": (line_of_responses, ["--as", "line-scan"]),
    "line together": (line_of_responses, []),
    "ring-down": (decay, ["--as", "ring-down"]),
    "envelope": (lambda path: decay(path, envelope=True), ["--as", "envelope"]),
}
"""By name: what writes the file, and the options of `femnl fit`."""
