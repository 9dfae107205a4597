"""Points of sweeps that stand apart from a smooth curve or a circle, before anything is fitted."""

import numpy as np
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from femnl.core.readout import Array
from femnl.fits.outliers import MOST_GLITCHES
from femnl.fits.response.circle import Mask, off_circle
from femnl.observe.response.sweeps import collect

APART = 6.0
"""Distance of a spike from the curve over what its neighbours are off, and over the noise."""
FEWEST_SWEEPS = 3
"""Sweeps from which on a spike is told from a resonance that is narrower than a step: that one is
at about one point in several of them."""
RECURRING = 1 / 3
"""Part of the sweeps with a spike at about one point, from which on it is no glitch."""


def without_spikes(dataset: xr.Dataset, noise: float) -> xr.Dataset:
    """Return sweeps whose spikes are missing points, for a fit that has to start somewhere.

    A large glitch may lead a first fit astray, and none is known before it. A spike is far from the
    cubic through its four neighbours, and each of the next two is near the line through those
    around it without the spike. At a jump neither is so. Where all else lies on the circle of a
    mode, several neighbours that are off it are spikes, too.

    Args: noise [V] of each quadrature.
    """
    cleared = _without(dataset, _single(dataset, noise))
    sweeps = collect(cleared)
    off = off_circle(sweeps)
    apart = np.zeros(dataset["real"].shape, dtype=bool)
    apart[sweeps.row[off], sweeps.column[off]] = True
    return _without(cleared, apart)


def _without(dataset: xr.Dataset, spikes: Mask) -> xr.Dataset:
    """Return sweeps some of whose points are missing."""
    dims = dataset["real"].dims
    return dataset.assign(
        {
            name: (dims, np.where(spikes, np.nan, dataset[name].values), dataset[name].attrs)
            for name in ("real", "imag")
        }
    )


def _single(dataset: xr.Dataset, noise: float) -> Mask:
    """Return which points (n_sweeps, n_points) are far from a curve through their neighbours."""
    volts = dataset["real"].values + 1j * dataset["imag"].values
    spikes = np.zeros(volts.shape, dtype=bool)
    if len(volts) < FEWEST_SWEEPS or volts.shape[1] < 5:
        return spikes
    spikes[:, 2:-2] = _apart(volts, noise)
    near = np.zeros_like(spikes)
    for step in (-1, 0, 1):
        near |= np.roll(spikes, step, axis=1)
    recurring = near.sum(axis=0) >= max(RECURRING * len(volts), FEWEST_SWEEPS)
    spikes &= ~recurring
    few = spikes.sum() <= MOST_GLITCHES * np.isfinite(volts).sum()
    return spikes if few else np.zeros_like(spikes)


def _apart(volts: NDArray[np.complex128], noise: float) -> Mask:
    """Return which points (n_sweeps, n_points − 4) are spikes, without two at each end."""
    a, b, here, c, d = np.moveaxis(sliding_window_view(volts, 5, axis=1), -1, 0)
    away = np.abs(here - (4 * (b + c) - a - d) / 6)
    off: Array = np.maximum(np.abs(b - (2 * a + c) / 3), np.abs(c - (b + 2 * d) / 3))
    return np.asarray(away > APART * np.maximum(off, noise))
