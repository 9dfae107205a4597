"""Frequency and quality factor against what the surroundings do."""

from collections.abc import Callable

import numpy as np
import xarray as xr

from femnl.device import geometry
from femnl.io import measurement
from tests.blind.lab import laws
from tests.blind.lab.bench import Array, Cause, Noise, Values, sign
from tests.blind.lab.surroundings import (
    charged,
    dashpot,
    delayed,
    gas_above_wave,
    gas_below,
    trapped,
    warmed,
)

VACUUM = 8.8541878188e-12
"""Permittivity of vacuum [F/m]."""
SPARED = 0.8
"""Part of the largest softening that is used: the film's frequency may be 5 % off."""


class SeriesBench:
    """Points in the order taken; see `Bench`."""

    def __init__(self, name: str, causes: tuple[str, ...], rng: np.random.Generator) -> None:
        model = geometry.load(name)
        self.film = model.film
        assert model.stack is not None
        self.gap = model.stack.layers[model.stack.gap].thickness
        self.unit = {"frequency": 1.5e6, "quality_factor": 5e5}
        n = self.n = int(rng.integers(15, 35))
        ranges = {
            "pressure": np.geomspace(0.1, 100, n),
            "temperature": np.linspace(290, 310, n),
            "laser_power": np.linspace(1e-6, 1e-4, n),
            "voltage": np.linspace(-10, 10, n),
        }
        needed = {
            "gas_damping": "pressure",
            "gas_loading": "pressure",
            "trapped_gas": "pressure",
            "thermal_stress": "temperature",
            "photothermal": "laser_power",
            "optical_spring": "laser_power",
            "electrostatic_softening": "voltage",
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
            # A film that oscillates by itself has no quality factor
            q = np.log(np.where(q > 0, q, np.inf))
            rows.append(np.concatenate([f / self.sd["frequency"], q / self.sd["quality_factor"]]))
        return np.stack(rows)

    def _points(self, base: Values, hidden: dict[str, Values]) -> tuple[Array, Array]:
        film = self.film
        inertia = film.density * film.thickness
        omega = 2 * np.pi * base["frequency"]
        square = np.full(self.n, omega**2)
        loss = np.full(self.n, 1 / base["quality_factor"])
        control = self.control
        if "thermal_stress" in hidden:
            warm = control["temperature"] - control["temperature"].mean()
            warm = warm * (1 + laws.inexact(hidden, "thermal_stress") * warm / warm.max())
            square = square * warmed(film, hidden["thermal_stress"]["slope"], warm)
        if "photothermal" in hidden:
            heat = hidden["photothermal"]
            power = self._bent("laser_power", laws.inexact(hidden, "photothermal"))
            # A kelvin a watt, at which the film would lose that much of its stress
            square = square * warmed(film, 2 * heat["softening"], power)
            loss = loss * (1 + heat["loss"] * power)
        if "gas_loading" in hidden:
            wave = np.array([omega * np.sqrt(film.density / film.stress)])
            depth = float((gas_above_wave(wave) + gas_below(wave, self.gap))[0])
            part = self._bent("pressure", -laws.inexact(hidden, "gas_loading"))
            part = part / control["pressure"].max()
            square = square / (1 + hidden["gas_loading"]["gas_density"] * part * depth / inertia)
        if "optical_spring" in hidden:
            light = hidden["optical_spring"]
            lag = -light["loss"] / (light["spring"] * base["quality_factor"])
            power = self._bent("laser_power", laws.inexact(hidden, "optical_spring"))
            pushed = delayed(omega**2, light["spring"] * power, lag)
            square = square * pushed.real / omega**2
            loss = loss + pushed.imag / pushed.real
        if "trapped_gas" in hidden:
            gas = hidden["trapped_gas"]
            pressure = self._bent("pressure", -laws.inexact(hidden, "trapped_gas"))
            springs = gas["pressure"] * pressure / control["pressure"].max()
            held = np.array(
                [
                    trapped(square[k : k + 1], p / (inertia * self.gap), [gas["escape_time"]])[0]
                    for k, p in enumerate(springs)
                ]
            )
            square = held.real
            loss = loss + held.imag / held.real
        if "electrostatic_softening" in hidden:
            charge = laws.first(hidden["electrostatic_softening"])
            voltage = control["voltage"]
            steep = laws.inexact(hidden, "electrostatic_softening")
            voltage = voltage * np.sqrt(1 + steep * (voltage / voltage.max()) ** 2)
            square = square * charged(voltage, self.gap, **charge)
        if "gas_damping" in hidden:
            loss = loss + hidden["gas_damping"]["per_pressure"] * self._bent(
                "pressure", -laws.inexact(hidden, "gas_damping")
            )
        f = np.sqrt(square) / (2 * np.pi)
        if "frequency_drift" in hidden:
            time = laws.relaxed(
                control["time"], control["time"].max(), laws.inexact(hidden, "frequency_drift")
            )
            f = f * (1 + hidden["frequency_drift"]["rate"] * time)
        return f, 1 / loss

    def _bent(self, name: str, much: float) -> Array:
        """Return a control that counts (1 + e x) of itself, x in units of its largest."""
        value = self.control[name]
        return np.asarray(value * (1 + much * value / value.max()))

    def measured(
        self, base: Values, hidden: dict[str, Values], rng: Noise
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
    """Draw thin gas of a usual kind; its pressures reach where it shows."""
    molar_mass = float(rng.choice([0.004, 0.028, 0.029, 0.040, 0.146]))
    inertia = bench.film.density * bench.film.thickness
    first = 2 * np.pi * bench.unit["frequency"] * inertia
    value = dashpot(molar_mass, rng.uniform(285, 305)) / first * rng.uniform(0.8, 1.2)
    return Cause({"per_pressure": float(value)}, ())


def _load(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    return Cause({"gas_density": 1e-7}, ("gas_density",), 1e4)


def _trapped(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    turn = np.exp(rng.uniform(np.log(3.0), np.log(300.0)))
    values = {"pressure": 0.1, "escape_time": float(turn / (2 * np.pi * bench.unit["frequency"]))}
    return Cause(values, ("pressure",), 1000.0)


def _warm(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    return Cause({"slope": 1e-6 * sign(rng)}, ("slope",), 3e3)


def _heat(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    values = {
        "softening": 0.1,
        "loss": float(rng.choice([0.0, rng.uniform(10, 300)])),
    }
    return Cause(values, ("softening", "loss"), 300.0)


def _spring(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    spring = 0.1 * sign(rng)
    lag = float(rng.choice([0.0, np.exp(rng.uniform(np.log(1e-3), np.log(0.1)))]))
    values = {"spring": spring, "loss": -lag * spring * bench.unit["quality_factor"]}
    return Cause(values, ("spring", "loss"), 300.0)


def _charge(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    # At most that of an electrode as large as the film, a gap below it
    omega = 2 * np.pi * bench.unit["frequency"]
    most = VACUUM / (bench.film.density * bench.film.thickness * bench.gap**3 * omega**2)
    values = {"softening": 1e-9, "offset": float(rng.uniform(-3, 3))}
    return Cause(values, ("softening",), SPARED * float(most) / 1e-9)


def _drift(rng: np.random.Generator, bench: SeriesBench) -> Cause:
    return Cause({"rate": 1e-9 * sign(rng)}, ("rate",), 900.0)


CAUSES: dict[str, Callable[[np.random.Generator, SeriesBench], Cause]] = {
    "electrostatic_softening": _charge,
    "frequency_drift": _drift,
    "gas_damping": _gas,
    "gas_loading": _load,
    "optical_spring": _spring,
    "photothermal": _heat,
    "thermal_stress": _warm,
    "trapped_gas": _trapped,
}
DERIVED: dict[str, str] = {
    "electrostatic_softening": "curvature of the energy of a plate at rest in the field, by "
    "differences",
    "frequency_drift": "a rate times the time of each point",
    "gas_damping": "momentum of Maxwell's molecules that bounce off a moving plate, by quadrature",
    "gas_loading": "kinetic energy of the gas above by quadrature, below by differences in height",
    "optical_spring": "roots of the motion together with the force that relaxes",
    "photothermal": "balance of forces of a warm film on a cold wafer 3000 times as thick",
    "thermal_stress": "balance of forces of a film on a wafer 3000 times as thick",
    "trapped_gas": "roots of the motion of film and pressure together",
}
"""How the laboratory computes a cause, other than the library does."""
