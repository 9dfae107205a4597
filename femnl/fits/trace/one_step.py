"""The motion at one step of a drive, under a known fringe, with the harmonics that fold."""

import numpy as np
from scipy.optimize import least_squares

from femnl.core.readout import Array, ComplexArray, FourierSeries
from femnl.fits.trace.folding import Beyond
from femnl.optics.unit_fringe import Orders, real_part

TURNS = 4
"""Phases of the motion that are tried for each period of the highest measured harmonic."""
STEP = 0.01
"""Sizes of steps: of the phase in rad, and of the amplitude in parts of the largest one."""
FOLLOWED = 3
"""Motions of a grid that are refined."""


class OneStep:
    """The residuals of one step by amplitude [m] and phase of its motion.

    Where samples are few a period, several motions have nearly the same lower harmonics. What the
    higher ones add to them, and leave of the record, tells which it is.
    """

    def __init__(
        self,
        series: FourierSeries,
        fringe: dict[str, float],
        measured: tuple[Orders, ComplexArray, Array],
        beyond: Beyond,
        step: int,
    ) -> None:
        """Take the fringe, and the measured harmonics with their values and sd [V]."""
        self._series = series
        self._fringe = fringe
        harmonic, values, sd = measured
        self._orders = np.concatenate([harmonic, beyond.harmonic])
        self._values = values[:, None]
        self._sd = sd[:, None]
        self._beyond = beyond
        self._step = step

    def best(self, amplitudes: Array) -> tuple[float, float, float]:
        """Return χ², amplitude and phase of the best motion of a grid, refined."""
        unit = self._still(amplitudes)
        phases = np.arange(0, 2 * np.pi, 2 * np.pi / (TURNS * len(self._values)))
        misfit = np.stack(
            [
                np.sum(self._residuals(self._turned(float(phi)) * unit) ** 2, axis=0)
                for phi in phases
            ]
        )
        lowest = misfit.min(axis=0)
        around = np.pad(lowest, 1, constant_values=np.inf)
        valleys = np.flatnonzero((lowest <= around[:-2]) & (lowest <= around[2:]))
        ends = []
        for k in valleys[np.argsort(lowest[valleys])[:FOLLOWED]]:
            start = np.array([amplitudes[k], phases[np.argmin(misfit[:, k])]])
            found = least_squares(self._of, start, x_scale=(STEP * amplitudes[-1], STEP))
            ends.append((float(2 * found.cost), abs(float(found.x[0])), float(found.x[1])))
        return min(ends)

    def _of(self, motion: Array) -> Array:
        """Return the residuals (n_residuals,) of a motion: amplitude [m] and phase."""
        volts = self._turned(float(motion[1])) * self._still(np.abs(motion[:1]))
        return self._residuals(volts)[:, 0]

    def _turned(self, phase: float) -> ComplexArray:
        """Return e^{inφ} of every harmonic (n_orders, 1)."""
        return np.asarray(np.exp(1j * self._orders[:, None] * phase))

    def _still(self, amplitude: Array) -> Array:
        """Return V_n e^{−inφ} [V] of motions, (n_orders, n_motions)."""
        motion = real_part(self._series, self._orders, amplitude, self._fringe)["motion"]
        return np.asarray(self._fringe["contrast"] * motion)

    def _residuals(self, volts: ComplexArray) -> Array:
        """Return the residuals (n_residuals, n) of harmonics V_n [V], (n_orders, n)."""
        low, high = np.split(volts, [len(self._values)])
        parts = np.concatenate([high.real, high.imag])
        off = (self._values - low - self._beyond.fold[self._step] @ parts) / self._sd
        left = np.sum(parts * (self._beyond.beat[self._step] @ parts), axis=0)
        rest = self._beyond.misfit(left[None], np.array([self._step]))
        return np.concatenate([off.real, off.imag, rest])
