"""A record of drive and output of one oscillator.

Many small Runge–Kutta steps under a band-limited noise.
"""

from collections.abc import Callable
from functools import cache

import numba
import numpy as np
import xarray as xr

from femnl.io import measurement
from tests.blind.lab.bench import INEXACT, Array, Cause, Noise, Values, sign

RATE = 610.0
COUNT = 1800
SUBSTEPS = 32
"""Samples a second, samples, and time steps between two of them."""
BAND = 150.0
"""Highest frequency [Hz] of the drive."""
SWING = 0.3
"""Swing [V] at which the next order of a force is `inexact` times the force."""
ADC = 2e-5
"""Step [V] of the converter."""


class RecordBench:
    """One record of ÿ + γ(1 + ηy²)ẏ + ω₀²(y + κ₂y² + αy³ + α₅y⁵) = ω₀²(u + u₀)/k; see `Bench`."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.noise = float(rng.choice([1e-4, 3e-4]))
        spectrum = np.fft.rfft(rng.standard_normal(COUNT))
        spectrum[np.fft.rfftfreq(COUNT, 1 / RATE) > BAND] = 0
        # Between the samples and half-way between the steps, exactly what the band allows; before
        # the record it repeats itself.
        fine = (
            np.fft.irfft(
                np.pad(spectrum, (0, COUNT * SUBSTEPS + 1 - len(spectrum))), 2 * COUNT * SUBSTEPS
            )
            * 2
            * SUBSTEPS
        )
        self.drive = 0.1 * fine / np.std(fine) * rng.uniform(0.8, 1.2)
        self.size = 0.3
        self.unit = {
            "frequency": 70.0,
            "linewidth": 10.0,
            "stiffness": 1.0,
            "offset": 0.01,
            "alpha": 4.0,
        }

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw f₀ and w [Hz], stiffness [V/V], offset [V] and α [V⁻²].

        The motion forgets how it began: some draws would be chaotic, and are left out.
        """
        while True:
            found = {
                "frequency": rng.uniform(60, 75),
                "linewidth": rng.uniform(5, 12),
                "stiffness": rng.uniform(0.8, 1.2),
                "offset": rng.uniform(-2e-3, 2e-3),
                "alpha": rng.uniform(2, 5),
            }
            two = self._run([found, found], [{}, {}], begin=np.array([0.0, self.size]))
            if np.abs(two[1] - two[0])[COUNT // 2 :].max() < ADC:
                return found

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """The output over its σ; all variants are stepped side by side."""
        return (
            self._run([base for base, _ in variants], [hidden for _, hidden in variants])
            / self.noise
        )

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        """Output with noise, in steps of the converter; the drive as it was."""
        output = self._run([base], [hidden])[0]
        noisy = ADC * np.round((output + self.noise * rng.standard_normal(COUNT)) / ADC)
        time = np.arange(COUNT) / RATE
        return {
            "record": measurement.trace(
                time,
                noisy[None],
                drive_voltage=self.drive[None, :: 2 * SUBSTEPS],
                noise_sd=self.noise,
            )
        }

    def _run(
        self, bases: list[Values], hidden: list[dict[str, Values]], begin: float | Array = 0.0
    ) -> Array:
        def spec(cause: str, name: str) -> Array:
            return np.array([h.get(cause, {}).get(name, 0.0) for h in hidden])

        f0, width, stiffness, offset, alpha = (
            np.array([base[name] for base in bases])
            for name in ("frequency", "linewidth", "stiffness", "offset", "alpha")
        )
        square = (2 * np.pi * f0) ** 2
        loss = (2 * np.pi * width, spec("nonlinear_damping", "eta"))
        kappa = spec("quadratic_stiffness", "kappa2")
        more = (
            kappa * spec("quadratic_stiffness", INEXACT) / SWING**2,
            spec("quintic_stiffness", "alpha5") * spec("quintic_stiffness", INEXACT) / SWING**2,
            loss[1] * spec("nonlinear_damping", INEXACT) / SWING**2,
        )
        forces = (
            square,
            square / stiffness,
            offset,
            kappa,
            alpha,
            spec("quintic_stiffness", "alpha5"),
        )
        return np.asarray(
            _compiled()(
                self.drive, np.stack([*forces, *loss, *more], axis=1), np.zeros(len(bases)) + begin
            )
        )


@cache
def _compiled() -> Callable[[Array, Array, Array], Array]:
    """Return `_integrate` as machine code."""
    return numba.njit(error_model="numpy")(_integrate)


def _integrate(drive: Array, oscillators: Array, begin: Array) -> Array:
    """Classical Runge–Kutta steps of each oscillator (n, 11) under a drive by half steps.

    The first eighth is a run-in before the record.
    """
    h = 1 / (RATE * SUBSTEPS)
    found = np.empty((len(oscillators), COUNT))
    for k in range(len(oscillators)):
        square, gain, offset, kappa, alpha, quintic, gamma, eta = oscillators[k, :8]
        quartic, septic, steep = oscillators[k, 8:]
        y = begin[k]
        v = 0.0
        for n in range(-COUNT // 8 * SUBSTEPS, COUNT * SUBSTEPS):
            if n >= 0 and n % SUBSTEPS == 0:
                found[k, n // SUBSTEPS] = y
            dy = dv = sum_y = sum_v = 0.0
            for stage in range(4):
                reach = 0.0 if stage == 0 else h if stage == 3 else h / 2
                x = y + reach * dy
                w = v + reach * dv
                u = drive[(2 * n + (stage + 1) // 2) % len(drive)]
                force = x + kappa * x**2 + alpha * x**3 + quintic * x**5
                force = force + quartic * x**4 + septic * x**7
                drag = gamma * w + gamma * eta * x**2 * w + gamma * steep * x**4 * w
                dy = w
                dv = gain * (u + offset) - square * force - drag
                weight = 1.0 if stage in (0, 3) else 2.0
                sum_y = sum_y + weight * dy
                sum_v = sum_v + weight * dv
            y = y + h / 6 * sum_y
            v = v + h / 6 * sum_v
    return found


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> RecordBench:
    """Prepare a measurement; the device plays no part."""
    return RecordBench(rng)


CAUSES: dict[str, Callable[[np.random.Generator, RecordBench], Cause]] = {
    "nonlinear_damping": lambda rng, bench: Cause({"eta": 0.1}, ("eta",), 300.0),
    "quadratic_stiffness": lambda rng, bench: Cause(
        {"kappa2": 1e-3 * sign(rng)}, ("kappa2",), 300.0
    ),
    "quintic_stiffness": lambda rng, bench: Cause({"alpha5": 0.3 * sign(rng)}, ("alpha5",), 30.0),
}
DERIVED: dict[str, str] = dict.fromkeys(
    CAUSES, "Runge–Kutta steps of the equation of motion under the recorded drive"
)
"""How the laboratory computes a cause, other than the library does."""
