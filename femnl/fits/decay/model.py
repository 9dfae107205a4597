"""The law of a free decay with its derivatives, and where its parameters start from."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Numbers = NDArray[np.inexact]
Signal = Literal["voltage", "complex", "magnitude"]
STEP = 1e-30
# Below this ln(1 + x)/x is taken from its series, which is then exact to 1e-16.
SMALL = 1e-4
LEAST = -1 + 1e-9  # of d·s, at −1 of which the amplitude would be infinite
BLOCKS = 400
PERIODS = 8
# Points this many times the typical noise are strong enough to follow their phase.
STRONG = 5.0
NOISE_ROUNDS = 20


@dataclass(frozen=True)
class Decay:
    """One record of a decay and what is fitted to it.

    time (n,) from 0 [s]; signal (n,) [V]; kind: what it is; reference [Hz]: frequency that phases
    are counted from; nonlinear: whether d and pull are free. Parameters, in this order: amplitude,
    decay_rate, damping_ratio*, then for a magnitude floor, for others phase, frequency − reference,
    pull*, and for a voltage offset (* where nonlinear).
    """

    time: Array
    signal: NDArray[np.inexact]
    kind: Signal
    reference: float
    nonlinear: bool

    @property
    def names(self) -> list[str]:
        """Names of the parameters."""
        more = (
            ["floor"]
            if self.kind == "magnitude"
            else ["phase", "frequency", *(["pull"] if self.nonlinear else [])]
        )
        return [
            "amplitude",
            "decay_rate",
            *(["damping_ratio"] if self.nonlinear else []),
            *more,
            *(["offset"] if self.kind == "voltage" else []),
        ]

    def polar(self, values: Numbers) -> tuple[Numbers, Numbers]:
        """Return |A| and arg A at the times."""
        p = dict(zip(self.names, values, strict=True))
        gamma = p["decay_rate"]
        d = p.get("damping_ratio", 0.0)
        s = -np.expm1(-gamma * self.time)
        grown = _above_minus_one(d * s)
        size = p["amplitude"] * np.exp(-gamma * self.time / 2) / np.sqrt(1 + grown)
        if self.kind == "magnitude":
            return size, np.zeros_like(size)
        pulled = p.get("pull", 0.0) / gamma * s * _log_ratio(grown)
        return size, p["phase"] + 2 * np.pi * (p["frequency"] * self.time + pulled)

    def model(self, values: Numbers) -> Numbers:
        """Return what the data are compared with.

        voltage (n,), real and imaginary parts (2n,), or squared magnitude (n,).
        """
        size, angle = self.polar(values)
        if self.kind == "magnitude":
            return np.asarray(size**2 + values[-1])
        if self.kind == "complex":
            return np.concatenate([size * np.cos(angle), size * np.sin(angle)])
        return np.asarray(
            size * np.cos(angle + 2 * np.pi * self.reference * self.time) + values[-1]
        )

    @property
    def data(self) -> Array:
        """What the model is compared with."""
        if self.kind == "magnitude":
            return np.asarray(np.abs(self.signal) ** 2)
        return (
            np.concatenate([self.signal.real, self.signal.imag])
            if self.kind == "complex"
            else np.asarray(self.signal.real)
        )

    def spread(self, values: Array, noise: float) -> Array:
        """Return the standard deviation of each datum for a noise [V] per sample or quadrature."""
        if self.kind != "magnitude":
            return np.full(len(self.data), noise)
        # |V|² of a signal with noise σ in both quadratures varies by 4σ²|A|² + 4σ⁴.
        return np.asarray(np.sqrt(4 * noise**2 * self.polar(values)[0] ** 2 + 4 * noise**4))

    def noise(self, values: Array) -> float:
        """Return the noise [V] that explains what a fit leaves."""
        rest = self.data - self.model(values)
        free = len(self.data) - len(values)
        noise = float(np.sqrt(np.sum(rest**2) / free))
        if self.kind == "magnitude":
            # The spread grows as σ where the signal is strong and as σ² where it is weak: the cube
            # root converges for both.
            noise = float(np.sqrt(max(values[-1], 0.0) / 2)) or noise / float(values[0])
            for _ in range(NOISE_ROUNDS):
                noise *= float(np.sum((rest / self.spread(values, noise)) ** 2) / free) ** (1 / 3)
        return noise

    def jacobian(self, values: Array) -> Array:
        """Return the derivatives of the model, (n, k), by complex steps."""
        units = STEP * np.where(values != 0, np.abs(values), 1.0)
        columns = [self.model(values + 1j * unit).imag / unit.sum() for unit in np.diag(units)]
        return np.stack(columns, axis=1)

    def start(self) -> Array:
        """Return start values.

        The decay by scanning γ and d with amplitude and floor linear, the phase by a line
        through what is strong.
        """
        time, amplitude = (
            blocks(self.time, self.signal, self.reference)
            if self.kind == "voltage"
            else (self.time, self.signal)
        )
        power = np.abs(amplitude) ** 2
        gamma, d, square, floor = _scan(time, power, self.nonlinear)
        p = {
            "amplitude": np.sqrt(square),
            "decay_rate": gamma,
            "damping_ratio": d,
            "floor": floor,
            "offset": 0.0,
        }
        if self.kind != "magnitude":
            strong = power > STRONG**2 * max(
                floor, float(np.mean(power[-max(len(power) // 20, 3) :])), 1e-12 * square
            )
            strong[: max(8, len(power) // 50)] = True
            angle = np.unwrap(np.angle(amplitude[strong]))
            s = -np.expm1(-gamma * time[strong])
            columns = [
                np.ones_like(s),
                2 * np.pi * time[strong],
                2 * np.pi / gamma * s * _log_ratio(d * s),
            ][: 3 if self.nonlinear else 2]
            weight = np.sqrt(power[strong])
            line = np.linalg.lstsq(
                np.stack(columns, axis=1) * weight[:, None], angle * weight, rcond=None
            )[0]
            p |= dict(zip(("phase", "frequency", "pull"), line, strict=False))
        return np.array([float(p[name]) for name in self.names])


def blocks(time: Array, voltage: NDArray[np.inexact], reference: float) -> tuple[Array, Complex]:
    """Return mid times and complex amplitudes of Hann-weighted blocks of a voltage.

    Each block has at least PERIODS periods.
    """
    interval = float(np.median(np.diff(time)))
    length = max(int(np.ceil(PERIODS / (reference * interval))), len(time) // BLOCKS)
    count = len(time) // length
    if count < 8:
        raise MeasurementError(
            f"signal: {len(time)} samples hold fewer than {8 * PERIODS} periods of {reference:.6g} "
            "Hz, the strongest line; record longer, and filter out what is slower than the mode"
        )
    window = np.hanning(length + 2)[1:-1] / np.sum(np.hanning(length + 2))
    turned = (voltage - np.mean(voltage)) * np.exp(-2j * np.pi * reference * time)
    rows = slice(0, count * length)
    return np.mean(time[rows].reshape(count, length), axis=1), 2 * turned[rows].reshape(
        count, length
    ) @ window


def strongest(time: Array, voltage: Array) -> float:
    """Return the frequency [Hz] of the strongest line, to a fraction of the resolution."""
    step = np.diff(time)
    if np.ptp(step) > 1e-3 * np.mean(step):
        raise MeasurementError(
            "time: samples of a voltage must be evenly spaced; resample, or give the complex "
            "amplitude"
        )
    # A decay is strongest at its start, which a window must not hide
    taper = np.cos(np.linspace(0, np.pi / 2, len(voltage))) ** 2
    power = np.abs(np.fft.rfft((voltage - np.mean(voltage)) * taper)) ** 2
    k = int(np.clip(np.argmax(power), 1, len(power) - 2))
    left, top, right = np.log(power[k - 1 : k + 2] + np.finfo(float).tiny)
    return float(
        (k + (left - right) / (2 * (left - 2 * top + right))) / (len(voltage) * np.mean(step))
    )


def _scan(time: Array, power: Array, nonlinear: bool) -> tuple[float, float, float, float]:
    """Return γ, d, A₀² and floor of the best of many decays.

    The last two follow by linear least squares.
    """
    best = (np.inf, 0.0, 0.0, 0.0, 0.0)
    for d in (0.0, 0.3, 1.0, 3.0, 10.0, 30.0) if nonlinear else (0.0,):
        for gamma in np.geomspace(0.1, 300, 80) / time[-1]:
            shape = np.exp(-gamma * time) / (1 - d * np.expm1(-gamma * time))
            (square, floor), rest, *_ = np.linalg.lstsq(
                np.stack([shape, np.ones_like(shape)], axis=1), power, rcond=None
            )
            if square > 0 and rest.size and rest[0] < best[0]:
                best = (float(rest[0]), float(gamma), d, float(square), float(floor))
    if not np.isfinite(best[0]):
        raise MeasurementError(
            "signal: nothing decays; give the record from the moment the drive is switched off"
        )
    return best[1:]


def _above_minus_one(x: Numbers) -> Numbers:
    """Return d·s, kept above −1, where a search that goes beyond finds no amplitude."""
    return np.where(x.real > LEAST, x, LEAST)


def _log_ratio(x: Numbers) -> Numbers:
    """Return ln(1 + x)/x, 1 at 0."""
    small = np.abs(x) < SMALL
    safe = np.where(small, 1.0, x)
    return np.where(small, 1 - x / 2 + x**2 / 3 - x**3 / 4, np.log1p(safe) / safe)
