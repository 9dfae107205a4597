"""Harmonics beyond the measured ones: what they do to these, and what they leave of a record."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import solve

from femnl.core.readout import Array, ComplexArray, HarmonicSpectrum
from femnl.fits.trace.decompose import design, drive_phases
from femnl.observe.trace.model import Folded
from femnl.optics.unit_fringe import Orders

SMOOTH = 48
"""Harmonics that a sinusoidal fringe makes of the deepest motion that is sought."""
AT_ONCE = 65_536
"""Samples whose products are added up at once: all columns of a long record would fill the memory.
"""


@dataclass(frozen=True)
class Beyond:
    """Harmonics beyond the measured ones, as these and what they leave of a record show them.

    harmonic (n_beyond,). fold (n_steps, n_harmonics, 2 n_beyond) complex: what real, then imaginary
    parts of those beyond add to the measured ones. beat (n_steps, 2 n_beyond, 2 n_beyond): the mean
    square that they leave, with `degrees` (n_steps,) independent degrees of freedom. seen
    (n_steps,) [V]: what is left of a sample; noise [V]: the part of it that is known to be noise, 0
    where none is.
    """

    harmonic: Orders
    fold: ComplexArray
    beat: Array
    degrees: Array
    seen: Array
    noise: float

    @cached_property
    def share(self) -> Array:
        """The mean square (n_steps, n_beyond) that |V_n| = 1 V leaves, whatever the phases."""
        real, imaginary = np.split(np.diagonal(self.beat, axis1=1, axis2=2), 2, axis=1)
        return np.asarray((real + imaginary) / 2)

    def misfit(self, left: Array, steps: NDArray[np.int64]) -> Array:
        """Return the residual (n_steps, …) of a mean square `left` [V²] that some steps leave.

        Where no noise is known, only more than all that is seen contradicts.
        """
        shape = (-1,) + (1,) * (left.ndim - 1)
        seen = self.seen[steps].reshape(shape)
        degrees = self.degrees[steps].reshape(shape)
        if self.noise:
            return np.asarray(
                np.sqrt(2 * degrees) * (seen / np.sqrt(self.noise**2 + np.maximum(left, 0)) - 1)
            )
        return np.asarray(np.sqrt(degrees / 2) * np.maximum(left / seen**2 - 1, 0))

    def misfit_slope(self, volts: ComplexArray, change: ComplexArray) -> Array:
        """Return the derivative (n_steps,) of `misfit` as all harmonics change [V/…]."""
        left = self.left(volts)
        by_left = np.where(left > self.seen**2, np.sqrt(self.degrees / 2) / self.seen**2, 0.0)
        if self.noise:
            whole = self.noise**2 + np.maximum(left, 0)
            by_left = -np.sqrt(2 * self.degrees) * self.seen / (2 * whole**1.5)
        steep = 2 * np.sum(self._parts(volts) * (self.beat @ self._parts(change)), axis=(1, 2))
        return np.asarray(by_left * steep)

    def left(self, volts: ComplexArray) -> Array:
        """Return the mean square (n_steps,) that harmonics (n_all, n_steps) [V] leave."""
        parts = self._parts(volts)
        return np.asarray(np.sum(parts * (self.beat @ parts), axis=(1, 2)))

    def add(self, volts: ComplexArray) -> ComplexArray:
        """Return the measured ones (n_harmonics, n_steps) of harmonics (n_all, n_steps) [V]."""
        measured = volts[: self.fold.shape[1]]
        return np.asarray(measured + (self.fold @ self._parts(volts))[:, :, 0].T)

    def _parts(self, volts: ComplexArray) -> Array:
        """Return real, then imaginary parts of the ones beyond, (n_steps, 2 n_beyond, 1)."""
        high = volts[self.fold.shape[1] :]
        return np.concatenate([high.real, high.imag]).T[:, :, None]


def beyond(traces: xr.Dataset, spectrum: HarmonicSpectrum, noise: float = 0.0) -> Beyond:
    """Return what the harmonics beyond those of a spectrum do to the traces it is of.

    noise [V] per sample, 0 where it is not known.
    """
    count = int(spectrum.harmonic.max())
    every = folded(traces, spectrum.drive_frequency, count, max(SMOOTH, count + 1))
    return beyond_of(every, spectrum, degrees_left(traces, count), noise)


def beyond_of(
    every: Folded, spectrum: HarmonicSpectrum, degrees: NDArray[np.int64], noise: float
) -> Beyond:
    """Return the same from what is folded; degrees (n_steps,): of freedom of what is left."""
    return Beyond(
        every.orders[every.fold.shape[1] :],
        every.fold,
        every.beat / degrees[:, None, None],
        np.asarray(spectrum.independent * degrees, float),
        spectrum.noise_sd,
        noise,
    )


def degrees_left(traces: xr.Dataset, n_harmonics: int) -> NDArray[np.int64]:
    """Return the degrees of freedom of what harmonics leave of each step (n_steps,)."""
    return np.asarray(np.isfinite(traces["voltage"].values).sum(axis=1) - 2 * n_harmonics - 1)


def folded(traces: xr.Dataset, frequency: Array, n_harmonics: int, most: int) -> Folded:
    """Return what harmonics up to `most` do to the measured ones at each step.

    frequency (n_steps,) [Hz] of the drive.
    """
    orders = np.arange(1, max(most, n_harmonics) + 1)
    # Phases count from the drive where it was recorded, and so do times
    late = drive_phases(traces, frequency) / (2 * np.pi * frequency)
    steps = [
        _folding(time + start, f, n_harmonics, len(orders))
        for time, start, f in zip(_times(traces), late, frequency, strict=True)
    ]
    return Folded(
        orders, np.stack([fold for fold, _ in steps]), np.stack([beat for _, beat in steps])
    )


def _times(traces: xr.Dataset) -> list[Array]:
    """Return the times [s] of the samples of each step that are there."""
    time = traces["time"].values.astype(float)
    return [time[np.isfinite(row)] for row in traces["voltage"].values]


def _folding(
    time: Array, frequency: float, n_harmonics: int, highest: int
) -> tuple[ComplexArray, Array]:
    """Return what the harmonics beyond the measured ones add to those, and to the squares left.

    The columns stand for the real, then for the imaginary parts of the harmonics beyond.
    """
    products = np.zeros((2 * highest + 1, 2 * highest + 1))
    for first in range(0, len(time), AT_ONCE):
        columns = design(time[first : first + AT_ONCE], frequency, highest)
        products += columns.T @ columns
    order = np.arange(2 * highest + 1)
    measured = (order == 0) | ((order - 1) % highest < n_harmonics)
    low = products[np.ix_(measured, measured)]
    between = products[np.ix_(measured, ~measured)]
    solved = solve(low, between, assume_a="pos")
    left = products[np.ix_(~measured, ~measured)] - between.T @ solved
    return solved[1 : n_harmonics + 1] + 1j * solved[n_harmonics + 1 :], np.asarray(left)
