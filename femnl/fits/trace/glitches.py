"""Samples of traces that stand out from all harmonics of the drive, and the noise of the rest."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.core.readout import HarmonicSpectrum
from femnl.core.robust import MAD
from femnl.fits.outliers import MOST_GLITCHES, outlier_limit
from femnl.fits.trace.colour import beside_phase
from femnl.fits.trace.decompose import MOST_HARMONICS, SAMPLES_EACH, design, drive_frequencies
from femnl.fits.trace.folding import SMOOTH
from femnl.io.measurement import estimate_noise

ROUNDS = 4
"""Times that a record is decomposed without the glitches found so far."""
ALIKE = 1e-3
"""Singular value, over the largest, of harmonics that a record does not tell apart."""
DENSE = 8192
"""Samples from which on neighbours in phase follow the steepest fringe that is sought."""
CLEAR = 0.1
"""Relative difference of the noise that the spectra show and the stated one that is told."""

EVEN = 4.0
"""Standard errors within which what harmonics leave of each record is the same."""

LeftOut = tuple[tuple[str, float], ...]
"""What was left out: where it is, and by how many σ it stands out."""


def without_glitches(traces: xr.Dataset, n_harmonics: int) -> tuple[xr.Dataset, LeftOut]:
    """Return traces whose glitches are missing samples, and what was left out.

    A glitch is a sample that stands out from the least squares of all harmonics, and from the
    samples of about its phase, by more than chance allows, in units of the median scatter. Where
    more than `MOST_GLITCHES` of all samples stand out, none is a glitch.
    """
    time = traces["time"].values.astype(float)
    voltage = traces["voltage"].values.astype(float).copy()
    highest = _fitted(int(np.isfinite(voltage).sum(axis=1).min()), n_harmonics)
    told = []
    for step, frequency in enumerate(drive_frequencies(traces)):
        row = voltage[step]
        columns = design(time, float(frequency), highest)
        order = np.argsort(float(frequency) * time % 1.0, kind="stable")
        used = np.isfinite(row)
        kept = used.copy()
        for _ in range(ROUNDS):
            solved, *_ = np.linalg.lstsq(columns[kept], row[kept], rcond=ALIKE)
            left = np.where(
                used, beside_phase(row - columns @ solved, order[used[order]], np.median), 0.0
            )
            scatter = MAD * float(np.median(np.abs(left[kept])))
            away = np.abs(left) / max(scatter, 1e-300)
            fresh = used & (away <= outlier_limit(away[used]))
            if np.array_equal(fresh, kept):
                break
            kept = fresh
        gone = used & ~kept
        row[gone] = np.nan
        told += [
            (f"step {step + 1}, t = {time[i]:.6g} s", float(away[i])) for i in np.flatnonzero(gone)
        ]
    if len(told) > MOST_GLITCHES * np.isfinite(traces["voltage"].values).sum():
        return traces, ()
    cleared = traces.assign(voltage=(traces["voltage"].dims, voltage))
    return cleared, tuple(sorted(told, key=lambda one: -one[1]))


def _fitted(n_samples: int, n_harmonics: int) -> int:
    """Return how many harmonics are fitted to a record before its glitches are sought.

    Where the sampling rate leaves few, those beyond fold onto them. The phases of a short record
    are too far apart to follow a steep fringe between them, so that they would stand out. Of a
    dense one they take long and are no need.
    """
    if n_harmonics == MOST_HARMONICS or n_samples > DENSE:
        return n_harmonics
    return max(n_harmonics, min(SMOOTH, (n_samples // SAMPLES_EACH - 1) // 2))


def found_factor(
    traces: xr.Dataset, spectrum: HarmonicSpectrum, degrees: NDArray[np.int64]
) -> float:
    """Return the noise that spectra show beside all lines, over the stated one.

    1 where they differ by nothing that matters, where none is stated, and where records are too
    short to tell. It is no more than what the harmonics leave: samples that are left out are
    straight lines to a spectrum, which look like noise. More noise than stated is told only where
    the harmonics leave the same of every record: what they leave of harmonics beyond them varies
    with the motion. Noise with a colour has no floor, and is what the harmonics leave.

    Args: degrees (n_steps,): of freedom of what the harmonics leave.
    """
    stated = traces.attrs.get("noise_sd")
    if stated is None:
        return 1.0
    left = spectrum.noise_sd
    noise = float(np.median(left))
    if spectrum.correlation_length == 1:
        filled = traces["voltage"].interpolate_na("time", fill_value="extrapolate")
        try:
            noise = min(noise, estimate_noise(traces.assign(voltage=filled)))
        except MeasurementError:
            return 1.0
    factor = noise / float(stated)
    if abs(np.log(max(factor, 1e-300))) < CLEAR:
        return 1.0
    apart = np.log(left / np.median(left)) * np.sqrt(2 * spectrum.independent * degrees)
    return factor if factor < 1 or np.abs(apart).max() < EVEN else 1.0
