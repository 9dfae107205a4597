"""Samples of traces that stand out from all harmonics of the drive, and the noise of the rest."""

import numpy as np
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.core.readout import Array
from femnl.fits.outliers import MOST_GLITCHES, outlier_limit
from femnl.fits.trace.decompose import design
from femnl.io.measurement import estimate_noise

ROUNDS = 4
"""Times that a record is decomposed without the glitches found so far."""
AROUND = 7
"""Samples of about one phase, whose median a sample is compared with."""
CLEAR = 0.1
"""Relative difference of the noise that the spectra show and the stated one that is told."""

EVEN = 4.0
"""Standard errors within which what harmonics leave of each record is the same."""

LeftOut = tuple[tuple[str, float], ...]
"""What was left out: where it is, and by how many σ it stands out."""


def without_glitches(traces: xr.Dataset, n_harmonics: int) -> tuple[xr.Dataset, LeftOut]:
    """Return traces whose glitches are missing samples, and what was left out.

    A glitch is a sample that stands out from the least squares of all harmonics, and from the
    samples of about its phase, by more than chance allows, in units of the median scatter; at most
    `MOST_GLITCHES` of a record.
    """
    if "drive_frequency" not in traces:
        return traces, ()
    time = traces["time"].values.astype(float)
    voltage = traces["voltage"].values.astype(float).copy()
    told = []
    for step, frequency in enumerate(traces["drive_frequency"].values.astype(float)):
        row = voltage[step]
        columns = design(time, float(frequency), n_harmonics)
        order = np.argsort(float(frequency) * time % 1.0, kind="stable")
        used = np.isfinite(row)
        kept = used.copy()
        for _ in range(ROUNDS):
            solved, *_ = np.linalg.lstsq(columns[kept], row[kept], rcond=None)
            left = np.where(used, _beside_phase(row - columns @ solved, order[used[order]]), 0.0)
            scatter = 1.4826 * float(np.median(np.abs(left[kept])))
            away = np.abs(left) / max(scatter, 1e-300)
            fresh = used & (away <= outlier_limit(away[used]))
            if np.array_equal(fresh, kept):
                break
            kept = fresh
        gone = used & ~kept
        if gone.sum() <= MOST_GLITCHES * used.sum():
            row[gone] = np.nan
            told += [
                (f"step {step + 1}, t = {time[i]:.6g} s", float(away[i]))
                for i in np.flatnonzero(gone)
            ]
    cleared = traces.assign(voltage=(traces["voltage"].dims, voltage))
    return cleared, tuple(sorted(told, key=lambda one: -one[1]))


def _beside_phase(left: Array, order: NDArray[np.intp]) -> Array:
    """Return residuals (n,) less what recurs in each period: what harmonics beyond the last leave.

    A clipped signal leaves much at its corners, and a glitch would not stand out from that.

    Args: order: the samples that are there, by their phase.
    """
    half = AROUND // 2
    around = sliding_window_view(np.pad(left[order], half, mode="wrap"), AROUND)
    found = left.copy()
    # Without the sample itself: it would be the median of one record in so many
    found[order] -= np.median(np.delete(around, half, axis=1), axis=1)
    return found


def found_factor(traces: xr.Dataset, left: Array, degrees: NDArray[np.int64]) -> float:
    """Return the noise that spectra show beside all lines, over the stated one.

    1 where they differ by nothing that matters, where none is stated, and where records are too
    short to tell. It is no more than what the harmonics leave: samples that are left out are
    straight lines to a spectrum, which look like noise. More noise than stated is told only where
    the harmonics leave the same of every record: what they leave of harmonics beyond them varies
    with the motion.

    Args: left (n_steps,) [V]: what the harmonics leave of each record, with `degrees` of freedom.
    """
    stated = traces.attrs.get("noise_sd")
    if stated is None:
        return 1.0
    filled = traces["voltage"].interpolate_na("time", fill_value="extrapolate")
    try:
        floor = estimate_noise(traces.assign(voltage=filled))
    except MeasurementError:
        return 1.0
    factor = min(floor, float(np.median(left))) / float(stated)
    if abs(np.log(max(factor, 1e-300))) < CLEAR:
        return 1.0
    apart = np.log(left / np.median(left)) * np.sqrt(2 * degrees)
    return factor if factor < 1 or np.abs(apart).max() < EVEN else 1.0
