"""Sweeps of one mode of a square film, up and down, with a readout that is sampled in time.

The amplitude follows from point to point the root of its cubic nearest to the last one; a detector
gets the signal of one period, from which a lock-in takes the first harmonic.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.diagnosis import Diagnosis
from femnl.diagnose import diagnose
from femnl.io import measurement

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
F0 = 2.9324e6
ALPHA = 2.75e10
WAVELENGTH = 632.8e-9
NOISE = 1.5e-5
STRONGEST = 14e-3
"""Of the signals, in V."""
PHASES = 2 * np.pi * np.arange(256) / 256


@dataclass(frozen=True)
class Bench:
    """Two sweeps at each of four drives; width [Hz]; stretch: by how many linewidths they bend."""

    width: float = 4.0
    stretch: float = 8.0
    points: int = 81
    wide: float = 8.0
    place: tuple[float, float] | None = None
    drives: Array = field(default_factory=lambda: np.repeat([0.05, 0.1, 0.2, 0.4], 2))
    direction: Array = field(default_factory=lambda: np.tile([1.0, -1.0], 4))

    @property
    def peak(self) -> float:
        """Amplitude at resonance without nonlinearity [m/V]."""
        bend = 0.375 * F0 * ALPHA
        return float(np.sqrt(self.stretch * self.width / bend) / self.drives.max())

    @property
    def frequency(self) -> Array:
        """Of the drive [Hz]."""
        reach = 0.8 * self.stretch * self.width
        wide = self.wide * self.width
        return np.linspace(F0 - wide, F0 + wide + reach, self.points)

    def amplitude(
        self,
        f0: Array | float = F0,
        force: Array | None = None,
        pull: Complex | None = None,
    ) -> Complex:
        """Return A (n_sweeps, n_points) [m].

        For f₀ [Hz] that may differ from point to point, a force that is not the drive, and a pull
        (n_points,) [Hz] that another mode adds at the largest amplitude, ∝ |A|².
        """
        drives = self.drives if force is None else force
        f = self.frequency
        own = np.broadcast_to(f0, (len(drives), len(f)))
        more = np.zeros(len(f), complex) if pull is None else pull
        out = np.empty(own.shape, complex)
        for s, (drive, way) in enumerate(zip(drives, self.direction, strict=True)):
            last = 0.0
            unit = self.peak * drive
            for k in range(len(f)) if way > 0 else reversed(range(len(f))):
                bend = 0.375 * own[s, k] * ALPHA * unit**2
                bend = bend + more[k] * (drive / self.drives.max()) ** 2
                off = own[s, k] - f[k] + 0.5j * self.width
                # |off + bend x|² x = (w/2)², x = |A|²/unit²
                middle = 2 * (off * bend.conjugate()).real
                roots = np.roots([abs(bend) ** 2, middle, abs(off) ** 2, -((self.width / 2) ** 2)])
                stable = np.sort(roots[np.abs(roots.imag) < 1e-7 * np.abs(roots)].real)[[0, -1]]
                x = float(stable[np.argmin(np.abs(np.sqrt(stable) * unit - last))])
                last = np.sqrt(x) * unit
                out[s, k] = self.width / 2 * unit / (off + bend * x)
        return out

    def volts(self, amplitude: Complex) -> Complex:
        """Return what a straight readout makes of the motion."""
        return np.asarray(amplitude * STRONGEST / np.abs(amplitude).max() * np.exp(0.4j))

    def measured(self, volts: Complex, **extra: Any) -> xr.Dataset:
        """Return the sweeps with noise."""
        rng = np.random.default_rng(extra.pop("seed", 1))
        noise = rng.standard_normal((2, *volts.shape))
        return measurement.response(
            np.broadcast_to(self.frequency, volts.shape),
            volts + NOISE * (noise[0] + 1j * noise[1]),
            noise_sd=NOISE,
            wavelength=WAVELENGTH,
            mode="2,2",
            drive=extra.pop("drive", self.drives),
            direction=extra.pop("direction", self.direction),
            **extra,
        )

    def diagnose(self, path: Path, volts: Complex, **extra: Any) -> Diagnosis:
        """Write the sweeps with noise to a file and diagnose it."""
        data = self.measured(volts, **extra)
        measurement.write(measurement.bundle({"sweeps": data}, geometry="square-270um"), path)
        return diagnose(path)


def lock_in(signal: Array) -> Complex:
    """Return the first harmonic of signals (…, 256) at `PHASES`, with v = Re V e^{iφ}."""
    return np.asarray(2 * np.mean(signal * np.exp(-1j * PHASES), axis=-1))
