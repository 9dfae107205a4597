"""Lines of a wide sweep, found one after the other and fitted together where they overlap."""

import numpy as np
import xarray as xr

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.spectrum import Peaks
from femnl.fits.spectrum.alone import is_met, one_line, threshold
from femnl.fits.spectrum.line_search import (
    Task,
    Work,
    bounded_search,
    smooth_background,
    sum_of_lines,
)
from femnl.fits.spectrum.lines import Array, Cluster, Complex
from femnl.fits.spectrum.scan import WIDEST
from femnl.io.measurement import amplitude, noise_sd

_UNSURE = 0.5  # of a linewidth; a larger standard deviation of it is reported


def find_peaks(dataset: xr.Dataset, sweep: int = 0) -> Peaks:
    """Find and fit the resonances of a wide sweep.

    Wide and narrow ones, overlapping ones, on a sloping background.

    V(f) = Σ_k A_k f_kγ_k/(f_k² − f² + i f γ_k) + smooth. Matched filters of all widths look for the
    strongest line in the residual; it is fitted together with all lines that it touches, taken off,
    and the search goes on until nothing is left that noise would not give once in a thousand
    sweeps. A line that does not pay for itself in the end is dropped.
    Args: dataset of kind `response`, complex; sweep: which one.
    Returns: Peaks. Raises: MeasurementError for magnitudes alone and for fewer than 24 points,
    ParameterError for a sweep that is not there.
    Valid: linear response, at most a small part of the points on lines.
    """
    if "magnitude" in dataset:
        raise MeasurementError(
            "response: magnitudes alone; lines are sought in real and imag, as a magnitude widens "
            "them"
        )
    if not 0 <= sweep < dataset.sizes["sweep"]:
        raise ParameterError(
            f"sweep {sweep}: the measurement has sweeps 0 to {dataset.sizes['sweep'] - 1}; "
            "choose one of them"
        )
    f = dataset["frequency"].values[sweep]
    volts = amplitude(dataset).values[sweep]
    known = np.isfinite(f) & np.isfinite(volts)
    f, first = np.unique(f[known], return_index=True)
    volts = volts[known][first]
    if f.size < 24:
        raise MeasurementError(
            f"response: sweep {sweep} has {f.size} points; a search for lines needs 24, take a "
            "finer sweep"
        )
    noise, sentence = noise_sd(dataset)
    alone = one_line(f, volts, noise)
    task = Task(noise, threshold(f.size), WIDEST * float(f[-1] - f[0]), Work())
    if alone is not None and is_met(alone, task.limit):
        return _result(f, volts, [alone], (sentence,))
    clusters, notes = bounded_search(f, volts, task)
    if not clusters and alone is not None:
        # Wide lines are background to the search: alone in the span, one is a line
        clusters = [alone]
    return _result(f, volts, clusters, (sentence, *notes))


def _result(f: Array, volts: Complex, clusters: list[Cluster], notes: tuple[str, ...]) -> Peaks:
    def gather(name: str) -> Array:
        return np.concatenate([np.empty(0), *(getattr(cluster, name) for cluster in clusters)])

    order = np.argsort(gather("frequency"))
    frequency = gather("frequency")[order]
    linewidth = gather("linewidth")[order]
    lines = sum_of_lines(f, clusters)
    points = sum(cluster.n_points - 4 * cluster.frequency.size - 6 for cluster in clusters)
    linewidth_sd = gather("linewidth_sd")[order]
    narrow = np.count_nonzero(~(linewidth_sd < _UNSURE * linewidth))
    if narrow:
        notes = (
            *notes,
            f"these points do not resolve the width of {narrow} lines; sweep them more finely",
        )
    return Peaks(
        frequency=frequency,
        frequency_sd=gather("frequency_sd")[order],
        linewidth=linewidth,
        linewidth_sd=linewidth_sd,
        amplitude=np.concatenate(
            [np.empty(0, dtype=complex), *(cluster.amplitude for cluster in clusters)]
        )[order],
        amplitude_sd=gather("amplitude_sd")[order],
        points=f,
        prediction=lines + smooth_background(f, volts - lines),
        band=(float(f[0]), float(f[-1])),
        chi2_reduced=sum(cluster.chi2 for cluster in clusters) / points if points else 1.0,
        notes=notes,
    )
