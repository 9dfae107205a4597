"""A long record of drive and motion against one oscillator with a cubic force, by free run."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.errors import ParameterError
from femnl.core.numbers import engineering
from femnl.core.readout import Array
from femnl.core.stages import Equation
from femnl.observe.model import MeasurementModel, Named, apply
from femnl.observe.record.free_run import Drive, Numbers, free_run
from femnl.observe.residuals import Layout, Quantity
from femnl.observe.score_directions import forces

BLOCKS = 6
"""Stretches of the record that are held out one by one."""
NEAR = (-4, -3, -2, -1, 1, 2, 3, 4)
"""Samples to those around one."""
DRAWN = 400
"""Samples that are drawn."""
RANGES = {
    "kappa2": ("V^-1", 1.0, "slope"),
    "eta": ("V^-2", 100.0, "curvature"),
    "alpha5": ("V^-4", 3.0, "curvature_square"),
}
"""Unit, size and scale of the effects' parameters where the output in volts stands for metres.

A force of fifth order is at most three times the linear one at the largest output, where one of
third order is at most five times that.
"""


@dataclass(frozen=True, eq=False)
class RecordModel(MeasurementModel):
    """Residuals of the free run ÿ + γ(1 + ηy²)ẏ + ω₀²(y + κ₂y² + αy³ + α₅y⁵) = ω₀²(u + u₀)/k.

    y is the output and u the drive, in V: the measured output never enters the simulation. What it
    begins with is fitted.

    drive: u, ready for the integrator; time (n_samples,) [s] of all samples; at (n,): those that
    are compared; output (n,) [V] and noise [V] there.
    """

    kind = "record"
    tells_noise = True

    drive: Drive
    time: Array
    at: NDArray[np.intp]
    output: Array
    noise: float
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...] = ()

    def usable_effects(self, library: Iterable[Effect]) -> list[Effect]:
        """Return the effects on the forces, with ranges and units in volts of the output."""
        found = []
        for effect in library:
            if self.can_show(effect):
                specs = []
                for spec in effect.parameters:
                    if spec.name not in RANGES:
                        raise ParameterError(
                            f"effect {effect.name}: its parameter {spec.name} has no range in "
                            "volts of a record; "
                            f"an effect on the stage equation takes {', '.join(RANGES)}"
                        )
                    unit, size, per = RANGES[spec.name]
                    specs.append(
                        replace(
                            spec,
                            unit=unit,
                            low=-size if spec.low < 0 else 0.0,
                            high=size,
                            scale=per,
                        )
                    )
                found.append(replace(effect, parameters=tuple(specs)))
        return found

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Stretches of the record.

        What the record begins with is told by the first one alone, which is never left out.
        """
        stretch = np.arange(len(self.at)) * BLOCKS // len(self.at)
        return np.where(stretch == 0, -1, stretch)

    @property
    def layout(self) -> Layout:
        """Neighbours in time; what a free run misses oscillates as the record does."""
        place = np.arange(len(self.at))
        near = place[:, None] + np.array(NEAR)
        inside = (near >= 0) & (near < len(place))
        previous = place - 1
        unrepeated = np.full(len(place), -1)
        around = np.where(inside, near, -1)
        return Layout(around, previous, place, unrepeated, oscillating=True)

    @property
    def quantity(self) -> tuple[Array, str]:
        """V of the output."""
        return np.full(len(self.at), self.noise), "V"

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The output by time."""
        sd = np.full(len(self.at), self.noise)
        time = np.asarray(self.time[self.at], float)
        return (Quantity("output", "V", np.arange(len(self.at)), sd, {"time": (time, "s")}),)

    def locate(self, residual: int) -> str:
        """Name the time."""
        return f"{self.time[self.at[residual]]:.6g} s"

    def predict(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return the output [V] at the samples compared."""
        return np.asarray(self.run(base, effects, values), float)

    def run(
        self,
        base: Values,
        effects: Sequence[Effect],
        values: Sequence[Values],
        shift: complex = 0.0,
    ) -> Numbers:
        """Return the output [V] at the samples compared, from a begin that `shift` [V] moves."""
        forces = apply("equation", Equation(0.0, base["alpha"], 0.0, 0.0), effects, values)
        square = (2 * np.pi * base["frequency"]) ** 2
        shares = np.array([1.0, forces.quadratic, forces.cubic, forces.quintic]) * square
        loss = [2 * np.pi * base["linewidth"], forces.damping]
        begin = np.array([[base["begin"] + shift], [base["begin_speed"]]])
        terms = np.array(
            [square / base["stiffness"], base["offset"], *loss, *shares], dtype=begin.dtype
        )
        run: Numbers = free_run(terms[:, None], self.drive, begin)[0, self.at]
        return run

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (output − free run)/σ."""
        return np.asarray((self.output - self.predict(effects, base, values)) / self.noise)

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return powers of the output, its slope, and forces of higher order."""
        smooth = self.smooth_deviations(effects, base, values)
        return smooth | forces(self, effects, base, values)

    def smooth_deviations(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return powers of the output, and its slope.

        Each force of higher order is what one cause does alone. Beside a discrepancy along it, that
        cause would explain nothing: a quadratic one of 617σ that left 0.5 % of χ² came behind a
        quintic one that left 99 %.
        """
        output = self.predict(effects, base, values)
        unit = output / np.abs(output).max()
        found = {f"power {n} of the output": unit**n / self.noise for n in (0, 2, 3)}
        found["slope of the output"] = np.gradient(unit) / self.noise
        return found

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return the forces that the same record would show at other sizes of the motion."""
        forces = apply("equation", Equation(0.0, base["alpha"], 0.0, 0.0), effects, values)
        y = 2 / self.scales["slope"] * np.linspace(-1, 1, 41)
        nonlinear = y**2 * (forces.quadratic + y * (forces.cubic + y**2 * forces.quintic))
        loss = base["linewidth"] / base["frequency"] * forces.damping * y**3
        return {
            "the same record at twice the output": np.concatenate([nonlinear, loss]) / self.noise
        }

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Return the stretch where the output is largest."""
        middle = int(np.argmax(np.abs(self.output)))
        part = slice(max(middle - DRAWN // 2, 0), middle + DRAWN // 2)
        predicted = np.stack(
            [self.predict(effects, base, values)[part] for _, effects, base, values in models]
        )
        data = self.output[part]
        curve = Curve(
            "output",
            np.asarray(self.time[self.at[part]], float),
            data,
            np.full(len(data), self.noise),
            predicted,
        )
        return (
            Curves(
                "trace", "time", "s", "output", "V", tuple(name for name, *_ in models), (curve,)
            ),
        )

    def describe(self, residuals: Array) -> str:
        """Say what the free run leaves, and where in the record most."""
        rms = [float(np.sqrt(np.mean(part**2))) for part in np.array_split(residuals, BLOCKS)]
        worst = int(np.argmax(rms))
        times = self.time[self.at[[0, -1]]]
        start, stop = (
            times[0] + (times[1] - times[0]) * part / BLOCKS for part in (worst, worst + 1)
        )
        size = float(np.sqrt(np.mean(residuals**2)) * self.noise)
        return (
            f"the free run leaves {engineering(size, 'V')} rms, most between {start:.3g} and "
            f"{stop:.3g} s ({max(rms):.3g}σ against {min(rms):.3g}σ)"
        )
