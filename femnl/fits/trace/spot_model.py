"""The harmonics of traces at one spot, as a fringe and the motion at each step make them."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from femnl.core.readout import Array, ComplexArray, FourierSeries
from femnl.fits.trace.folding import Beyond
from femnl.optics.unit_fringe import Orders, real_part

DEEPEST = 30.0
"""Modulation z = qU of the deepest motion that is sought."""
WALL = 1e9
"""Residual of motion beyond twice that, so that no step leads there."""


@dataclass(frozen=True)
class SpotModel:
    """Residuals of harmonics by one vector: V_C, θ, then U of every step, then φ of every step.

    series: the fringe, see `unit_fringe`; harmonic (n_harmonics,); values and sd (n_harmonics,
    n_steps) [V]. beyond: what higher harmonics do to these, None where that is not known.
    """

    series: FourierSeries
    harmonic: Orders
    values: ComplexArray
    sd: Array
    beyond: Beyond | None

    def of_known_noise(self) -> "SpotModel":
        """Return the model in which what is folded is no noise, where the noise is known.

        In a search it has to be, which compares the measured harmonics with what they would be
        alone.
        """
        if self.beyond is None or not self.beyond.noise:
            return self
        return replace(self, sd=self.sd * self.beyond.noise / self.beyond.seen)

    @property
    def wavenumber(self) -> float:
        """The factor q [1/m] of z = qU."""
        return 2 * np.pi / self.series.period

    @property
    def n_steps(self) -> int:
        """How many steps of the drive there are."""
        return int(self.values.shape[1])

    @property
    def n_data(self) -> int:
        """How many of the residuals are of harmonics; the others are of what these leave."""
        return 2 * self.values.size

    def split(self, vector: Array) -> tuple[dict[str, float], Array, Array]:
        """Return the fringe, U and φ."""
        amplitude, phase = vector[2:].reshape(2, -1)
        return {"contrast": float(vector[0]), "fringe_phase": float(vector[1])}, amplitude, phase

    def predict(self, vector: Array) -> ComplexArray:
        """Return V_n of every step (n_harmonics, n_steps) [V]."""
        return self._seen(self._all(vector))

    def residuals(self, vector: Array) -> Array:
        """Return (V − V_predicted)/σ, real beside imaginary parts, then of what is left."""
        if self.wavenumber * np.abs(self.split(vector)[1]).max() > 2 * DEEPEST:
            return np.full(self._count, WALL)
        volts = self._all(vector)
        off = _real((self.values - self._seen(volts)) / self.sd)
        if self.beyond is None:
            return off
        left = self.beyond.left(volts)
        return np.concatenate([off, self.beyond.misfit(left, np.arange(self.n_steps))])

    def jacobian(self, vector: Array) -> Array:
        """Return the derivatives of the residuals by the vector."""
        fringe, amplitude, phase = self.split(vector)
        parts = real_part(self.series, self._orders, amplitude, fringe)
        turn = np.exp(1j * self._orders[:, None] * phase)
        volts = fringe["contrast"] * turn * parts["motion"]
        result = np.zeros((self._count, vector.size))
        blocks = result[: self.n_data].reshape(len(self.harmonic), self.n_steps, 2, vector.size)
        step = np.arange(self.n_steps)
        by_theta = fringe["contrast"] * turn * parts["fringe_phase"]
        for column, change in enumerate((turn * parts["motion"], by_theta)):
            result[: self.n_data, column] = -_real(self._seen(change) / self.sd)
            if self.beyond is not None:
                result[self.n_data :, column] = self.beyond.misfit_slope(volts, change)
        by_phase = 1j * self._orders[:, None] * parts["motion"]
        for first, slope in ((2, parts["by_displacement"]), (2 + self.n_steps, by_phase)):
            own = fringe["contrast"] * turn * slope
            seen = -self._seen(own) / self.sd
            blocks[:, step, 0, first + step] = seen.real
            blocks[:, step, 1, first + step] = seen.imag
            if self.beyond is not None:
                result[self.n_data + step, first + step] = self.beyond.misfit_slope(volts, own)
        return result

    def chi2_by_step(self, vector: Array) -> Array:
        """Return χ² of each step (n_steps,)."""
        residuals = self.residuals(vector)
        off = residuals[: self.n_data].reshape(self.harmonic.size, -1, 2)
        left = residuals[self.n_data :] if self.beyond is not None else 0.0
        return np.asarray(np.sum(off**2, axis=(0, 2)) + left**2)

    def misfit_left(
        self, theta: float, steps: Orders, amplitude: Array
    ) -> Callable[[float], Array]:
        """Return χ² (n_steps, n_amplitudes) of what motions of any phase leave, by the contrast."""
        beyond = self.beyond
        if beyond is None:
            return lambda contrast: np.zeros((steps.size, amplitude.size))
        fringe = {"contrast": 1.0, "fringe_phase": theta}
        unit = real_part(self.series, beyond.harmonic, amplitude, fringe)["motion"]
        left = beyond.share[steps] @ unit**2
        return lambda contrast: beyond.misfit(contrast**2 * left, steps) ** 2

    @property
    def _orders(self) -> Orders:
        """All harmonics that are predicted, the measured ones first."""
        if self.beyond is None:
            return self.harmonic
        return np.concatenate([self.harmonic, self.beyond.harmonic])

    @property
    def _count(self) -> int:
        """Number of residuals."""
        return self.n_data + (0 if self.beyond is None else self.n_steps)

    def _all(self, vector: Array) -> ComplexArray:
        """Return V_n of all harmonics that are predicted (n_orders, n_steps)."""
        fringe, amplitude, phase = self.split(vector)
        motion = real_part(self.series, self._orders, amplitude, fringe)["motion"]
        turn = np.exp(1j * self._orders[:, None] * phase)
        return np.asarray(fringe["contrast"] * turn * motion)

    def _seen(self, volts: ComplexArray) -> ComplexArray:
        """Return the measured harmonics (n_harmonics, n_steps) of all (n_orders, n_steps)."""
        return volts if self.beyond is None else self.beyond.add(volts)


def _real(values: ComplexArray) -> Array:
    """Return real and imaginary parts side by side, flat."""
    return np.ascontiguousarray(values).view(float).ravel()
