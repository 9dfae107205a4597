"""A decay behind an analyser against one mode that rings down into a floor."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curve, Curves
from femnl.core.effect import Effect, ParameterSpec, Values
from femnl.core.readout import Array
from femnl.core.stages import Dissipation, Reading, Ringing
from femnl.observe.decay.blocks import Blocks, Scale, Whitening
from femnl.observe.decay.record import DB
from femnl.observe.model import MeasurementModel, Named, apply
from femnl.observe.residuals import Quantity

STRETCHES = 18
"""Stretches of time that a record is cut into."""
HELD_OUT = 6
"""Parts of the record that are held out one by one, of three stretches each."""
LEVELS = 1200
"""Steps of the energy over which a decay is integrated."""
GONE = 1e-300
"""Power of a signal that is gone, in parts of that at the begin."""
BELOW = 4.0
"""ln of the energy over which the integration goes on below the weakest datum."""
WAVES = range(1, 9)
"""Half periods over the record of the smooth deviations that are tested."""
WEAKER = 0.25
"""Energy at the begin of a weaker decay that may be measured, in parts of the present one."""
WIDER = 10.0
"""Bandwidth of an analyser that a drift does not leave, in parts of the present one."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a model predicts of the blocks: ln of their mean power (n_blocks,), and phase [rad]."""

    log_power: Array
    phase: Array


@dataclass(frozen=True)
class Setting:
    """How a decay is measured.

    begin: ln of the energy at its begin over that of the measurement; bandwidth of the analyser, in
    parts of that of the measurement; drive: whether the generator is connected.
    """

    begin: float = 0.0
    bandwidth: float = 1.0
    drive: bool = True


AS_MEASURED = Setting()


