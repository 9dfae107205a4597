"""From a wide sweep to a labelled spectrum: lines found, fitted, and given to simulated modes."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from femnl.core.errors import MeasurementError
from femnl.core.spectrum import Assignment, Peaks
from femnl.fits.spectrum.assignment import assign
from femnl.fits.spectrum.peaks import find_peaks
from femnl.io.measurement import spectrum


def identify(
    dataset: xr.Dataset,
    labels: Sequence[str | None],
    simulated: ArrayLike,
    sweep: int = 0,
    scale_sd: float = 0.3,
) -> tuple[Peaks, Assignment]:
    """Find the lines of a wide sweep and give them to simulated modes.

    Args: dataset of kind `response`; labels of the simulated modes (None is numbered) and their
    frequencies [Hz]; sweep; scale_sd: how well the common scale is known beforehand (standard
    deviation of its logarithm).
    Returns: Peaks and Assignment. Raises: MeasurementError where no line stands out.
    """
    peaks = find_peaks(dataset, sweep)
    if peaks.frequency.size == 0:
        raise MeasurementError(
            f"response: no line stands out of the noise in sweep {sweep}; average longer or "
            "drive harder"
        )
    return peaks, label_peaks(peaks, labels, simulated, scale_sd)


def label_peaks(
    peaks: Peaks, labels: Sequence[str | None], simulated: ArrayLike, scale_sd: float = 0.3
) -> Assignment:
    """Give the lines of a sweep to simulated modes; arguments as of `identify`."""
    names = [label or f"mode {number}" for number, label in enumerate(labels, start=1)]
    # A line between two points, too narrow for them to tell its place, still lies between them.
    spacing = np.interp(peaks.frequency, peaks.points, np.gradient(peaks.points))
    sd = np.where(np.isfinite(peaks.frequency_sd), peaks.frequency_sd, spacing)
    return assign(peaks.frequency, sd, names, simulated, peaks.band, scale_sd)


def to_spectrum(peaks: Peaks, assignment: Assignment | None = None) -> xr.Dataset:
    """Return the lines as a measurement of kind `spectrum`.

    Labels "m,n" where assigned, lines without a mode left out.

    A line whose frequency or width the data do not determine (infinite sd) is left out too.
    """
    labels = [None] * peaks.frequency.size if assignment is None else list(assignment.best.label)
    sure = np.isfinite(peaks.frequency_sd)
    kept = np.array(
        [
            index
            for index in np.flatnonzero(sure)
            if assignment is None or labels[index] is not None
        ],
        dtype=int,
    )
    names = None if assignment is None else [str(labels[index]).strip("()") for index in kept]
    quality = peaks.quality_factor[kept]
    quality_sd = peaks.quality_factor_sd[kept]
    known = np.where(np.isfinite(quality_sd), quality_sd, np.nan)
    return spectrum(
        peaks.frequency[kept],
        peaks.frequency_sd[kept],
        names,
        quality_factor=quality,
        quality_factor_sd=known,
    )
