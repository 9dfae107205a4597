"""Time traces at one spot of a film that is driven through its resonance.

Sampled, rounded, started by a trigger.

The signal is made in time: a motion, its fringe, a clip, a low pass, an average over the errors of
the trigger.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr

from femnl.io import measurement
from tests.blind.lab import laws
from tests.blind.lab.bench import Array, Cause, Noise, Values, one, sign, vector
from tests.blind.lab.film import device
from tests.blind.lab.maps import WAVELENGTH, film_and_beam
from tests.blind.lab.motion import bent
from tests.blind.lab.optics import fringe, largest, low_passed

PERIOD = 512
"""Points of one period in which the signal is made before it is sampled."""
HIGHEST = 160
"""Harmonics of it that are kept: a sampler has a bandwidth."""
ADC = 0.1 / 2**12
"""Step [V] of the converter."""
SHOTS, SHARE = np.polynomial.hermite_e.hermegauss(24)
PHASE = 2 * np.pi * np.arange(PERIOD) / PERIOD


class TraceBench:
    """Traces at steps of the drive; see `Bench`."""

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        self.f0 = 1.4661e6
        self.noise = float(rng.choice([3e-4, 6e-4]))
        self.steps = int(rng.integers(6, 10))
        self.samples = int(rng.integers(500, 800))
        self.rate = self.f0 * rng.uniform(50, 70)
        self.width = rng.uniform(3, 6)
        self.frequency = self.f0 + np.linspace(-2.5, 2.5, self.steps) * self.width
        # The trigger follows the drive's generator, and not the step before
        self.start = rng.uniform(-np.pi, np.pi, self.steps)
        self.stack = device(name).stack
        self.gap = self.stack.layers[self.stack.gap].thickness if self.stack else 0.0
        self.thickness = device(name).film.thickness
        self.unit = {"contrast": 0.02, "theta": 1.0}
        self.unit |= {f"amplitude[{i}]": 1e-8 for i in range(self.steps)} | {
            f"phase[{i}]": 1.0 for i in range(self.steps)
        }

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw contrast [V], phase of the fringe, and amplitude [m] and phase at each step."""
        largest = rng.uniform(2e-7, 5e-7)
        linear = 1 / (1 + 2j * (self.frequency - self.f0) / self.width)
        base = {"contrast": 0.02, "theta": rng.uniform(0.2, 1.35), "largest": largest}
        base |= {f"amplitude[{i}]": float(largest * abs(a)) for i, a in enumerate(linear)}
        return base | {
            f"phase[{i}]": float(np.angle(a) + p)
            for i, (a, p) in enumerate(zip(linear, self.start, strict=True))
        }

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Every sample over its σ, less its mean, which says nothing."""
        rows = []
        for base, hidden in variants:
            volts = self._sampled(base, hidden)
            rows.append(((volts - volts.mean(axis=1, keepdims=True)) / self.noise).ravel())
        return np.stack(rows)

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        """Samples with noise, in steps of the converter."""
        volts = self._sampled(base, hidden)
        noisy = ADC * np.round((volts + self.noise * rng.standard_normal(volts.shape)) / ADC)
        sd = float(np.hypot(self.noise, ADC / np.sqrt(12)))
        time = np.arange(self.samples) / self.rate
        return {
            "trace": measurement.trace(
                time, noisy, drive_frequency=self.frequency, noise_sd=sd, wavelength=WAVELENGTH
            )
        }

    def _sampled(self, base: Values, hidden: dict[str, Values]) -> Array:
        time = np.arange(self.samples) / self.rate
        rows = []
        for i, f in enumerate(self.frequency):
            series = np.fft.rfft(self._period(i, base, hidden))[: HIGHEST + 1] / PERIOD
            series[1:] *= 2
            order = np.arange(HIGHEST + 1)
            omega = 2 * np.pi * f
            if "trigger_jitter" in hidden:
                late = np.exp(-1j * np.outer(order * omega, hidden["trigger_jitter"]["sd"] * SHOTS))
                series = series * (late @ SHARE) / SHARE.sum()
                much = laws.inexact(hidden, "trigger_jitter")
                series = series * laws.late(order * omega * hidden["trigger_jitter"]["sd"], much)
            series = series * np.exp(1j * order * base[f"phase[{i}]"])
            if "crosstalk" in hidden:
                leak = hidden["crosstalk"]["real"] + 1j * hidden["crosstalk"]["imag"]
                series[1] += leak
                series[2] += laws.inexact(hidden, "crosstalk") * leak
            if "detector_bandwidth" in hidden:
                constant = hidden["detector_bandwidth"]["time_constant"]
                answer = low_passed(len(order), self.f0, constant)
                # The trigger comes later by the delay that all harmonics share
                series = series * answer * np.exp(1j * order * omega * constant)
                more = laws.inexact(hidden, "detector_bandwidth") * constant
                if more:
                    answer = low_passed(len(order), self.f0, more)
                    series = series * answer * np.exp(1j * order * omega * more)
            turn = np.exp(1j * omega * time)
            rows.append(np.polynomial.polynomial.polyval(turn, series).real)
        return np.array(rows)

    def _period(self, step: int, base: Values, hidden: dict[str, Values]) -> Array:
        """One period of the signal at a step, whose motion has the phase zero."""
        amplitude = base[f"amplitude[{step}]"]
        u = amplitude * np.cos(PHASE)
        if "quadratic_stiffness" in hidden:
            bend = hidden["quadratic_stiffness"]["kappa2"] * amplitude
            third = laws.inexact(hidden, "quadratic_stiffness") * abs(bend)
            u = amplitude * (bent(bend, PERIOD) + third * np.cos(3 * PHASE))
        if "mechanical_overtones" in hidden:
            sung = hidden["mechanical_overtones"]
            swing = amplitude / base["largest"]
            for n in (2, 3):
                u = u + swing**n * (
                    sung[f"cos{n}"] * np.cos(n * PHASE) + sung[f"sin{n}"] * np.sin(n * PHASE)
                )
            fourth = laws.inexact(hidden, "mechanical_overtones") * swing**4 * sung["cos2"]
            u = u + fourth * np.cos(4 * PHASE)
        if "multilayer_fringe" in hidden and self.stack is not None:
            light = hidden["multilayer_fringe"]
            gap = light["gap"] + laws.inexact(hidden, "multilayer_fringe") * (
                WAVELENGTH / 20 * (step / self.steps - 0.5)
            )
            v = fringe(self.stack, laws.first(light), WAVELENGTH)(gap + u)
        else:
            v = np.cos(4 * np.pi / WAVELENGTH * u + base["theta"])
        return np.asarray(base["contrast"] * self._clipped(v, hidden))

    def _clipped(self, v: Array, hidden: dict[str, Values]) -> Array:
        """The signal between the rails of the detector, in units of the contrast."""
        top = (
            largest(self.stack, laws.first(hidden["multilayer_fringe"]), WAVELENGTH)
            if "multilayer_fringe" in hidden and self.stack is not None
            else 1.0
        )
        if "detector_saturation" in hidden:
            limit = top * (1 - hidden["detector_saturation"]["clipped"])
            v = laws.rounded(v, limit, -1.0, laws.inexact(hidden, "detector_saturation"))
        if "one_sided_saturation" in hidden:
            limit = top * (1 - hidden["one_sided_saturation"]["clipped"])
            v = laws.rounded(v, limit, -np.inf, laws.inexact(hidden, "one_sided_saturation"))
        return v


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> TraceBench:
    """Prepare a measurement."""
    return TraceBench(name, rng)


def _stack(rng: np.random.Generator, bench: TraceBench) -> Cause:
    gap = bench.gap + float(rng.uniform(-1, 1)) * WAVELENGTH / 4
    return Cause({"gap": gap} | film_and_beam(rng, bench.thickness), ())


CAUSES: dict[str, Callable[[np.random.Generator, TraceBench], Cause]] = {
    "crosstalk": vector(("real", "imag"), 1e-5, 1e3),
    "detector_bandwidth": one("time_constant", 3e-9, 20.0),
    "detector_saturation": one("clipped", 0.02, 20.0),
    "mechanical_overtones": vector(("cos2", "sin2", "cos3", "sin3"), 1e-9, 40.0),
    "multilayer_fringe": _stack,
    "one_sided_saturation": one("clipped", 0.02, 20.0),
    "quadratic_stiffness": lambda rng, bench: Cause({"kappa2": 3e3 * sign(rng)}, ("kappa2",), 60.0),
    "trigger_jitter": one("sd", 2e-9, 25.0),
}
DERIVED: dict[str, str] = {
    "crosstalk": "added to the signal that is then sampled in time",
    "detector_bandwidth": "a recursive low pass run in time until it is steady",
    "detector_saturation": "the signal is clipped in time",
    "mechanical_overtones": "added to the motion in time, whose fringe goes through an FFT",
    "multilayer_fringe": "Fresnel reflections layer by layer at 32 angles and two polarisations, "
    "tabulated in the gap, instead of a geometric series of overtones",
    "one_sided_saturation": "the signal is clipped above in time",
    "quadratic_stiffness": "one period of the free oscillation by Runge–Kutta steps",
    "trigger_jitter": "Gauss–Hermite average over late triggers, instead of its closed form",
}
"""How the laboratory computes each cause, where the library does otherwise."""
