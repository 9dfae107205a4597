"""A long record of drive and motion against one oscillator with a cubic force, by free run."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, Kind, ParameterSpec, Values
from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import Fit
from femnl.core.readout import Array
from femnl.core.stages import Equation
from femnl.diagnose.least_squares import fit
from femnl.diagnose.score_directions import forces
from femnl.fits.record.oscillator import (
    LINEAR,
    begun,
    equation_start,
    fit_oscillator,
    settled,
    simulate_oscillator,
)
from femnl.io.measurement import noise_sd
from femnl.observe.model import ExtendedModel, Named, Ranked, apply
from femnl.observe.record.free_run import EDGE, Drive, Numbers, free_run, stages, steps_needed

BLOCKS = 6
"""Stretches of the record that are held out one by one."""
LEAST = 100
"""Samples that the linear oscillator is fitted to; where fewer have forgotten the begin, all are.
"""
MOST = 20_000
"""Samples that are compared; all are simulated."""
STEP = 1e-30
HOPELESS = 0.3
"""Part of the output's rms that is left where the base model has nothing to do with it."""
FOLLOWED = 1.2
"""Times σ that are left where the base model follows the record after all."""
HORIZONS = tuple(np.geomspace(first, 1, 15) for first in (0.03, 0.015, 0.06))
"""Parts of the record that the base model is fitted to one after the other: over a short time a
strong motion has fewer minima.

Other parts are gone through where one leaves more than noise.
"""
DRAWN = 400
"""Samples that are drawn."""
RANGES = {
    "kappa2": ("V^-1", 1.0, "slope"),
    "eta": ("V^-2", 100.0, "curvature"),
    "alpha5": ("V^-4", 1.0, "curvature_square"),
}
"""Unit, size and scale of the effects' parameters where the output in volts stands for metres."""


