"""Points of sweeps that stand apart from a smooth curve or a circle, before anything is fitted."""

import numpy as np
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import binary_dilation

from femnl.core.readout import Array
from femnl.fits.outliers import MOST_GLITCHES
from femnl.fits.response.circle import Mask, off_circle
from femnl.observe.response.sweeps import FEWEST_POINTS, Complex, collect

APART = 6.0
"""Distance of a spike from the curve over what its neighbours are off, and over the noise."""
FEWEST_SWEEPS = 3
"""Sweeps from which on a spike is told from a resonance that is narrower than a step: that one is
at about one point in several of them."""
RECURRING = 1 / 3
"""Part of the sweeps with a spike at about one point, from which on it is no glitch."""
MOST_OF = 0.5
"""Part of a sweep that spikes leave: what takes more of it is another state of the mode."""


def without_spikes(dataset: xr.Dataset, noise: float) -> xr.Dataset:
    """Return sweeps whose spikes are missing points, for a fit that has to start somewhere.

    A large glitch may lead a first fit astray, and none is known before it. A spike is far from the
    cubic through its four neighbours, and each of the next two is near the line through those
    around it without the spike. At a jump neither is so. Where all else lies on the circle of a
    mode, several neighbours that are off it are spikes, too.

    Args: noise [V] of each quadrature.
    """
    volts = dataset["real"].values + 1j * dataset["imag"].values
    if len(volts) < FEWEST_SWEEPS or volts.shape[1] < FEWEST_POINTS:
        return dataset
    cleared = _without(dataset, _rare(_single(volts, noise), np.isfinite(volts)))
    sweeps = collect(cleared)
    apart = np.zeros(volts.shape, dtype=bool)
    apart[sweeps.row, sweeps.column] = off_circle(sweeps)
    return _without(cleared, _rare(apart, np.isfinite(cleared["real"].values)))


def _without(dataset: xr.Dataset, spikes: Mask) -> xr.Dataset:
    """Return sweeps some of whose points are missing."""
    dims = dataset["real"].dims
    return dataset.assign(
        {
            name: (dims, np.where(spikes, np.nan, dataset[name].values), dataset[name].attrs)
            for name in ("real", "imag")
        }
    )


def _single(volts: Complex, noise: float) -> Mask:
    """Return which points (n_sweeps, n_points) are far from a curve through their neighbours."""
    spikes = np.zeros(volts.shape, dtype=bool)
    spikes[:, 2:-2] = _apart(volts, noise)
    return spikes


def _rare(spikes: Mask, usable: Mask) -> Mask:
    """Return which spikes (n_sweeps, n_points) may be glitches, none of too many.

    Not what is at about one point of several sweeps, nor what takes most of a sweep.
    """
    near = binary_dilation(spikes, np.ones((1, 3), dtype=bool))
    recurring = near.sum(axis=0) >= max(RECURRING * len(spikes), FEWEST_SWEEPS)
    rare = spikes & ~recurring
    left = (usable & ~rare).sum(axis=1)
    rare[left < np.maximum(MOST_OF * usable.sum(axis=1), FEWEST_POINTS)] = False
    few = rare.sum() <= MOST_GLITCHES * usable.sum()
    return rare if few else np.zeros_like(rare)


def _apart(volts: Complex, noise: float) -> Mask:
    """Return which points (n_sweeps, n_points − 4) are spikes, without two at each end."""
    a, b, here, c, d = np.moveaxis(sliding_window_view(volts, 5, axis=1), -1, 0)
    away = np.abs(here - (4 * (b + c) - a - d) / 6)
    off: Array = np.maximum(np.abs(b - (2 * a + c) / 3), np.abs(c - (b + 2 * d) / 3))
    return np.asarray(away > APART * np.maximum(off, noise))
