"""Driven sweeps against one Duffing mode with linear readout, all drives sharing f₀, Q and α."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison
from femnl.core.compiled import compiled
from femnl.core.effect import Effect, ManyValues, ParameterSpec, Values
from femnl.core.memo import recent
from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Acquisition, Oscillator, Signal
from femnl.observe.model import ManyResiduals, MeasurementModel, Named, apply
from femnl.observe.residuals import Layout, Quantity
from femnl.observe.response.curves import curves, described, sweep_name, voltages
from femnl.observe.response.directions import directions_of_signal
from femnl.observe.response.extent import extent
from femnl.observe.response.late import LateSweeps, States
from femnl.observe.response.layout import along_sweeps, blocks_of, marked
from femnl.observe.response.many import each_point, heights_at, once, portions
from femnl.observe.response.states import balance, branch_amplitudes, follow
from femnl.observe.response.sweeps import Sweeps, repeated

ALPHA_SD = 0.2
"""Relative standard deviation of a simulated α: Young's modulus of a thin film is rarely known
better.
"""
LITTLE = 1e-4
"""Part of the linewidth by which f₀ and w are moved where single sweeps may deviate."""
FARTHER = 2.0
"""Widths of the sweeps by which those that would tell backgrounds apart are further out."""
BEYOND = 4
"""Power of the signal with which f₀ and w may: the next beyond the cubic force."""


@dataclass(frozen=True, eq=False)
class ResponseModel(MeasurementModel):
    """Residuals of driven sweeps.

    sweeps: the data. wavelength [m], 0 where it is not known. mode: index of the driven mode;
    simulated_alpha [m⁻²]: its α. softens: whether the sweeps soften, which the geometry alone
    cannot do. place: suffix of the parameters of each position. time (n_points,): when each was
    measured [s], or the number of its sweep; step (n_points,): time since the one before, in those
    that most points take. shape (n_points,): ξ of the driven mode where the
    laser meets the film, 1 where that is not known. middle [Hz]: of the frequencies at which the
    mode moves strongly. largest [V]: signal. hidden: whether something else hides the resonance, so
    that the start is right only beside that.
    """

    kind = "response"
    stages_of_many = ("oscillator", "signal", "acquisition")
    tells_noise = True
    jumps = ("peak",)

    sweeps: Sweeps
    wavelength: float
    mode: int
    simulated_alpha: float
    softens: bool
    place: tuple[str, ...]
    time: Array
    step: Array
    shape: Array
    middle: float
    largest: float
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...]
    hidden: bool = False
    copies: int = 1

    @property
    def common(self) -> object:
        """The driven mode: each has its own forces."""
        return self.mode

    def unscaled_by(self, glitches: Sequence[int]) -> "ResponseModel":
        """Return the model whose scales are those of the other data: a glitch is no signal."""
        n = len(self.sweeps.frequency)
        used = np.ones(n, dtype=bool)
        used[[residual % n for residual in glitches if residual < 2 * n]] = False
        names = [spec.name for spec in self.base]
        height = self.start[[names.index(f"height{place}") for place in self.place]]
        left = extent(self.sweeps, height / self.start[names.index("peak")], used)
        scales = {
            "stiffening_square": abs(self.simulated_alpha) / left.motion**2,
            "moving": left.width,
        }
        return replace(
            self, middle=left.middle, largest=left.largest, scales={**self.scales, **scales}
        )

    @cached_property
    def _solved(self) -> Callable[..., ComplexArray]:
        """Amplitudes on both branches at the latest parameters."""
        if self.copies > 1:
            return once(branch_amplitudes, self.copies)
        return recent(branch_amplitudes)

    @cached_property
    def independent_blocks(self) -> tuple[Mapping[str, NDArray[np.bool_]], ...]:
        """Height and phase of each position move its own points alone."""
        masks = [
            self._whole((1 + 1j) * (self.sweeps.position == p)) > 0
            for p in range(self.sweeps.n_positions)
        ]
        return tuple(
            {f"{name}{place}": mask for place, mask in zip(self.place, masks, strict=True)}
            for name in ("height", "phase")
        )

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Every sweep, or part of a single one, and the simulated α where sweeps soften."""
        return blocks_of(self.sweeps, self.softens)

    @property
    def layout(self) -> Layout:
        """Neighbours along each sweep; points of one column were taken at the same frequencies."""
        return along_sweeps(self.sweeps, self.softens)

    def locate(self, residual: int) -> str:
        """Name the sweep and the frequency."""
        n = len(self.sweeps.frequency)
        if residual >= 2 * n:
            return "the simulated α"
        point = residual % n
        sweep = int(self.sweeps.sweep[point])
        name = sweep_name(self.sweeps, sweep)
        return f"sweep {sweep + 1} ({name}), {self.sweeps.frequency[point]:.9g} Hz"

    @property
    def quantity(self) -> tuple[Array, str]:
        """V of each quadrature."""
        noise = np.full(2 * len(self.sweeps.frequency), self.sweeps.noise)
        return np.concatenate([noise, [np.nan] if self.softens else []]), "V"

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Both quadratures of the signal; the simulated α is no datum."""
        return voltages(self.sweeps)

    def _whole(self, points: ComplexArray, alpha: float = 0.0) -> Array:
        """Return real and imaginary parts of (n_points,) values, and the deviation of α.

        Where sweeps soften, that is how far the film's own α is from the simulated one.
        """
        return np.concatenate([points.real, points.imag, [alpha] if self.softens else []])

    def predict(
        self,
        effects: Sequence[Effect],
        base: Values,
        values: Sequence[Values],
        instead: Sweeps | None = None,
    ) -> ComplexArray:
        """Return the voltage (n,) [V] of the state that each point of a sweep is on.

        With other drives it is the state that the point would be on.
        """
        data = instead or self.sweeps
        mode, _ = self._mode(effects, base, values, data)
        linear = np.maximum(mode.peak * mode.force, np.finfo(float).tiny)
        heights = heights_at(data.position, self.place, base)
        volts = data.drive * data.reference
        balanced = balance(mode, np.asarray(data.frequency), linear)
        states = self._solved(*balanced)
        above = mode.frequency / data.frequency

        def read_out(b: ComplexArray) -> ComplexArray:
            signal = Signal(
                heights * mode.force * above * b,
                linear * above * np.abs(b),
                volts,
                self.wavelength,
                self.largest,
                data.frequency - base["frequency"],
                self.shape,
            )
            return apply("signal", signal, effects, values).voltage

        both = np.stack([read_out(b) for b in states])
        chosen = self._followed(both, mode)
        swept = apply("acquisition", Acquisition(), effects, values)
        if not (np.any(swept.motion) or np.any(swept.filtered)):
            return np.asarray(np.take_along_axis(both, chosen[None], axis=0)[0])
        return self._late.voltage(
            swept, States(balanced.delta, balanced.bend, states, both), chosen, read_out
        )

    @cached_property
    def _late(self) -> LateSweeps:
        """The sweeps where points keep something of those before."""
        return LateSweeps(self.sweeps, self.step)

    def _mode(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values], data: Sweeps
    ) -> tuple[Oscillator, float]:
        """Return the mode with its effects, and the α [m⁻²] that the geometry must supply.

        Only α A² shows in sweeps, so that α as observed sets the metres; where it is negative,
        effects must have lowered the film's own, or another mode pulls at the frequency.
        """
        drive = data.drive * data.reference
        frequency = np.full(len(drive), base["frequency"])
        alpha = self.simulated_alpha
        silent = np.zeros(len(data.frequency), complex)
        driven = np.asarray(data.frequency)
        plain = Oscillator(
            frequency,
            base["linewidth"],
            alpha,
            0.0,
            0.0,
            drive,
            base["peak"],
            self.time,
            driven,
            self.middle,
            silent,
        )
        mode = apply("oscillator", plain, effects, values)
        if not self.softens or np.any(mode.pull):
            return mode, alpha
        observed = apply("oscillator", replace(plain, alpha=-alpha), effects, values)
        return replace(observed, alpha=-alpha), -2 * alpha - observed.alpha

    def _followed(self, both: ComplexArray, mode: Oscillator) -> NDArray[np.int64]:
        """Return the branch (n,) of each point.

        Sweeps of known direction jump once, where the data say, others as they fit best. Where
        another mode pulls, it may end either branch.
        """
        chosen = np.empty(both.shape[1], np.int64)
        spans = self._spans
        starts = np.tile([0, 1], (len(spans), 1))
        if not np.any(mode.pull):
            stiffens = np.broadcast_to(mode.alpha, len(chosen)) >= 0
            first = np.minimum(spans[:, 0], len(chosen) - 1)
            starts = stiffens[first, None].astype(np.int64)
        compiled(follow)(chosen, self.sweeps.voltage, both, spans, starts)
        return chosen

    @cached_property
    def _spans(self) -> NDArray[np.int64]:
        """Where each sweep starts and stops, and whether its direction is known, (n_sweeps, 3)."""
        spans = zip(self.sweeps.spans, self.sweeps.direction, strict=True)
        return np.array([(s.start, s.stop, way != 0) for s, way in spans], np.int64)

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (V − V_predicted)/σ of all real, then of all imaginary parts."""
        return self._whole(
            (self.sweeps.voltage - self.predict(effects, base, values)) / self.sweeps.noise,
            self._deviation(effects, base, values) if self.softens else 0.0,
        )

    def _deviation(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> float:
        """Return how far the film's own α is from the simulated one, in σ."""
        _, own = self._mode(effects, base, values, self.sweeps)
        return (own / self.simulated_alpha - 1) / ALPHA_SD

    @property
    def residuals_of_many(self) -> ManyResiduals:
        """They are computed as one long record, whose parameters differ from point to point."""
        return self._of_many

    def _of_many(
        self, effects: Sequence[Effect], base: ManyValues, values: Sequence[ManyValues]
    ) -> Array:
        """Return the residuals (m, n_residuals) of m sets of parameters, portion by portion."""
        n = len(self.sweeps.frequency)
        found = []
        for portion in portions(len(base["frequency"]), n):
            own = [each_point(numbers, portion, n) for numbers in values]
            many = self._repeated(portion.stop - portion.start)
            found.append(many._of_each(n, effects, each_point(base, portion, n), own))
        return np.concatenate(found)

    def _of_each(
        self, n: int, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> Array:
        """Return the residuals (m, n_residuals) of the same n points m times."""
        left = (self.sweeps.voltage - self.predict(effects, base, values)) / self.sweeps.noise
        points = left.reshape(-1, n)
        parts = [points.real, points.imag]
        if self.softens:
            deviation = np.broadcast_to(self._deviation(effects, base, values), left.shape)
            parts.append(deviation.reshape(points.shape)[:, :1])
        return np.concatenate(parts, axis=1)

    @cached_property
    def _repeated(self) -> Callable[[int], "ResponseModel"]:
        """The model of the same sweeps several times, one after the other."""

        def times(count: int) -> ResponseModel:
            return replace(
                self,
                sweeps=repeated(self.sweeps, count),
                time=np.tile(self.time, count),
                step=np.tile(self.step, count),
                shape=np.tile(self.shape, count),
                copies=count,
            )

        return cache(times)

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return gains, phases, backgrounds, f₀ and w of each sweep, and those of strong motion."""
        volts = self.predict(effects, base, values)
        share = np.asarray(np.abs(volts) / self.largest, float)
        ways = directions_of_signal(self.sweeps, volts / self.sweeps.noise, share)
        found = {name: self._whole(way) for name, way in ways.items()}
        plain = self.residuals(effects, base, values)
        step = LITTLE * base["linewidth"]
        for name in ("frequency", "linewidth"):
            moved = self.residuals(effects, {**base, name: base[name] + step}, values) - plain
            found[f"{name} of strong motion"] = moved * self._whole((1 + 1j) * share**BEYOND)
            for k in np.unique(self.sweeps.sweep):
                mine = np.where(self.sweeps.sweep == k, 1 + 1j, 0)
                found[f"{name} of sweep {k + 1}"] = self._whole(mine) * moved
        return found

    @property
    def order_of_blocks(self) -> NDArray[np.int64]:
        """Sweeps in the order of their time, where something hides the mode in several."""
        if not self.hidden or len(self.sweeps.spans) == 1:
            return np.empty(0, np.int64)
        begins = [self.time[span].min() for span in self.sweeps.spans]
        return np.argsort(begins, kind="stable")

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """Return the mode that something else hides, which alone it would describe instead."""
        names = [spec.name for spec in self.base]
        return [dict(zip(names, self.start.tolist(), strict=True))] if self.hidden else []

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return same sweeps at twice the drives, and off resonance, where only backgrounds are."""
        data = self.sweeps
        away = np.where(data.frequency < self.middle, -FARTHER, FARTHER) * data.span
        farther = data.frequency + away
        plans = {"the same sweeps at twice the drives": replace(data, reference=2 * data.reference)}
        if np.all(farther > 0):
            plans["the same sweeps twice their width further off resonance, on both sides"] = (
                replace(data, frequency=farther)
            )
        return {
            phrase: self._whole(self.predict(effects, base, values, plan) / data.noise)
            for phrase, plan in plans.items()
        }

    def systematic(self, unit: str) -> float:
        """Return how uncertain metres are through the simulated α, which scales as m⁻²."""
        powers = {"m/V": 1, "V/m": -1, "m^-1": -1, "m^-2": -2, "m^-4": -4}
        return abs(powers.get(unit, 0)) / 2 * ALPHA_SD

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Return the magnitude and phase of every sweep."""
        names = tuple(name for name, *_ in models)
        volts = [self.predict(effects, base, values) for _, effects, base, values in models]
        return curves(self.sweeps, names, np.stack(volts))

    def marked(
        self, comparisons: tuple[Comparison, ...], residuals: Sequence[int]
    ) -> tuple[Comparison, ...]:
        """Mark points that no fit has seen, in magnitude and phase."""
        return marked(comparisons, self.sweeps, residuals)

    def describe(self, residuals: Array) -> str:
        """Say at which drive and on which side of the resonance the sweeps deviate."""
        return described(self.sweeps, residuals, self.start[0])