@dataclass(frozen=True, eq=False)
class DecayModel(MeasurementModel):
    """Residuals of the power, and of the phase where it was recorded, freed from correlation.

    The mode has the power e^{−γτ} and turns at a constant frequency; the noise adds its power. The
    mean power of blocks of points is compared, on a scale on which its noise is normal.

    time (n,) [s] at which laws are evaluated, from the begin of the decay: some of the points of
    long blocks. blocks_of_power, blocks_of_phase: their blocks, the latter of the first points
    only, and empty where there is no phase. log_power (n_blocks,): ln of the mean power; scale: of
    its noise; phase (n_strong,) [rad]. of_power, of_phase: their noise. origin [s]: the begin in
    the record's own time. frequency [Hz]: 0 where not known. left_out: interruptions.
    """

    kind = "decay"

    time: Array
    blocks_of_power: Blocks
    blocks_of_phase: Blocks
    log_power: Array
    phase: Array
    scale: Scale
    of_power: Whitening
    of_phase: Whitening
    origin: float
    frequency: float
    base: tuple[ParameterSpec, ...]
    start: Array
    scales: Mapping[str, float]
    notes: tuple[str, ...]
    left_out: tuple[tuple[str, float], ...] = ()

    def usable_effects(self, library: Iterable[Effect]) -> list[Effect]:
        """Return the effects on decays; amplitudes count in units of that at the begin."""
        return [
            replace(effect, parameters=tuple(_in_own_unit(spec) for spec in effect.parameters))
            for effect in library
            if self.can_show(effect)
        ]

    @property
    def common(self) -> object:
        """Another decay begins with another amplitude and phase, in which effects count here."""
        return self

    @property
    def blocks(self) -> NDArray[np.int64]:
        """Stretches of time, dealt in turns: what is held out lies between what is not."""
        return self._stretches % HELD_OUT

    @property
    def _stretches(self) -> NDArray[np.int64]:
        """The stretch of time of each residual."""
        found = [
            np.arange(len(blocks.time)) * STRETCHES // max(len(blocks.time), 1)
            for blocks in (self.blocks_of_power, self.blocks_of_phase)
        ]
        return np.concatenate(found).astype(np.int64)

    @property
    def quantity(self) -> tuple[Array, str]:
        """Power in dB."""
        other = np.full(len(self.phase), np.nan)
        return np.concatenate([DB * self.of_power.sd, other]), "dB"

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The power, and the phase where it was recorded, by time."""
        count = len(self.log_power)
        time = self.origin + self.blocks_of_power.time
        at = np.arange(count)
        found = [Quantity("power", "dB", at, DB * self.of_power.sd, {"time": (time, "s")})]
        if len(self.phase):
            time = self.origin + self.blocks_of_phase.time
            at = count + np.arange(len(self.phase))
            found.append(Quantity("phase", "rad", at, self.of_phase.sd, {"time": (time, "s")}))
        return tuple(found)

    def deviations(self, residuals: Array) -> Array:
        """Return what white residuals stand for, each datum in its own standard deviation."""
        power, phase = np.split(residuals, [len(self.log_power)], axis=-1)
        found = [self.of_power.coloured(power) / self.of_power.sd]
        if len(self.phase):
            found.append(self.of_phase.coloured(phase) / self.of_phase.sd)
        return np.concatenate(found, axis=-1)

    def locate(self, residual: int) -> str:
        """Name the quantity and the time."""
        count = len(self.log_power)
        if residual < count:
            return f"power at {self.origin + self.blocks_of_power.time[residual]:.4g} s"
        return f"phase at {self.origin + self.blocks_of_phase.time[residual - count]:.4g} s"

    def predict(
        self,
        effects: Sequence[Effect],
        base: Values,
        values: Sequence[Values],
        setting: Setting = AS_MEASURED,
    ) -> Prediction:
        """Return power and phase of the blocks, as measured or under another setting."""
        slow = base["decay_rate"]
        log_floor = base["floor"] / DB
        log_level = base["level"] / DB
        lowest = min(float(self.log_power.min()) - log_level, -1.0) + setting.begin - BELOW
        level = np.linspace(setting.begin, lowest, LEVELS)
        idle = Dissipation(level, np.full(LEVELS, slow), slow, np.zeros(LEVELS))
        energy, turned = decayed(apply("dissipation", idle, effects, values), self.time)
        moving = Ringing(self.time, np.exp(energy / 2 + 1j * turned), slow, self.frequency)
        ringing = apply("ringing", moving, effects, values)
        count = len(self.time)
        plain = Reading(
            self.time, np.ones(count), np.zeros(count, complex), setting.bandwidth, setting.drive
        )
        reading = apply("reading", plain, effects, values)
        signal = ringing.amplitude * reading.gain + reading.added
        mean = self.blocks_of_power.mean(np.abs(signal) ** 2)
        # A signal that is gone leaves the floor
        log_mean = log_level + np.log(np.maximum(mean, GONE))
        return Prediction(np.logaddexp(log_mean, log_floor), self._phase(signal, base))

    def _phase(self, signal: NDArray[np.complex128], base: Values) -> Array:
        """Return the phase (n_strong,) [rad] of a signal, up to whole turns of all of it."""
        if not len(self.phase):
            return np.empty(0)
        points = int(self.blocks_of_phase.first[-1] + self.blocks_of_phase.count[-1])
        turning = base["phase"] + 2 * np.pi * base["detuning"] * self.time[:points]
        angle = self.blocks_of_phase.mean(np.unwrap(np.angle(signal[:points])) + turning)
        turns = np.rint(np.median(self.phase - angle) / (2 * np.pi))
        return np.asarray(angle + 2 * np.pi * turns)

    def residuals(self, effects: Sequence[Effect], base: Values, values: Sequence[Values]) -> Array:
        """Return data less prediction, white and of variance 1: power, then phase."""
        predicted = self.predict(effects, base, values)
        away = self.scale.data(self.log_power) - self.scale.expected(predicted.log_power)
        return self._white(away, self.phase - predicted.phase)

    def _white(self, power: Array, phase: Array) -> Array:
        """Return deviations of both quantities without their correlation."""
        if not len(self.phase):
            return self.of_power.white(power)
        return np.concatenate([self.of_power.white(power), self.of_phase.white(phase)])

    def residual_directions(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """Waves of the gain and of the phase over the record."""
        found = {}
        whole = float(self.blocks_of_power.time[-1])
        still = np.zeros(len(self.log_power))
        for n in WAVES:
            shape = np.cos(n * np.pi * self.blocks_of_power.time / whole)
            found[f"gain as cos {n}πt/T"] = self._white(shape, np.zeros(len(self.phase)))
            if len(self.phase):
                shape = np.cos(n * np.pi * self.blocks_of_phase.time / whole)
                found[f"phase as cos {n}πt/T"] = self._white(still, shape)
        return found

    def candidate_measurements(
        self, effects: Sequence[Effect], base: Values, values: Sequence[Values]
    ) -> dict[str, Array]:
        """A weaker decay, a wider filter, and no generator."""
        others = {
            "the same decay from half the amplitude": Setting(begin=float(np.log(WEAKER))),
            "the same decay with ten times the bandwidth": Setting(bandwidth=WIDER),
            "the same decay with the generator unplugged at the switch-off": Setting(drive=False),
        }
        found = {}
        for phrase, setting in others.items():
            predicted = self.predict(effects, base, values, setting)
            found[phrase] = self._white(self.scale.expected(predicted.log_power), predicted.phase)
        return found

    def compare(self, models: Sequence[Named]) -> tuple[Comparison, ...]:
        """Power against time, and the phase where it was recorded."""
        names = tuple(name for name, *_ in models)
        predicted = [self.predict(effects, base, values) for _, effects, base, values in models]
        time = self.origin + self.blocks_of_power.time
        power = DB * np.stack([one.log_power for one in predicted])
        curve = Curve("power", time, DB * self.log_power, DB * self.of_power.sd, power)
        found = [Curves("decay", "time", "s", "power", "dB", names, (curve,))]
        if len(self.phase):
            time = self.origin + self.blocks_of_phase.time
            # Less the frequency of the first model, or the picture would be a straight line
            turning = np.polyval(np.polyfit(time, predicted[0].phase, 1), time)
            phases = np.stack([one.phase for one in predicted]) - turning
            curve = Curve("phase", time, self.phase - turning, self.of_phase.sd, phases)
            found.append(Curves("decay", "time", "s", "phase less a line", "rad", names, (curve,)))
        return tuple(found)

    def describe(self, residuals: Array) -> str:
        """Say in which stretch the data deviate most, and by how much the power or the phase do."""
        stretch = self._stretches
        rms = [float(np.sqrt(np.mean(residuals[stretch == k] ** 2))) for k in np.unique(stretch)]
        worst = int(np.argmax(rms))
        inside = np.flatnonzero(stretch[: len(self.log_power)] == worst)
        times = self.origin + self.blocks_of_power.time[inside[[0, -1]]]
        return (
            f"the decay is not that of one mode: {self._off(residuals)}, and the residuals are "
            f"largest between {times[0]:.4g} and {times[1]:.4g} s ({max(rms):.3g}σ rms against "
            f"{min(rms):.3g}σ)"
        )

    def _off(self, residuals: Array) -> str:
        """Say by how much the power is off, or the phase where that is farther from its noise."""
        away = self.deviations(residuals)
        power, phase = np.split(away, [len(self.log_power)])
        if phase.size and np.mean(phase**2) > np.mean(power**2):
            return f"the phase is off by up to {np.abs(phase * self.of_phase.sd).max():.2g} rad"
        return f"the power is off by up to {np.abs(power * self.of_power.sd * DB).max():.2g} dB"


def decayed(mode: Dissipation, time: Array) -> tuple[Array, Array]:
    """Return ln of the energy (n,) and the phase [rad] (n,) that a pull has turned by.

    dE/dt = −γ(E) E, so that τ(E) = ∫ d ln E/γ; below the last level the last rate goes on.

    Args: mode: rates at levels that fall; time (n,) [s] from the begin.
    """
    fall = -np.diff(mode.level)
    slowness = 1 / mode.rate
    step = 0.5 * (slowness[1:] + slowness[:-1]) * fall
    reached = np.concatenate([[0.0], np.cumsum(step)])
    late = np.maximum(time - reached[-1], 0.0)
    energy = np.interp(time, reached, mode.level) - mode.rate[-1] * late
    turn = mode.pull * slowness
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (turn[1:] + turn[:-1]) * fall)])
    angle = 2 * np.pi * (np.interp(time, reached, turned) + mode.pull[-1] * late)
    return np.asarray(energy), np.asarray(angle)


def _in_own_unit(spec: ParameterSpec) -> ParameterSpec:
    """Return a parameter that counts in powers of the amplitude at the begin, A0."""
    return replace(spec, unit="A0^-2") if spec.scale == "curvature" else spec
