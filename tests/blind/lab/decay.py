"""A decay behind an analyser: small steps of the slow flow, then filter, detector and logarithm."""

from collections.abc import Callable

import numpy as np
import xarray as xr
from scipy.linalg import cholesky, solve_triangular
from scipy.signal import fftconvolve

from femnl.io import measurement
from tests.blind.lab import laws
from tests.blind.lab.bench import Array, Cause, Noise, Values, sign

STEPS = 4
"""Time steps from one point to the next."""
PHASED = ("duffing_shift", "frequency_drift")
"""Causes that only a phase shows."""
TONE = 1.3e6
"""Frequency [Hz] of the mode."""
REACH = 4.0
"""Standard deviations of the filter's pulse that are summed over."""
DRIFT = 0.2 * np.log(10) / 10
"""Drift of the gain, as ln of the power: 0.2 dB. Of real records seven in ten drift by more."""
FEED = 3.0
"""Drive that feeds through, in amplitudes of the mode, until the switch-off."""
DIGIT = 1e-4
"""Step [dB] of what is written."""
CORNER = 0.05
"""Part of a decay in which the drive may still be in the filter."""
SHARP = 0.06
"""ln of the energy within which the damping of an exchange changes."""
FRINGE = np.linspace(0, 2 * np.pi, 64, endpoint=False)
SWING = 0.05
"""Phases of one period, and the swing [rad] of the fringe at the begin."""


