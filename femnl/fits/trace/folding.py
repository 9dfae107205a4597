"""Harmonics beyond the measured ones: what they do to these, and what they leave of a record."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import solve

from femnl.core.readout import Array, ComplexArray, HarmonicSpectrum
from femnl.fits.trace.decompose import design
from femnl.observe.trace.model import Folded
from femnl.optics.unit_fringe import Orders

SMOOTH = 48
"""Harmonics that a sinusoidal fringe makes of the deepest motion that is sought."""
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
    square that they leave, with `degrees` (n_steps,) degrees of freedom.
    """

    harmonic: Orders
    fold: ComplexArray
    beat: Array
    degrees: NDArray[np.int64]

    @cached_property
    def share(self) -> Array:
        """The mean square (n_steps, n_beyond) that |V_n| = 1 V leaves, whatever the phases."""
        real, imaginary = np.split(np.diagonal(self.beat, axis1=1, axis2=2), 2, axis=1)
        return np.asarray((real + imaginary) / 2)

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


def beyond(traces: xr.Dataset, spectrum: HarmonicSpectrum) -> Beyond:
    """Return what the harmonics beyond those of a spectrum do to the traces it is of."""
    count = int(spectrum.harmonic.max())
    every = folded(traces, spectrum.drive_frequency, count, max(SMOOTH, count + 1))
    degrees = degrees_left(traces, count)
    return Beyond(every.orders[count:], every.fold, every.beat / degrees[:, None, None], degrees)


def degrees_left(traces: xr.Dataset, n_harmonics: int) -> NDArray[np.int64]:
    """Return the degrees of freedom of what harmonics leave of each step (n_steps,)."""
    return np.asarray(np.isfinite(traces["voltage"].values).sum(axis=1) - 2 * n_harmonics - 1)


def folded(traces: xr.Dataset, frequency: Array, n_harmonics: int, most: int) -> Folded:
    """Return what harmonics up to `most` do to the measured ones at each step.

    frequency (n_steps,) [Hz] of the drive.
    """
    orders = np.arange(1, max(most, n_harmonics) + 1)
    steps = [
        _folding(time, f, n_harmonics, len(orders))
        for time, f in zip(_times(traces), frequency, strict=True)
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
