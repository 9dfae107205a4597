"""Driven sweeps against one Duffing mode with linear readout, all drives sharing f₀, Q and α."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison
from femnl.core.compiled import compiled
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.memo import recent
from femnl.core.numbers import engineering, signed
from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Acquisition, Oscillator, Signal
from femnl.observe.model import MeasurementModel, Named, apply
from femnl.observe.residuals import Layout, Quantity
from femnl.observe.response.curves import curves, sweep_name, voltages
from femnl.observe.response.extent import extent
from femnl.observe.response.late import LateSweeps, States
from femnl.observe.response.layout import along_sweeps, marked
from femnl.observe.response.states import branch_amplitudes, follow
from femnl.observe.response.sweeps import Sweeps

ALPHA_SD = 0.2
"""Relative standard deviation of a simulated α: Young's modulus of a thin film is rarely known
better.
"""
LITTLE = 1e-4
"""Part of the linewidth by which f₀ and w are moved where single sweeps may deviate."""
STRONG = (2, 8, 32)
"""Powers of a signal with which gain and phase may deviate: smoothly, or of the strongest alone."""
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
    mode moves strongly. largest [V]: signal.
    """

    kind = "response"
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

    def unscaled_by(self, glitches: Sequence[int]) -> "ResponseModel":
        """Return the model whose scales are those of the other data: a glitch is no signal."""
        n = len(self.sweeps.frequency)
        used = np.ones(n, dtype=bool)
        used[[residual % n for residual in glitches if residual < 2 * n]] = False
        names = [spec.name for spec in self.base]
        gain = self.start[[names.index(f"responsivity{place}") for place in self.place]]
        left = extent(self.sweeps, gain, used)
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
        return recent(branch_amplitudes)

    @cached_property
    def independent_blocks(self) -> tuple[Mapping[str, NDArray[np.bool_]], ...]:
        """Gain and phase of each position move its own points alone."""
        masks = [
            self._whole((1 + 1j) * (self.sweeps.position == p)) > 0
            for p in range(self.sweeps.n_positions)
        ]
        return tuple(
            {f"{name}{place}": mask for place, mask in zip(self.place, masks, strict=True)}
            for name in ("responsivity", "phase")
        )

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Every sweep is a block of its own, and so is the simulated α where sweeps soften."""
        known = [len(self.sweeps.spans)] if self.softens else []
        return np.concatenate([self.sweeps.sweep, self.sweeps.sweep, known]).astype(np.int64)

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
        gains = np.array(
            [base[f"responsivity{name}"] * np.exp(1j * base[f"phase{name}"]) for name in self.place]
        )[data.position]
        volts = data.drive * data.reference
        delta, bend, states = self._states(mode, data, linear)

        def read_out(b: ComplexArray) -> ComplexArray:
            signal = Signal(
                gains * linear * b,
                linear * np.abs(b),
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
        if swept == Acquisition():
            return np.asarray(np.take_along_axis(both, chosen[None], axis=0)[0])
        return self._late.voltage(swept, States(delta, bend, states, both), chosen, read_out)

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

    def _states(
        self, mode: Oscillator, data: Sweeps, linear: Array
    ) -> tuple[Array, ComplexArray, ComplexArray]:
        """Return δ (n,), a (n,) without its quintic part, and b = A/(A₁F) (2, n).

        The rows of b are the low and the high branch, continued past its fold.
        """
        f0 = mode.frequency
        per = 2 / mode.linewidth
        delta = per * (f0 - data.frequency)
        cubic = (
            per * 0.375 * f0 * mode.alpha * linear**2
            + 1j * np.maximum(mode.damping, 0) * linear**2 / 4
        )
        fifth = per * 0.3125 * f0 * mode.quintic * linear**4
        scale = linear**2 * (3 * f0 * abs(mode.alpha)) / (8 * mode.linewidth)
        pulled = per * mode.pull * scale
        both = self._solved(delta, cubic, fifth, pulled, scale, mode.order)
        return delta, cubic + (pulled if mode.order == 2 else 0), both

    def _followed(self, both: ComplexArray, mode: Oscillator) -> NDArray[np.int64]:
        """Return the branch (n,) of each point.

        Sweeps of known direction jump once, where the data say, others as they fit best. Where
        another mode pulls, it may end either branch.
        """
        chosen = np.empty(both.shape[1], np.int64)
        spans = np.array(
            [
                (s.start, s.stop, d != 0)
                for s, d in zip(self.sweeps.spans, self.sweeps.direction, strict=True)
            ],
            np.int64,
        )
        starts = [0, 1] if np.any(mode.pull) else [int(mode.alpha >= 0)]
        compiled(follow)(chosen, self.sweeps.voltage, both, spans, np.array(starts))
        return chosen

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (V − V_predicted)/σ of all real, then of all imaginary parts."""
        deviation = 0.0
        if self.softens:
            _, own = self._mode(effects, base, values, self.sweeps)
            deviation = (own / self.simulated_alpha - 1) / ALPHA_SD
        return self._whole(
            (self.sweeps.voltage - self.predict(effects, base, values)) / self.sweeps.noise,
            deviation,
        )

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return gains, phases, backgrounds, f₀ and w of each sweep, and those of strong motion."""
        volts = self.predict(effects, base, values) / self.sweeps.noise
        share = np.asarray(np.abs(volts) * self.sweeps.noise / self.largest, float)
        found: dict[str, Array] = {}
        for power in STRONG:
            strong = volts * share**power
            found |= {
                f"gain as power {power} of the signal": self._whole(strong),
                f"phase as power {power} of the signal": self._whole(1j * strong),
            }
        for drive in np.unique(self.sweeps.drive):
            only = np.where(self.sweeps.drive == drive, volts, 0)
            flat = np.where(self.sweeps.drive == drive, 1 / self.sweeps.noise, 0j)
            ways = {
                "gain": only,
                "phase": 1j * only,
                "real background": flat,
                "imaginary background": 1j * flat,
            }
            for name, part in ways.items():
                found[f"{name} at a drive of {drive * self.sweeps.reference:.3g} V"] = self._whole(
                    part
                )
        plain = self.residuals(effects, base, values)
        step = LITTLE * base["linewidth"]
        for name in ("frequency", "linewidth"):
            moved = self.residuals(effects, {**base, name: base[name] + step}, values) - plain
            found[f"{name} of strong motion"] = moved * self._whole((1 + 1j) * share**BEYOND)
            for k in np.unique(self.sweeps.sweep):
                mine = np.where(self.sweeps.sweep == k, 1 + 1j, 0)
                found[f"{name} of sweep {k + 1}"] = self._whole(mine) * moved
        return found

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return same sweeps at twice the drives, and off resonance, where only backgrounds are."""
        data = self.sweeps
        away = np.where(data.frequency < self.middle, -FARTHER, FARTHER) * data.span
        plans = {
            "the same sweeps at twice the drives": replace(data, reference=2 * data.reference),
            "the same sweeps twice their width further off resonance, on both sides": replace(
                data, frequency=data.frequency + away
            ),
        }
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
        n = len(self.sweeps.frequency)
        power = (residuals[:n] ** 2 + residuals[n : 2 * n] ** 2) / 2
        rms = {
            d: float(np.sqrt(power[self.sweeps.drive == d].mean()))
            for d in np.unique(self.sweeps.drive)
        }
        worst = max(rms, key=lambda d: rms[d])
        k = int(np.argmax(power))
        table = ", ".join(
            f"{engineering(d * self.sweeps.reference, 'V')}: {value:.2f}σ"
            for d, value in rms.items()
        )
        offset = self.sweeps.frequency[k] - self.start[0]
        drive = f"the drive of {engineering(worst * self.sweeps.reference, 'V')} deviates most"
        return f"{drive}, most strongly {signed(offset, 'Hz')} from resonance; rms by drive {table}"