class DecayBench:
    """A record from the switch-off, with or without what came before; see `Bench`."""

    def __init__(self, causes: tuple[str, ...], rng: np.random.Generator) -> None:
        self.rate = float(np.exp(rng.uniform(np.log(0.05), np.log(5.0))))
        self.depth = float(rng.uniform(35, 55))  # dB from the begin to the floor
        self.whole = self.depth * np.log(10) / 10 / self.rate
        self.points = int(rng.integers(350, 800))
        late = rng.uniform(0.9, 1.5)
        self.interval = late * self.whole / self.points
        self.before = int(rng.choice([0, self.points // 5]))
        by_chance = rng.uniform() < 0.25
        # To a phase, a mode that leaves the filter shows its drift as well: two causes
        shown = by_chance and "filter_exit" not in causes
        self.phased = bool(set(causes) & set(PHASED)) or shown
        self.width = np.sqrt(2) * rng.uniform(60, 150) / self.whole  # of the filter [Hz]
        self.unit = {"level": 1.0, "decay_rate": self.rate, "floor": 1.0}
        if self.phased:
            self.unit |= {"phase": 1.0, "detuning": 1 / self.whole}
        self.time = self.interval * np.arange(self.points)
        # Points that the corner of a drive does not hide
        self.seen = slice(int(CORNER * self.points) if self.before else 0, None)
        self._factor = self._noise_factor()
        # What no library has, as `clean` gives it
        self.unknown = np.zeros(len(self.time[self.seen]))

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw level and floor [dB], rate [1/s], and where the phase begins and turns."""
        level = rng.uniform(-50, 10)
        found = {
            "level": level,
            "decay_rate": self.rate * np.exp(rng.uniform(-0.1, 0.1)),
            "floor": level - self.depth,
        }
        if self.phased:
            found |= {
                "phase": rng.uniform(-3, 3),
                "detuning": rng.uniform(-3, 3) / self.whole,
            }
        return found

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """Ln of the mean power, and the phase, freed from the correlation of their noise.

        Of a record with its drive, without what its corner hides.
        """
        rows = []
        for (base, _), behind in zip(variants, self._filtered(variants), strict=True):
            power = np.abs(behind) ** 2 + 10 ** ((base["floor"] - base["level"]) / 10)
            data = [np.log(power) + base["level"] * np.log(10) / 10]
            if self.phased:
                data.append(self._angle(base, behind))
            white = [
                solve_triangular(factor, one[self.seen][: len(factor)], lower=True)
                for factor, one in zip(self._factor, data, strict=False)
            ]
            rows.append(np.concatenate(white))
        return np.stack(rows)

    def whitened(self, away: Array) -> Array:
        """Return a deviation (points,) of ln of the power as `clean` gives data."""
        return np.asarray(solve_triangular(self._factor[0], away[self.seen], lower=True))

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
    ) -> dict[str, xr.Dataset]:
        """The power in dB, or both quadratures [V], with noise that went through the filter."""
        return {"decay": self._written(base, hidden, rng)}

    def _written(self, base: Values, hidden: dict[str, Values], rng: Noise) -> xr.Dataset:
        motion = self._seen([(base, hidden)])[0]
        size = len(motion) + self.before * STEPS
        moving = np.zeros(size, complex)
        moving[self.before * STEPS :] = motion
        # Nothing, then the drive holds the mode and feeds through
        driven = slice(self.before * STEPS // 3, self.before * STEPS)
        moving[driven] = 1.0 + FEED
        parts = rng.standard_normal((2, size))
        power = 10 ** ((base["floor"] - base["level"]) / 10)
        moving = moving + np.sqrt(power / 2) * self._loud() * (parts[0] + 1j * parts[1])
        seen = self._behind(moving)[::STEPS]
        gain = self._drifting(rng, len(seen))
        gain[self.before :][self.seen] += self._factor[0] @ self.unknown[: len(self._factor[0])]
        seen = seen * np.exp(gain / 2) * 10 ** (base["level"] / 20)
        time = self.interval * np.arange(len(seen))
        told = {"frequency": TONE, "bandwidth": self.width}
        if not self.phased:
            shown = DIGIT * np.round(20 * np.log10(np.abs(seen)) / DIGIT)
            return measurement.decay(time, shown, attributes=told)
        turning = base["phase"] + 2 * np.pi * base["detuning"] * (time - time[self.before])
        seen = seen * np.exp(1j * turning)
        return measurement.decay(time, real=seen.real, imag=seen.imag, attributes=told)

    def _angle(self, base: Values, behind: np.ndarray) -> Array:
        angle = np.unwrap(np.angle(behind)) + base["phase"]
        return np.asarray(angle + 2 * np.pi * base["detuning"] * self.time)

    def _filtered(self, variants: list[tuple[Values, dict[str, Values]]]) -> np.ndarray:
        """Return the amplitudes (n_variants, points) behind the filter."""
        return np.stack([self._behind(one)[::STEPS] for one in self._seen(variants)])

    def _behind(self, moving: np.ndarray) -> np.ndarray:
        """Return a signal behind the filter, whose pulse is a Gaussian in time."""
        pulse = self._pulse()
        half = len(pulse) // 2
        ends = np.concatenate([np.full(half, moving[0]), moving, np.full(half, moving[-1])])
        return np.asarray(fftconvolve(ends, pulse, mode="valid"))

    def _pulse(self) -> Array:
        """Return the pulse of a filter that takes half of the power at half its width, −3 dB."""
        sd = np.sqrt(np.log(2)) / (np.pi * self.width)
        step = self.interval / STEPS
        half = max(int(REACH * sd / step), 1)
        shape = np.exp(-0.5 * (step * np.arange(-half, half + 1) / sd) ** 2)
        return np.asarray(shape / shape.sum())

    def _loud(self) -> float:
        """Return by how much white noise must be larger to have variance 1 behind the filter."""
        return float(1 / np.sqrt(np.sum(self._pulse() ** 2)))

    def _seen(self, variants: list[tuple[Values, dict[str, Values]]]) -> np.ndarray:
        """Return what the detector sees of the motion, (n_variants, steps), 1 at the begin."""
        hidden = [causes for _, causes in variants]
        rates = np.array([base["decay_rate"] for base, _ in variants])
        moved = self._moved(rates, hidden)
        time = self.interval / STEPS * np.arange(moved.shape[1])
        rows = []
        for row, causes in zip(moved, hidden, strict=True):
            seen = row
            if "filter_exit" in causes:
                seen = seen * np.exp(1j * self._chirp(time, causes))
            if "working_point" in causes:
                seen = seen * self._fringe(time, causes)
            if "feed_through" in causes:
                leak = causes["feed_through"]
                fading = np.exp(-laws.inexact(causes, "feed_through") * time / self.whole)
                tone = np.exp(2j * np.pi * leak["offset"] * time)
                seen = seen + (leak["in_phase"] + 1j * leak["quadrature"]) * fading * tone
            rows.append(seen)
        return np.stack(rows)

    def _chirp(self, time: Array, causes: dict[str, Values]) -> Array:
        """Return the phase of a mode that drifts so fast that the filter loses it in time."""
        pace = np.sqrt(causes["filter_exit"]["exit_rate"] / np.log(16)) * self.width
        counts = laws.relaxed(time, time[-1], laws.inexact(causes, "filter_exit"))
        away = 2 * np.pi * pace * counts
        steps = np.diff(time, prepend=0.0)
        return np.asarray(np.cumsum(away * steps))

    def _fringe(self, time: Array, causes: dict[str, Values]) -> Array:
        """Return the part of the motion that the first harmonic of the fringe shows."""
        point = causes["working_point"]
        counts = laws.relaxed(time, time[-1], laws.inexact(causes, "working_point"))
        place = point["phase"] + point["turn"] * counts
        waves = SWING * np.cos(FRINGE)
        first = np.sin(place[:, None] + waves) @ np.cos(FRINGE)
        return np.asarray(first / (np.sin(point["phase"] + waves) @ np.cos(FRINGE)))

    def _moved(self, rates: Array, hidden: list[dict[str, Values]]) -> np.ndarray:
        """Return the motion (n_variants, steps) by classical Runge–Kutta steps, side by side."""

        def spec(cause: str, name: str) -> Array:
            return np.array([causes.get(cause, {}).get(name, 0.0) for causes in hidden])

        def off(cause: str) -> Array:
            return np.array([laws.inexact(causes, cause) for causes in hidden])

        eta = spec("nonlinear_damping", "eta") / 4
        steep = eta * off("nonlinear_damping")
        excess = spec("energy_exchange", "excess")
        threshold = spec("energy_exchange", "threshold")
        soft = SHARP + 2 * off("energy_exchange")
        shift = 2 * np.pi * spec("duffing_shift", "shift")
        quartic = shift * off("duffing_shift")
        drift = 2 * np.pi * TONE * spec("frequency_drift", "rate")
        slowing = off("frequency_drift")
        beat = 2 * np.pi * spec("beating_pair", "splitting")
        faster = spec("beating_pair", "partner_rate")
        third = off("beating_pair")
        size = spec("beating_pair", "in_phase") + 1j * spec("beating_pair", "quadrature")
        whole = self.interval * self.points

        def flow(state: np.ndarray, time: float) -> np.ndarray:
            mode, partner, other = state
            energy = np.abs(mode) ** 2
            above = 0.5 + 0.5 * np.tanh((np.log(energy + 1e-300) - threshold) / soft)
            loss = rates * (1 + eta * energy + steep * energy**2 + excess * above)
            turn = shift * energy + quartic * energy**2
            turn = turn + drift * laws.relaxed(time, whole, slowing)
            return np.stack(
                [
                    (-loss / 2 + 1j * turn) * mode,
                    (-faster / 2 + 1j * beat) * partner,
                    (-faster / 2 + 1.6j * beat) * other,
                ]
            )

        step = self.interval / STEPS
        state = np.stack([np.ones(len(rates), complex), size, third * size])
        found = np.empty((len(rates), self.points * STEPS), complex)
        for k in range(found.shape[1]):
            found[:, k] = state.sum(axis=0)
            time = k * step
            one = flow(state, time)
            two = flow(state + step / 2 * one, time + step / 2)
            three = flow(state + step / 2 * two, time + step / 2)
            four = flow(state + step * three, time + step)
            state = state + step / 6 * (one + 2 * two + 2 * three + four)
        return found

    def _noise_factor(self) -> list[Array]:
        """Return triangular factors of the noise of power and phase."""
        time = self.time[self.seen]
        ratio = 10 ** (self.depth / 10) * np.exp(-self.rate * time)
        pulse = self._pulse()
        along = np.correlate(pulse, pulse, mode="full")[len(pulse) - 1 :: STEPS]
        lag = np.abs(np.subtract.outer(np.arange(len(time)), np.arange(len(time))))
        known = np.concatenate([along / along[0], np.zeros(1)])
        rho = known[np.minimum(lag, len(known) - 1)]
        part = ratio / (1 + ratio)
        cross = np.sqrt(part * (1 - part))
        power = 2 * rho * np.outer(cross, cross) + rho**2 * np.outer(1 - part, 1 - part)
        power += DRIFT**2 * self._smooth(time) * np.outer(part, part)
        nugget = 1e-8 * np.eye(len(time))
        found = [cholesky(power + nugget, lower=True)]
        if self.phased:
            strong = ratio > 20
            angle = rho[np.ix_(strong, strong)] / 2
            angle = angle / np.sqrt(np.outer(ratio[strong], ratio[strong]))
            found.append(cholesky(angle + 1e-8 * np.eye(int(strong.sum())), lower=True))
        return found

    def _smooth(self, time: Array) -> Array:
        """Return the correlation of a gain that drifts within a quarter of the decay."""
        apart = np.subtract.outer(time, time) / (self.whole / 4)
        return np.asarray(np.exp(-0.5 * apart**2))

    def _drifting(self, rng: Noise, count: int) -> Array:
        """Return the drift of the gain (count,), as ln of the power."""
        time = self.interval * np.arange(count)
        factor = cholesky(self._smooth(time) + 1e-8 * np.eye(count), lower=True)
        return np.asarray(DRIFT * (factor @ rng.standard_normal(count)))


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> DecayBench:
    """Prepare a measurement; the device plays no part."""
    return DecayBench(causes, rng)


def _pair(rng: np.random.Generator, bench: DecayBench) -> Cause:
    turn = rng.uniform(-np.pi, np.pi)
    values = {
        "in_phase": 0.05 * float(np.cos(turn)),
        "quadrature": 0.05 * float(np.sin(turn)),
        "splitting": float(np.exp(rng.uniform(np.log(4), np.log(25)))) / bench.whole,
        "partner_rate": bench.rate * float(rng.uniform(0.6, 2.0)),
    }
    return Cause(values, ("in_phase", "quadrature"), 14.0)


def _leak(rng: np.random.Generator, bench: DecayBench) -> Cause:
    turn = rng.uniform(-np.pi, np.pi)
    values = {
        "in_phase": 0.01 * float(np.cos(turn)),
        "quadrature": 0.01 * float(np.sin(turn)),
        "offset": float(rng.uniform(2, 15)) / bench.whole,
    }
    return Cause(values, ("in_phase", "quadrature"), 10.0)


def _exit(rng: np.random.Generator, bench: DecayBench) -> Cause:
    return Cause({"exit_rate": 0.3 / bench.whole**2}, ("exit_rate",), 20.0)


def _point(rng: np.random.Generator, bench: DecayBench) -> Cause:
    phase = float(rng.uniform(0, 0.8))
    # No further than where the fringe turns round
    most = 1.45 - phase
    turn = 0.2 / bench.whole
    return Cause({"turn": turn, "phase": phase}, ("turn",), most / 0.2)


def _exchange(rng: np.random.Generator, bench: DecayBench) -> Cause:
    values = {"excess": 0.1, "threshold": float(rng.uniform(-5, -1))}
    return Cause(values, ("excess",), 90.0)


def _shift(rng: np.random.Generator, bench: DecayBench) -> Cause:
    return Cause({"shift": 0.01 * bench.rate * sign(rng)}, ("shift",), 1e3)


def _drift(rng: np.random.Generator, bench: DecayBench) -> Cause:
    rate = 0.1 / (np.pi * TONE * bench.whole**2)
    return Cause({"rate": float(rate) * sign(rng)}, ("rate",), min(300.0, 5e-7 / rate))


CAUSES: dict[str, Callable[[np.random.Generator, DecayBench], Cause]] = {
    "beating_pair": _pair,
    "duffing_shift": _shift,
    "energy_exchange": _exchange,
    "feed_through": _leak,
    "filter_exit": _exit,
    "frequency_drift": _drift,
    "nonlinear_damping": lambda rng, bench: Cause({"eta": 0.1}, ("eta",), 200.0),
    "working_point": _point,
}
DERIVED = {
    **dict.fromkeys(
        CAUSES, "Runge–Kutta steps of the slow flow, then a Gaussian pulse in time as the filter"
    ),
    "feed_through": "a tone added before the filter, a Gaussian pulse in time",
    "filter_exit": "a chirp through the filter, a Gaussian pulse in time",
    "working_point": "first harmonic of a sampled fringe",
}
"""How the laboratory computes a cause, other than the library does."""
