"""Time traces at one spot: a sinusoidal motion under a sinusoidal fringe, step by step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.numbers import plain, scale_for
from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Fringe, Harmonics, Motion
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import MeasurementModel, Named, apply
from femnl.observe.residuals import Quantity, quadratures
from femnl.observe.score_directions import fringe_terms, overtones
from femnl.optics.sampled import harmonics

THIRDS = 3
"""Parts of the steps of which even or odd harmonics are held out one by one."""
SHOWN = 6
"""Harmonics that are drawn."""


@dataclass(frozen=True)
class Folded:
    """What the harmonics beyond the measured ones do to these.

    orders (n_orders,): all that are predicted, the measured ones first. fold (n_steps,
    n_harmonics, 2 n_beyond) complex: what real, then imaginary parts of those beyond add to the
    measured ones, since the sampling folds them there or they beat in what is left. beat (n_steps,
    2 n_beyond, 2 n_beyond): the sum of squares that they add to what is left.
    """

    orders: NDArray[np.int64]
    fold: ComplexArray
    beat: Array


@dataclass(frozen=True, eq=False)
class TraceModel(MeasurementModel):
    """Residuals of the harmonics of traces.

    V_C and θ are common to all steps; amplitude and phase of the motion belong to a step, since
    nothing but the resonance, with its jumps, ties them to each other.

    harmonic (n_harmonics,); frequency (n_steps,) of the drive [Hz]; measured and sd (n_harmonics,
    n_steps) [V]; noise [V] per sample; left (n_steps,) [V]: what the harmonics leave of each
    record, of which noise of the size that the file states is part, empty where it states none;
    degrees (n_steps,): degrees of freedom of `left`, of which the part `independent` counts for its
    variance. folded: see `Folded`, of a clipped and of a
    smooth signal. mode: the one whose frequency is nearest.
    """

    kind = "trace"
    tells_noise = True

    film: SimulatedFilm
    wavelength: float
    harmonic: NDArray[np.int64]
    frequency: Array
    measured: ComplexArray
    sd: Array
    noise: float
    left: Array
    degrees: NDArray[np.int64]
    folded: tuple[Folded, Folded]
    mode: int
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...]
    noise_factor: float = 1.0
    correlation_length: float = 1.0
    independent: float = 1.0
    left_out: tuple[tuple[str, float], ...] = ()

    @property
    def n_steps(self) -> int:
        """How many steps of the drive are compared."""
        return len(self.frequency)

    @cached_property
    def independent_blocks(self) -> tuple[Mapping[str, NDArray[np.bool_]], ...]:
        """Amplitude and phase of each step move the residuals of that step alone."""
        steps = np.arange(self.n_steps)
        step_of = np.concatenate([np.tile(steps, 2 * len(self.harmonic)), steps[: len(self.left)]])
        masks = [step_of == i for i in range(self.n_steps)]
        return tuple(
            {f"{name}[{i}]": mask for i, mask in enumerate(masks)}
            for name in ("amplitude", "motion_phase")
        )

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Odd or even harmonics of a third of the steps.

        The others tell the motion there, the other steps the fringe.
        """
        third = np.arange(self.n_steps) * THIRDS // self.n_steps
        whole = (2 * third[None, :] + self.harmonic[:, None] % 2).ravel()
        return np.concatenate([whole, whole, np.full(len(self.left), -1)])

    @property
    def quantity(self) -> tuple[Array, str]:
        """V of each quadrature of the harmonics."""
        sd = np.tile(self.sd.ravel(), 2)
        return np.concatenate([sd, np.full(len(self.left), np.nan)]), "V"

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Both quadratures of the harmonics; what they leave of a record is noise."""
        orders = np.repeat(self.harmonic, self.n_steps)
        steps = np.tile(np.arange(self.n_steps), len(self.harmonic))
        axes = {
            "harmonic": (orders, ""),
            "step": (steps + 1, ""),
            "frequency": (self.frequency[steps], "Hz"),
        }
        return quadratures("harmonics", "V", self.sd.ravel(), axes)

    def locate(self, residual: int) -> str:
        """Name the harmonic and the step."""
        if residual >= 2 * self.measured.size:
            return f"what the harmonics leave of step {residual - 2 * self.measured.size + 1}"
        row, step = divmod(residual % self.measured.size, self.n_steps)
        return f"harmonic {self.harmonic[row]} of step {step + 1}"

    def predict(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> tuple[ComplexArray, Array]:
        """Return V_n [V] as measured, (n_harmonics, n_steps), and the noise they leave.

        The noise [V] is per sample, (n_steps,).
        """
        n = self.n_steps
        swing = np.array(
            [base[f"amplitude[{i}]"] * np.exp(1j * base[f"motion_phase[{i}]"]) for i in range(n)]
        )
        shapes = np.ones((len(self.film.modes.frequency), n))
        zero = np.zeros(n)
        theta = np.full(n, base["theta"])
        motion = Motion(
            swing[None],
            theta,
            zero,
            zero,
            shapes,
            self.film.modes.frequency,
            self.mode,
            swing,
            self.wavelength,
        )
        fringe = Fringe(np.array([0, 1], complex), self.wavelength, self.film.model.stack)
        moved = apply("motion", motion, effects, values)
        lit = apply("fringe", fringe, effects, values)
        beyond = self.folded[int(np.isinf(lit.limit))]
        orders = beyond.orders
        plain = Harmonics(base["contrast"] * harmonics(moved, lit, orders), orders, self.frequency)
        voltage = apply("harmonics", plain, effects, values).values
        measured, higher = np.split(voltage, [len(self.harmonic)])
        parts = np.concatenate([higher.real, higher.imag]).T[:, :, None]
        folded = (beyond.fold @ parts)[:, :, 0].T
        power = np.sum(parts * (beyond.beat @ parts), axis=(1, 2)) / self.degrees
        return measured + folded, np.sqrt(self.noise**2 + np.maximum(power, 0))

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (V − V_predicted)/σ of real and imaginary parts, and the rest of each record."""
        predicted, noise = self.predict(effects, base, values)
        if not len(self.left):
            return self._real(self.measured - predicted)
        spread = 1 / np.sqrt(2 * self.independent * self.degrees)
        return self._real(self.measured - predicted, (self.left / noise - 1) / spread)

    def _real(self, volts: ComplexArray, rest: Array | None = None) -> Array:
        ratio = (volts / self.sd).ravel()
        return np.concatenate(
            [ratio.real, ratio.imag, np.zeros(len(self.left)) if rest is None else rest]
        )

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Gain and phase of harmonics, what the drive adds, noise, fringe terms, and overtones."""
        volts, _ = self.predict(effects, base, values)
        found: dict[str, Array] = {}
        for k, n in enumerate(self.harmonic):
            only = np.zeros_like(volts)
            only[k] = volts[k]
            found |= {
                f"gain of harmonic {n}": self._real(only),
                f"phase of harmonic {n}": self._real(1j * only),
            }
        added = np.zeros_like(volts)
        added[self.harmonic == 1] = 1.0
        found |= {
            "constant at the drive": self._real(added),
            "constant in quadrature of the drive": self._real(1j * added),
        }
        if len(self.left):
            found["noise beside the harmonics"] = self._real(
                np.zeros_like(volts), np.ones(self.n_steps)
            )
        return (
            found
            | fringe_terms(self, effects, base, values)
            | overtones(self, effects, base, values)
        )

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Return the same traces at other amplitudes of the motion."""
        found = {}
        for factor in (0.5, 2.0):
            moved = {
                name: value * factor if name.startswith("amplitude") else value
                for name, value in base.items()
            }
            found[f"the same traces at {factor:g} times the amplitude"] = self._real(
                self.predict(effects, moved, values)[0]
            )
        return found

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Return magnitudes of the lowest harmonics against the frequency of the drive."""
        predicted = np.abs(
            [self.predict(effects, base, values)[0] for _, effects, base, values in models]
        )
        order = np.argsort(self.frequency, kind="stable")
        apart = np.ptp(self.frequency) > 0
        x = self.frequency[order] if apart else np.arange(self.n_steps, dtype=float)
        curves = tuple(
            Curve(
                f"{n}f",
                x,
                np.abs(self.measured[k, order]),
                self.sd[k, order],
                predicted[:, k, order],
            )
            for k, n in enumerate(self.harmonic[:SHOWN])
        )
        names = tuple(name for name, *_ in models)
        return (
            Curves(
                "trace",
                "drive frequency" if apart else "step",
                "Hz" if apart else "",
                "magnitude",
                "V",
                names,
                curves,
            ),
        )

    def describe(self, residuals: Array) -> str:
        """Say which harmonic deviates most, and at which drive."""
        size = self.measured.size
        power = ((residuals[:size] ** 2 + residuals[size : 2 * size] ** 2) / 2).reshape(
            self.measured.shape
        )
        rms = np.sqrt(power.mean(axis=1))
        k = int(np.argmax(rms))
        at = float(self.frequency[int(np.argmax(power[k]))])
        scale = scale_for(at, "Hz")
        table = ", ".join(
            f"{n}: {value:.2f}σ" for n, value in zip(self.harmonic[:SHOWN], rms, strict=False)
        )
        return (
            f"harmonic {self.harmonic[k]} deviates most, and most strongly at "
            f"{plain(at / scale.size, 9)} {scale.unit}; rms by harmonic {table}"
        )