class RecordModel:
    """Residuals of the free run ÿ + γ(1 + ηy²)ẏ + ω₀²(y + κ₂y² + αy³ + α₅y⁵) = ω₀²(u + u₀)/k.

    See `MeasurementModel`.

    y is the output and u the drive, in V: the measured output never enters the simulation. What it
    begins with is fitted.
    """

    kind: Kind = "record"
    needs_global_search = False
    jumps: tuple[str, ...] = ()
    independent_blocks: tuple[Mapping[str, NDArray[np.bool_]], ...] = ()
    ranked: tuple[Ranked, ...] = ()

    def __init__(self, dataset: xr.Dataset) -> None:
        if dataset.sizes["step"] != 1:
            raise MeasurementError(
                f"trace: {dataset.sizes['step']} records of drive and output; diagnose them one "
                "file each"
            )
        # The motion before the first known sample is not asked for.
        dataset = dataset.isel(
            time=slice(int(np.argmax(np.isfinite(dataset["voltage"].values[0]))), None)
        )
        drive = dataset["drive_voltage"].values[0]
        output = dataset["voltage"].values[0]
        self._time = dataset["time"].values
        self._interval = float(np.median(np.diff(self._time)))
        late = settled(drive, output, 1 / self._interval)
        late = late if np.count_nonzero(late) >= LEAST else np.isfinite(output)
        linear = fit_oscillator(drive, output, 1 / self._interval, ("offset",), fitted=late)
        self.noise, note = noise_sd(dataset)
        begin = begun(output, self._interval)
        (mass, damping, stiffness, offset, cubic), self._drive = self._nearest(
            drive, output, linear, begin
        )
        frequency = np.sqrt(stiffness / mass) / (2 * np.pi)
        width = damping / mass / (2 * np.pi)
        alpha = cubic / stiffness
        length = len(output)
        usable = np.isfinite(output)
        usable[:EDGE] = usable[length - EDGE :] = False  # the drive's spline ends there
        self._at = np.flatnonzero(usable)[:: -(-np.count_nonzero(usable) // MOST)]
        self._output = np.asarray(output[self._at], float)
        largest = float(np.abs(self._output).max())
        stiff = sorted((stiffness / 5, 5 * stiffness))
        self.base: tuple[ParameterSpec, ...] = (
            ParameterSpec("frequency", "Hz", frequency / 2, 2 * frequency),
            ParameterSpec("linewidth", "Hz", width / 10, 10 * width),
            ParameterSpec("stiffness", "V/V", *stiff),
            ParameterSpec("offset", "V", -float(np.ptp(drive)), float(np.ptp(drive))),
            ParameterSpec("begin", "V", -2 * largest, 2 * largest),
            ParameterSpec(
                "begin_speed",
                "V/s",
                -4 * np.pi * frequency * largest,
                4 * np.pi * frequency * largest,
            ),
            ParameterSpec(
                "alpha", "V^-2", -5 / largest**2 - abs(alpha), 5 / largest**2 + abs(alpha)
            ),
        )
        self.start = np.array([frequency, width, stiffness, offset, *begin, alpha])
        self.scales: Mapping[str, float] = {
            "slope": 1 / largest,
            "curvature": largest**-2,
            "curvature_square": largest**-4,
        }
        left, self.start = self._followed()
        base, _ = ExtendedModel(self).split(self.start)
        moved = float(np.std(self._output))
        if left > HOPELESS * moved:
            raise MeasurementError(
                f"trace: no oscillator with a cubic force follows the output: of {moved:.3g} V "
                f"rms {left:.3g} V are left; check that drive and output belong together and run "
                "at the same time, or give a record of a weaker drive"
            )
        # The derivative by the begin: in a chaotic motion it grows, and a model that is a little
        # wrong follows that nowhere.
        grown = float(np.abs(self._run(base, (), (), 1j * STEP).imag).max()) / STEP
        if left > FOLLOWED * self.noise and grown * left > largest:
            raise MeasurementError(
                "trace: with the forces that come closest the motion is chaotic: changes of its "
                f"begin grow {grown:.2g} times, and the {left:.2g} V that are left to more than "
                "the motion; give a record of a weaker drive"
            )
        linearly = float(
            np.nanstd((simulate_oscillator(linear, drive, 1 / self._interval) - output)[late])
        )
        self.notes: tuple[str, ...] = (
            f"trace: {note}",
            "trace: a free run from the drive alone; a linear oscillator that begins at rest "
            f"leaves {linearly:.3g} V rms, and the cubic term of the base model lowers that to "
            f"{left:.3g} V; volts of the output stand for metres",
            f"trace: {len(self._at)} of {length} samples are compared; y and its speed at the "
            "first one are fitted",
        )

    def _nearest(
        self, drive: Array, output: Array, linear: Fit, begin: Array
    ) -> tuple[Array, Drive]:
        """Return the terms that follow the record's first part best, and the drive in steps.

        Mass, damping, stiffness, offset and cubic term.
        """
        names = (*LINEAR, "offset", "cubic")
        first = slice(EDGE, max(int(HORIZONS[0][0] * len(output)), 3 * EDGE))
        found = []
        for values in (
            equation_start(names, drive, output, self._interval),
            np.array([linear[name] if name != "cubic" else 0.0 for name in names]),
        ):
            mass, damping, stiffness, offset, cubic = values
            # Noise turns the equation round where the forces are weak
            if damping / mass > 0 and stiffness / mass > 0:
                terms = np.array(
                    [1 / mass, offset, damping / mass, 0, stiffness / mass, 0, cubic / mass, 0]
                )
                steps = steps_needed(terms, float(np.nanmax(np.abs(output))), self._interval)
                held = stages(drive, self._interval, "band-limited", steps)
                left = free_run(terms[:, None], held, begin[:, None])[0] - output
                found.append((float(np.nansum(left[first] ** 2)), values, held))
        _, values, held = min(found, key=lambda one: one[0])
        return values, held

    def _followed(self) -> tuple[float, Array]:
        """Return what the base model leaves [V rms], and its vector.

        It follows the record over longer and longer parts.
        """
        model = ExtendedModel(self)
        found = []
        for parts in HORIZONS:
            vector = self.start
            for part in parts:
                vector = fit(model, vector, np.arange(len(self._at)) < len(self._at) * part).vector
            found.append((self.noise * float(np.std(model.residuals(vector))), vector))
            if found[-1][0] <= FOLLOWED * self.noise:
                break
        return min(found, key=lambda one: one[0])

    def pool(self, library: Iterable[Effect]) -> list[Effect]:
        """Return the effects on the forces, with ranges and units in volts of the output."""
        found = []
        for effect in library:
            if "equation" in effect.changes:
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
        """Stretches of the record."""
        return np.arange(len(self._at)) * BLOCKS // len(self._at)

    def predict(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return the output [V] at the samples compared."""
        return np.asarray(self._run(base, effects, values), float)

    def _run(
        self,
        base: Values,
        effects: Sequence[Effect],
        values: Sequence[Values],
        shift: complex = 0.0,
    ) -> Numbers:
        """Return the output [V] at the samples compared.

        From a begin that is shifted [V] where asked for.
        """
        forces = apply("equation", Equation(0.0, base["alpha"], 0.0, 0.0), effects, values)
        square = (2 * np.pi * base["frequency"]) ** 2
        shares = np.array([1.0, forces.quadratic, forces.cubic, forces.quintic]) * square
        loss = [2 * np.pi * base["linewidth"], forces.damping]
        begin = np.array([[base["begin"] + shift], [base["begin_speed"]]])
        terms = np.array(
            [square / base["stiffness"], base["offset"], *loss, *shares], dtype=begin.dtype
        )
        run: Numbers = free_run(terms[:, None], self._drive, begin)[0, self._at]
        return run

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (output − free run)/σ."""
        return np.asarray((self._output - self.predict(effects, base, values)) / self.noise)

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Powers of the output, its slope, and forces of higher order."""
        output = self.predict(effects, base, values)
        unit = output / np.abs(output).max()
        found = {f"power {n} of the output": unit**n / self.noise for n in (0, 2, 3)}
        found["slope of the output"] = np.gradient(unit) / self.noise
        return found | forces(self, effects, base, values)

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """The forces that the same record would show at other sizes of the motion."""
        forces = apply("equation", Equation(0.0, base["alpha"], 0.0, 0.0), effects, values)
        y = 2 / self.scales["slope"] * np.linspace(-1, 1, 41)
        nonlinear = y**2 * (forces.quadratic + y * (forces.cubic + y**2 * forces.quintic))
        loss = base["linewidth"] / base["frequency"] * forces.damping * y**3
        return {
            "the same record at twice the output": np.concatenate([nonlinear, loss]) / self.noise
        }

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """None: these data leave one solution."""
        return []

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """The stretch where the output is largest."""
        middle = int(np.argmax(np.abs(self._output)))
        part = slice(max(middle - DRAWN // 2, 0), middle + DRAWN // 2)
        predicted = np.stack(
            [self.predict(effects, base, values)[part] for _, effects, base, values in models]
        )
        data = self._output[part]
        curve = Curve(
            "output",
            np.asarray(self._time[self._at[part]], float),
            data,
            np.full(len(data), self.noise),
            predicted,
        )
        return (
            Curves(
                "trace", "time", "s", "output", "V", tuple(name for name, *_ in models), (curve,)
            ),
        )

    def systematic(self, unit: str) -> float:
        """Nothing beside the statistics."""
        return 0.0

    def describe(self, residuals: Array) -> str:
        """Say what the free run leaves, and where in the record most."""
        rms = [float(np.sqrt(np.mean(part**2))) for part in np.array_split(residuals, BLOCKS)]
        worst = int(np.argmax(rms))
        times = self._time[self._at[[0, -1]]]
        start, stop = (
            times[0] + (times[1] - times[0]) * part / BLOCKS for part in (worst, worst + 1)
        )
        size = float(np.sqrt(np.mean(residuals**2)) * self.noise)
        return (
            f"the free run leaves {size:.3g} V rms, most between {start:.3g} and {stop:.3g} s "
            f"({max(rms):.3g}σ against {min(rms):.3g}σ)"
        )
