"""Frequency and quality factor against what the surroundings do."""

from collections.abc import Callable

import numpy as np
import xarray as xr

from femnl.device import geometry
from femnl.io import measurement
from tests.blind.lab.bench import Array, Cause, Values, sign


class SeriesBench:
    """Points in the order taken; see `Bench`."""

    def __init__(self, name: str, causes: tuple[str, ...], rng: np.random.Generator) -> None:
        self.film = geometry.load(name).film
        self.unit = {"frequency": 1.5e6, "quality_factor": 5e5}
        n = self.n = int(rng.integers(15, 35))
        ranges = {
            "pressure": np.geomspace(0.1, 100, n),
            "temperature": np.linspace(290, 310, n),
            "laser_power": np.linspace(1e-6, 1e-4, n),
        }
        needed = {
            "gas_damping": "pressure",
            "gas_loading": "pressure",
            "thermal_stress": "temperature",
            "photothermal": "laser_power",
        }
        varied = {needed[cause] for cause in causes if cause in needed} or {
            str(rng.choice(list(ranges)))
        }
        self.control = {
            name: values if i == 0 else rng.permutation(values)
            for i, (name, values) in enumerate(ranges.items())
            if name in varied
        }
        if "frequency_drift" in causes or rng.uniform() < 0.5:
            self.control["time"] = 300.0 * rng.permutation(n)
        self.sd = {"frequency": float(rng.choice([0.5, 2.0])), "quality_factor": 0.01}

    def draw(self, rng: np.random.Generator) -> Values:
        """Draw f [Hz] and Q."""
        return {
            "frequency": 1.5e6 * (1 + 0.05 * rng.uniform(-1, 1)),
            "quality_factor": 5e5 * np.exp(rng.uniform(-1, 1)),
        }

    def clean(self, variants: list[tuple[Values, dict[str, Values]]]) -> Array:
        """F and Q over their σ."""
        rows = []
        for base, hidden in variants:
            f, q = self._points(base, hidden)
            rows.append(
                np.concatenate([f / self.sd["frequency"], np.log(q) / self.sd["quality_factor"]])
            )
        return np.stack(rows)

    def _points(self, base: Values, hidden: dict[str, Values]) -> tuple[Array, Array]:
        f = np.full(self.n, base["frequency"])
        loss = np.full(self.n, 1 / base["quality_factor"])
        if "gas_damping" in hidden:
            loss = loss + hidden["gas_damping"]["per_pressure"] * self.control["pressure"]
        if "thermal_stress" in hidden:
            warm = self.control["temperature"] - self.control["temperature"].mean()
            f = f * np.sqrt(1 - hidden["thermal_stress"]["slope"] * warm)
        if "photothermal" in hidden:
            power = self.control["laser_power"]
            heat = hidden["photothermal"]
            f = f * (1 + heat["pull"] * power + heat["bend"] * power**2)
            loss = loss * (1 + heat["loss"] * power)
        if "gas_loading" in hidden:
            # The wave number stays while the gas comes in, ω²(ρh + 2ρ_g/k) = Tk².
            wave = 2 * np.pi * base["frequency"] * np.sqrt(self.film.density / self.film.stress)
            gas = (
                hidden["gas_loading"]["gas_density"]
                * self.control["pressure"]
                / self.control["pressure"].max()
            )
            tension = self.film.stress * self.film.thickness
            f = (
                np.sqrt(tension / (self.film.density * self.film.thickness + 2 * gas / wave))
                * wave
                / (2 * np.pi)
                * f
                / base["frequency"]
            )
        if "frequency_drift" in hidden:
            f = f * (1 + hidden["frequency_drift"]["rate"] * self.control["time"])
        return f, 1 / loss

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: np.random.Generator
    ) -> dict[str, xr.Dataset]:
        """Points with noise, f to 0.01 Hz, Q to its last digit."""
        f, q = self._points(base, hidden)
        spread = self.sd["quality_factor"] * q
        noisy_f = np.round(f + self.sd["frequency"] * rng.standard_normal(self.n), 2)
        noisy_q = np.round(q + spread * rng.standard_normal(self.n))
        return {
            "series": measurement.series(
                self.control, noisy_f, np.full(self.n, self.sd["frequency"]), noisy_q, spread
            )
        }


def setup(name: str, causes: tuple[str, ...], rng: np.random.Generator) -> SeriesBench:
    """Prepare a measurement; of the device only its film plays a part."""
    return SeriesBench(name, causes, rng)


def _gas(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    return Cause({"per_pressure": 1e-9}, ("per_pressure",), 1e3)


def _load(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    return Cause({"gas_density": 1e-5}, ("gas_density",), 1e5)


def _warm(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    return Cause({"slope": 1e-6 * sign(rng)}, ("slope",), 1e4)


def _heat(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    values = {
        "pull": 0.1 * sign(rng),
        "bend": 100.0 * rng.uniform(-1, 1),
        "loss": float(rng.choice([0.0, rng.uniform(10, 300)])),
    }
    return Cause(values, tuple(values), 300.0)


def _drift(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    return Cause({"rate": 1e-9 * sign(rng)}, ("rate",), 900.0)


CAUSES: dict[str, Callable[[np.random.Generator, SeriesBench], Cause]] = {
    "frequency_drift": _drift,
    "gas_damping": _gas,
    "gas_loading": _load,
    "photothermal": _heat,
    "thermal_stress": _warm,
}
