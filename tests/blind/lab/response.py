"""Up and down sweeps of one mode, by time steps of its slow flow."""

from collections.abc import Callable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl import geometry, measurement
from femnl.diagnose.film import SimulatedFilm
from tests.blind.lab.bench import Array, Cause, Values, sign

ALPHA_SD = 0.2
"""Relative standard deviation of α from film to film, through Young's modulus."""
STEPS, STRIDE, SETTLED = 4000, 0.05, 1e-6
"""Most Runge–Kutta steps at each point of a sweep, in units of the amplitude's decay time, and the change in a step that ends them."""
WAVELENGTH = 632.8e-9
COARSE, TORN = 1e3, 2.0
"""How much longer steps for tangents are than of closed forms, and the ratio of amplitudes of a point that has jumped."""
FIRST = 2 * np.pi * np.arange(64) / 64
"""Phases at which the signal of the fringe is sampled."""


class ResponseBench:
    """Eight sweeps; see `Bench`."""

    def __init__(self, name: str, timed: bool, rng: np.random.Generator) -> None:
        self.mode, self.f0 = ("2,2", 2.9324e6) if rng.uniform() < 0.5 else ("1,1", 1.4661e6)
        film = SimulatedFilm(geometry.load(name), 12)
        self.alpha = float(film.alpha[film.modes.label.index(f"({self.mode})")])
        self.drives = np.repeat(np.array([0.05, 0.1, 0.2, 0.4]), 2)
        self.direction = np.tile([1, -1], 4)
        self.time = 120.0 * np.arange(8) if timed or rng.uniform() < 0.5 else None
        self.noise, self.points = 1.5e-5, 81
        linewidth = self.linewidth = rng.uniform(3, 5)
        stretch = rng.uniform(3, 14)  # linewidths by which the strongest drive would move the resonance at full amplitude
        self.peak = float(np.sqrt(stretch * linewidth / (0.375 * self.f0 * self.alpha)) / self.drives.max())
        self.gain = 0.014 / (self.peak * 0.4)
        worth = {"frequency": linewidth, "linewidth": linewidth, "peak": self.peak, "gain": self.gain, "phase": 1.0}
        self.unit = {name: COARSE * value for name, value in worth.items()}
        reach = 0.375 * self.f0 * self.alpha * (self.peak * self.drives.max()) ** 2
        self.frequency = np.linspace(self.f0 - 8 * linewidth, self.f0 + 8 * linewidth + 0.8 * reach, self.points)

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw f₀, w [Hz], the linear peak [m/V], the gain [V/m], its phase, and the film's own α [m⁻²]."""
        return {
            "frequency": self.f0 + rng.uniform(-2, 2),
            "linewidth": self.linewidth * rng.uniform(0.9, 1.1),
            "peak": self.peak * rng.uniform(0.95, 1.05),
            "gain": self.gain,
            "phase": rng.uniform(-np.pi, np.pi),
            "alpha": self.alpha * max(1 + ALPHA_SD * rng.standard_normal(), 0.4),
        }

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Both quadratures over their σ; all variants are stepped side by side."""
        bases = [base for base, _ in variants]
        volts = self._swept(bases, [hidden for _, hidden in variants]) / self.noise
        size = np.abs(volts)
        volts *= size.max(axis=0) < TORN * size.min(axis=0)  # a point that jumps in some of them has no tangents
        flat = volts.reshape(len(variants), -1)
        return np.concatenate([flat.real, flat.imag], axis=1)

    def _swept(self, bases: list[Values], hidden: list[dict[str, Values]]) -> NDArray[np.complex128]:
        def knob(cause: str, name: str) -> Array:
            return np.array([h.get(cause, {}).get(name, 0.0) for h in hidden])[:, None]

        f0, w, peak, alpha = (np.array([b[name] for b in bases])[:, None] for name in ("frequency", "linewidth", "peak", "alpha"))
        if self.time is not None:
            f0 = f0 * (1 + knob("frequency_drift", "rate") * self.time)
        drive = peak * self.drives / (1 + knob("drive_compression", "kappa") * self.drives**2) + 0j
        cubic = 0.75 * f0 / w * alpha
        quintic, loss = 0.625 * f0 / w * knob("quintic_stiffness", "alpha5"), knob("nonlinear_damping", "eta") / 4
        state = np.zeros_like(drive)
        motion = np.empty((len(bases), 8, self.points), complex)
        for k in range(self.points):
            point = np.where(self.direction > 0, k, self.points - 1 - k)
            detuning = 2 * (f0 - self.frequency[point]) / w
            for n in range(STEPS):
                earlier, state = state, _step(state, STRIDE, detuning, cubic, quintic, loss, drive)
                if n % 10 == 9 and np.abs(state - earlier).max() < SETTLED * np.abs(drive).max():
                    break
            motion[:, np.arange(8), point] = state
        z = 4 * np.pi / WAVELENGTH * np.sqrt(np.maximum(knob("nonlinear_readout", "share"), 1e-12))[..., None] * np.abs(motion)
        first = 2 * np.mean(np.sin(z[..., None] * np.cos(FIRST)) * np.cos(FIRST), axis=-1) / np.maximum(z, 1e-300)
        gain = np.array([b["gain"] * np.exp(1j * b["phase"]) for b in bases])[:, None, None]
        leak = (knob("crosstalk", "real") + 1j * knob("crosstalk", "imag"))[..., None]
        return np.asarray(gain * motion * np.where(z > 1e-3, first, 1 - z**2 / 8) + leak * self.drives[:, None])

    def measured(self, base: Values, hidden: dict[str, Values], rng: np.random.Generator) -> xr.Dataset:
        """Quadratures with noise, to a tenth of a microvolt."""
        volts = self._swept([base], [hidden])[0]
        noise = rng.standard_normal((2, *volts.shape))
        noisy = np.round(volts + self.noise * (noise[0] + 1j * noise[1]), 7)
        about = {"noise_sd": self.noise, "wavelength": WAVELENGTH}
        return measurement.response(
            self.frequency, noisy, mode=self.mode, drive=self.drives, direction=self.direction, x=6e-5, y=6e-5, time=self.time, **about
        )


def _step(
    a: NDArray[np.complex128], h: float, delta: Array, cubic: Array, quintic: Array, loss: Array, drive: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """One Runge–Kutta step of da/ds = −i (drive − a (δ + cubic|a|² + quintic|a|⁴ + i (1 + loss|a|²)))."""

    def rate(a: NDArray[np.complex128]) -> NDArray[np.complex128]:
        x = a.real**2 + a.imag**2
        return np.asarray(-1j * (drive - a * (delta + x * (cubic + quintic * x) + 1j * (1 + loss * x))))

    one = rate(a)
    two = rate(a + h / 2 * one)
    three = rate(a + h / 2 * two)
    return np.asarray(a + h / 6 * (one + 2 * two + 2 * three + rate(a + h * three)))


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> ResponseBench:
    """Prepare a measurement."""
    return ResponseBench(name, "frequency_drift" in causes, rng)


def _strongest(bench: ResponseBench) -> float:
    return bench.peak * 0.4


def _leak(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    turn, slope = rng.uniform(-np.pi, np.pi), 1e-3 * bench.gain * bench.peak
    return Cause({"real": float(slope * np.cos(turn)), "imag": float(slope * np.sin(turn))}, ("real", "imag"), 300.0)


def _damping(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    return Cause({"eta": 1e-2 / _strongest(bench) ** 2}, ("eta",), 1e3)


def _quintic(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    # The quintic term stays a small part of the cubic one.
    return Cause({"alpha5": sign(rng) * 1e-3 * bench.alpha / _strongest(bench) ** 2}, ("alpha5",), 50.0)


def _readout(rng: np.random.Generator, bench: ResponseBench) -> Cause:
    z = 4 * np.pi / WAVELENGTH * _strongest(bench)
    return Cause({"share": 0.1 / z**2}, ("share",), 30.0)


CAUSES: dict[str, Callable[[np.random.Generator, ResponseBench], Cause]] = {
    "crosstalk": _leak,
    "drive_compression": lambda rng, bench: Cause({"kappa": 0.05}, ("kappa",), 100.0),
    "frequency_drift": lambda rng, bench: Cause({"rate": 1e-10 * sign(rng)}, ("rate",), 1e3),
    "nonlinear_damping": _damping,
    "nonlinear_readout": _readout,
    "quintic_stiffness": _quintic,
}
