"""A long record of drive and motion against one oscillator with a cubic restoring force, by its free run."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.diagnose.problem import Named, Ranked, apply
from femnl.errors import MeasurementError
from femnl.fits.oscillation import SETTLED, free_run, predictable, stages, steps_needed
from femnl.fits.oscillator import fit_oscillator, settled, simulate_oscillator
from femnl.measurement import noise_sd
from femnl.types.comparison import Comparison, Curve, Curves
from femnl.types.effect import Effect, Kind, Knob, Values
from femnl.types.readout import Array
from femnl.types.scene import Equation

BLOCKS = 6
"""Stretches of the record that are held out one by one."""
MOST = 20_000
"""Samples that are compared; all are simulated."""
LEAST = 100
"""Samples without which there is nothing to compare."""
REMEMBERED = 0.1
"""Part of σ by which a prediction may depend on what the record began with."""
DRAWN = 400
"""Samples that are drawn."""
RANGES = {"kappa2": ("V^-1", 1.0, "slope"), "eta": ("V^-2", 100.0, "curvature"), "alpha5": ("V^-4", 1.0, "curvature_square")}
"""Unit, size and scale of the effects' parameters where the output in volts stands for metres."""


class OscillationProblem:
    """Residuals of the free run ÿ + γ(1 + ηy²)ẏ + ω₀²(y + κ₂y² + αy³ + α₅y⁵) = ω₀²(u + u₀)/k; see `Problem`.

    y is the output and u the drive, in V: the measured output never enters the simulation.
    """

    kind: Kind = "trace"
    rugged = False
    jumps: tuple[str, ...] = ()
    apart: tuple[Mapping[str, NDArray[np.bool_]], ...] = ()
    ranked: tuple[Ranked, ...] = ()

    def __init__(self, dataset: xr.Dataset) -> None:
        if dataset.sizes["step"] != 1:
            raise MeasurementError(f"trace: {dataset.sizes['step']} records of drive and output; diagnose them one file each")
        drive, output = dataset["drive_voltage"].values[0], dataset["voltage"].values[0]
        self._interval = float(np.median(np.diff(dataset["time"].values)))
        usable = settled(drive, output, 1 / self._interval)
        linear = fit_oscillator(drive, output, 1 / self._interval, ("offset",), fitted=usable)
        cubic = fit_oscillator(drive, output, 1 / self._interval, ("offset", "cubic"), fitted=usable, start=linear)
        self.noise, note = noise_sd(dataset)
        frequency, width = cubic["frequency"], cubic["frequency"] / cubic["quality_factor"]
        alpha, square = cubic["alpha"], (2 * np.pi * frequency) ** 2
        terms = np.array([square / cubic["stiffness"], cubic["offset"], 2 * np.pi * width, 0, square, 0, square * alpha, 0])
        steps = steps_needed(terms, float(np.nanmax(np.abs(output))), self._interval)
        self._drive = stages(drive, self._interval, "band-limited", steps)
        decay, length = np.pi * width * self._interval, len(output)
        usable = np.isfinite(output) & predictable(length, decay)
        # Strong forces can be unstable on the way, and hand on what the record began with for longer: another begin shows how long.
        other = np.where(np.arange(len(drive)) < np.argmax(usable) // 4, 0.0, drive)
        runs = [free_run(terms[:, None], held)[0] for held in (self._drive, stages(other, self._interval, "band-limited", steps))]
        remembered = np.flatnonzero(usable & (np.abs(runs[1] - runs[0]) > REMEMBERED * self.noise))
        if len(remembered):
            usable[: int(remembered[-1]) + 1] = False
        left = np.count_nonzero(usable)
        if left < LEAST:
            raise MeasurementError(
                f"trace: {left} of {length} samples do not depend on what the record began with, with the forces that come closest; "
                f"{LEAST} are needed: give a longer record, or one of a weaker drive"
            )
        short = SETTLED / decay > length / 2
        self._at = np.flatnonzero(usable)[:: -(-np.count_nonzero(usable) // MOST)]
        self._output = np.asarray(output[self._at], float)
        largest = float(np.abs(self._output).max())
        stiff = min(cubic["stiffness"] / 5, 5 * cubic["stiffness"]), max(cubic["stiffness"] / 5, 5 * cubic["stiffness"])
        self.base: tuple[Knob, ...] = (
            Knob("frequency", "Hz", frequency / 2, 2 * frequency),
            Knob("linewidth", "Hz", width / 10, 10 * width),
            Knob("stiffness", "V/V", *stiff),
            Knob("offset", "V", -float(np.ptp(drive)), float(np.ptp(drive))),
            Knob("alpha", "V^-2", -5 / largest**2 - abs(alpha), 5 / largest**2 + abs(alpha)),
        )
        self.start = np.array([frequency, width, cubic["stiffness"], cubic["offset"], alpha])
        self.facts: Mapping[str, float] = {"slope": 1 / largest, "curvature": largest**-2, "curvature_square": largest**-4}
        rms = [float(np.std((simulate_oscillator(fit, drive, 1 / self._interval) - output)[self._at])) for fit in (linear, cubic)]
        self.notes: tuple[str, ...] = (
            f"trace: {note}",
            f"trace: a free run from the drive alone; a linear oscillator leaves {rms[0]:.3g} V rms, and the cubic term of the base model "
            f"lowers that to {rms[1]:.3g} V; volts of the output stand for metres",
            f"trace: {len(self._at)} of {length} samples are compared, from {self._at[0] * self._interval:.3g} s on; earlier ones may keep "
            "motion from before the record"
            + (", and in so short a record later ones, too: what deviates may come from there" if short else ""),
        )

    def pool(self, library: Iterable[Effect]) -> list[Effect]:
        """Return the effects on the forces, with the ranges and units of their parameters in volts of the output."""
        found = []
        for effect in library:
            if "equation" in effect.changes:
                knobs = []
                for knob in effect.parameters:
                    unit, size, per = RANGES[knob.name]
                    knobs.append(replace(knob, unit=unit, low=-size if knob.low < 0 else 0.0, high=size, per=per))
                found.append(replace(effect, parameters=tuple(knobs)))
        return found

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Stretches of the record."""
        return np.arange(len(self._at)) * BLOCKS // len(self._at)

    def predict(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return the output [V] at the samples compared."""
        forces = apply("equation", Equation(0.0, base["alpha"], 0.0, 0.0), effects, values)
        square = (2 * np.pi * base["frequency"]) ** 2
        shares = np.array([1.0, forces.quadratic, forces.cubic, forces.quintic]) * square
        loss = [2 * np.pi * base["linewidth"], forces.damping]
        terms = np.array([square / base["stiffness"], base["offset"], *loss, *shares])
        return np.asarray(free_run(terms[:, None], self._drive)[0, self._at])

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (output − free run)/σ."""
        return np.asarray((self._output - self.predict(effects, base, values)) / self.noise)

    def patterns(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> dict[str, Array]:
        """Powers of the output, and its slope."""
        output = self.predict(effects, base, values)
        unit = output / np.abs(output).max()
        found = {f"power {n} of the output": unit**n / self.noise for n in (0, 2, 3)}
        return found | {"slope of the output": np.gradient(unit) / self.noise}

    def experiments(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> dict[str, Array]:
        """The forces that the same record would show at other sizes of the motion, in parts of the linear one."""
        forces = apply("equation", Equation(0.0, base["alpha"], 0.0, 0.0), effects, values)
        y = 2 / self.facts["slope"] * np.linspace(-1, 1, 41)
        nonlinear = y**2 * (forces.quadratic + y * (forces.cubic + y**2 * forces.quintic))
        loss = base["linewidth"] / base["frequency"] * forces.damping * y**3
        return {"the same record at twice the output": np.concatenate([nonlinear, loss]) / self.noise}

    def alike(self, base: dict[str, float]) -> list[dict[str, float]]:
        """None: these data leave one solution."""
        return []

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """The stretch where the output is largest."""
        middle = int(np.argmax(np.abs(self._output)))
        part = slice(max(middle - DRAWN // 2, 0), middle + DRAWN // 2)
        predicted = np.stack([self.predict(effects, base, values)[part] for _, effects, base, values in models])
        data = self._output[part]
        curve = Curve("output", np.asarray(self._at[part] * self._interval, float), data, np.full(len(data), self.noise), predicted)
        return (Curves("trace", "time", "s", "output", "V", tuple(name for name, *_ in models), (curve,)),)

    def systematic(self, unit: str) -> float:
        """Nothing beside the statistics."""
        return 0.0

    def describe(self, residuals: Array) -> str:
        """Say what the free run leaves, and where in the record most."""
        rms = [float(np.sqrt(np.mean(part**2))) for part in np.array_split(residuals, BLOCKS)]
        worst = int(np.argmax(rms))
        times = self._at[[0, -1]] * self._interval
        start, stop = (times[0] + (times[1] - times[0]) * part / BLOCKS for part in (worst, worst + 1))
        size = float(np.sqrt(np.mean(residuals**2)) * self.noise)
        return f"the free run leaves {size:.3g} V rms, most between {start:.3g} and {stop:.3g} s ({max(rms):.3g}σ against {min(rms):.3g}σ)"
