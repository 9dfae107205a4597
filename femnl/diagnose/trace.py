"""Time traces at one spot: a sinusoidal motion under a sinusoidal fringe, step by step."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, Kind, ParameterSpec, Values
from femnl.core.errors import MeasurementError
from femnl.core.readout import Array, ComplexArray
from femnl.core.stages import Fringe, Harmonics, Motion
from femnl.diagnose.score_directions import fringe_terms, overtones
from femnl.fits.trace.decompose import decompose
from femnl.fits.trace.spot import fit_spot
from femnl.observe.film import SimulatedFilm
from femnl.observe.model import Named, Ranked, apply
from femnl.optics.sampled import harmonics

MOST_HARMONICS = 21
MOST_STEPS = 12
"""Harmonics, as far as the sampling rate and the length of the record allow, and steps of the drive
that are looked at.
"""
HIGHEST = 128
SMOOTH = 48
"""Harmonics that are predicted of a clipped and of a smooth signal: those beyond the measured ones
are folded onto them by the sampling, or beat in what they leave."""
PER_HARMONIC = 4
"""Samples of a record that each harmonic needs."""
THIRDS = 3
"""Parts of the steps of which even or odd harmonics are held out one by one."""
SHOWN = 6
"""Harmonics that are drawn."""


class TraceModel:
    """Residuals of the harmonics of traces; see `MeasurementModel`.

    V_C and θ are common to all steps; amplitude and phase of the motion belong to a step, since
    nothing but the resonance, with its jumps, ties them to each other.
    """

    kind: Kind = "trace"
    needs_global_search = False
    jumps: tuple[str, ...] = ()
    ranked: tuple[Ranked, ...] = ()

    def __init__(self, dataset: xr.Dataset, film: SimulatedFilm) -> None:
        self.film = film
        self.wavelength = float(dataset.attrs["wavelength"])
        steps = _chosen(dataset)
        traces = dataset.isel(step=steps)
        spectrum = decompose(traces, _harmonics_of(traces))
        sine = fit_spot(spectrum, self.wavelength)
        kept = spectrum.harmonic > 0
        self.harmonic = np.asarray(spectrum.harmonic[kept], np.int64)
        self.frequency = spectrum.drive_frequency
        self._values = spectrum.values[kept]
        stated = dataset.attrs.get("noise_sd")
        left = float(np.sqrt(np.mean(spectrum.noise_sd**2)))
        noise = left if stated is None else float(stated)
        self._sd = spectrum.values_sd[kept] * (noise / spectrum.noise_sd)
        # What the harmonics leave of a record is noise of the size that the file states, or
        # something else beats there.
        degrees = np.isfinite(traces["voltage"].values).sum(axis=1) - 2 * len(self.harmonic) - 1
        self._degrees = degrees
        self._noise = noise
        self._left = np.empty(0) if stated is None else spectrum.noise_sd
        self._orders = [
            np.arange(1, max(most, len(self.harmonic)) + 1) for most in (HIGHEST, SMOOTH)
        ]
        times = _times(traces)
        folded = [
            [
                _folding(t, f, len(self.harmonic), len(orders))
                for t, f in zip(times, self.frequency, strict=True)
            ]
            for orders in self._orders
        ]
        self._fold, self._beat = (
            [np.stack([step[part] for step in steps]) for steps in folded] for part in (0, 1)
        )
        self.n_steps = len(self.frequency)
        self.mode = int(np.argmin(np.abs(film.modes.frequency - np.median(self.frequency))))
        contrast = sine.fit["contrast"]
        theta = sine.fit["fringe_phase"]
        deepest = 40 * self.wavelength / (4 * np.pi)
        self.base: tuple[ParameterSpec, ...] = (
            ParameterSpec("contrast", "V", -10 * abs(contrast), 10 * abs(contrast)),
            ParameterSpec("theta", "rad", theta - np.pi, theta + np.pi),
            *(ParameterSpec(f"amplitude[{i}]", "m", 0.0, deepest) for i in range(self.n_steps)),
            *(
                ParameterSpec(f"motion_phase[{i}]", "rad", p - 2 * np.pi, p + 2 * np.pi)
                for i, p in enumerate(sine.phase)
            ),
        )
        self.start = np.concatenate([[contrast, theta], sine.amplitude, sine.phase])
        steps_of = np.concatenate(
            [np.tile(np.arange(self.n_steps), 2 * len(self.harmonic)), np.arange(len(self._left))]
        )
        masks = [steps_of == i for i in range(self.n_steps)]
        self.independent_blocks: tuple[Mapping[str, NDArray[np.bool_]], ...] = tuple(
            {f"{name}[{i}]": mask for i, mask in enumerate(masks)}
            for name in ("amplitude", "motion_phase")
        )
        stack = film.model.stack
        self.scales: Mapping[str, float] = {
            "wavelength": self.wavelength,
            "period": float(1 / np.median(self.frequency)),
            "slope": abs(contrast),
            **({} if stack is None else {"stack": stack.layers[stack.gap].thickness}),
        }
        thinned = (
            f"; {self.n_steps} of {dataset.sizes['step']} steps looked at"
            if self.n_steps < dataset.sizes["step"]
            else ""
        )
        origin = (
            "as stored"
            if stated is not None
            else "estimated from what the harmonics leave: noise_sd is not in the file"
        )
        self.notes: tuple[str, ...] = (
            f"trace: noise {noise:.3g} V per sample, {origin}",
            f"trace: {len(self.harmonic)} harmonics at each step{thinned}; metres are those at "
            "the spot",
        )

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Odd or even harmonics of a third of the steps.

        The others tell the motion there, the other steps the fringe.
        """
        third = np.arange(self.n_steps) * THIRDS // self.n_steps
        whole = (2 * third[None, :] + self.harmonic[:, None] % 2).ravel()
        return np.concatenate([whole, whole, np.full(len(self._left), -1)])

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
        smooth = int(np.isinf(lit.limit))
        orders = self._orders[smooth]
        plain = Harmonics(base["contrast"] * harmonics(moved, lit, orders), orders, self.frequency)
        voltage = apply("harmonics", plain, effects, values).values
        measured, higher = np.split(voltage, [len(self.harmonic)])
        parts = np.concatenate([higher.real, higher.imag]).T[:, :, None]
        folded = (self._fold[smooth] @ parts)[:, :, 0].T
        power = np.sum(parts * (self._beat[smooth] @ parts), axis=(1, 2)) / self._degrees
        return measured + folded, np.sqrt(self._noise**2 + np.maximum(power, 0))

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return (V − V_predicted)/σ of real and imaginary parts, and the rest of each record."""
        predicted, noise = self.predict(effects, base, values)
        rest = (
            (self._left / noise - 1) * np.sqrt(2 * self._degrees) if len(self._left) else self._left
        )
        return self._real(self._values - predicted, rest)

    def _real(self, volts: ComplexArray, rest: Array | None = None) -> Array:
        ratio = (volts / self._sd).ravel()
        return np.concatenate(
            [ratio.real, ratio.imag, np.zeros(len(self._left)) if rest is None else rest]
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
        if len(self._left):
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
        """The same traces at other amplitudes of the motion."""
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

    def equivalent_solutions(self, base: dict[str, float]) -> list[dict[str, float]]:
        """None: these data leave one solution."""
        return []

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Magnitudes of the lowest harmonics against the frequency of the drive."""
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
                np.abs(self._values[k, order]),
                self._sd[k, order],
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

    def systematic(self, unit: str) -> float:
        """Nothing beside the statistics."""
        return 0.0

    def describe(self, residuals: Array) -> str:
        """Say which harmonic deviates most, and at which drive."""
        size = self._values.size
        power = ((residuals[:size] ** 2 + residuals[size : 2 * size] ** 2) / 2).reshape(
            self._values.shape
        )
        rms = np.sqrt(power.mean(axis=1))
        k = int(np.argmax(rms))
        step = int(np.argmax(power[k]))
        table = ", ".join(
            f"{n}: {value:.2f}σ" for n, value in zip(self.harmonic[:SHOWN], rms, strict=False)
        )
        return (
            f"harmonic {self.harmonic[k]} deviates most, and most strongly at "
            f"{self.frequency[step]:.9g} Hz; rms by harmonic {table}"
        )


def _times(traces: xr.Dataset) -> list[Array]:
    """Return the times [s] of the samples of each step that are there."""
    time = traces["time"].values.astype(float)
    return [time[np.isfinite(row)] for row in traces["voltage"].values]


def _folding(
    time: Array, frequency: float, n_harmonics: int, highest: int
) -> tuple[ComplexArray, Array]:
    """Return what the harmonics beyond the measured ones add.

    As real, then imaginary parts, and to the sum of squares that is left.
    """
    turns = 2 * np.pi * frequency * np.outer(time, np.arange(1, highest + 1))
    cosine = np.cos(turns)
    sine = -np.sin(turns)
    low = np.column_stack([np.ones(len(time)), cosine[:, :n_harmonics], sine[:, :n_harmonics]])
    high = np.column_stack([cosine[:, n_harmonics:], sine[:, n_harmonics:]])
    solved, *_ = np.linalg.lstsq(low, high, rcond=None)
    left = high - low @ solved
    return solved[1 : n_harmonics + 1] + 1j * solved[n_harmonics + 1 :], np.asarray(left.T @ left)


def _chosen(dataset: xr.Dataset) -> NDArray[np.int64]:
    """Return the steps that are compared, evenly spaced; those only partly without gaps go."""
    usable = np.flatnonzero(np.isfinite(dataset["voltage"].values).sum(axis=1) > 2 * PER_HARMONIC)
    if not len(usable):
        raise MeasurementError(
            f"trace: no step has more than {2 * PER_HARMONIC} samples; record longer"
        )
    return usable[np.unique(np.linspace(0, len(usable) - 1, MOST_STEPS).round().astype(np.int64))]


def _harmonics_of(traces: xr.Dataset) -> int:
    """Return how many harmonics the sampling rate and the length of the records allow."""
    interval = float(np.median(np.diff(traces["time"].values)))
    fewest = int(np.isfinite(traces["voltage"].values).sum(axis=1).min())
    most = min(MOST_HARMONICS, fewest // PER_HARMONIC)
    if "drive_frequency" in traces:
        most = min(
            most, int(np.ceil(0.5 / (float(traces["drive_frequency"].max()) * interval))) - 1
        )
    if most < 2:
        raise MeasurementError(
            "trace: fewer than two harmonics can be told from these samples; sample faster or "
            "record longer"
        )
    return most
