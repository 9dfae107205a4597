"""Several linear modes in the span of a sweep, on a common background."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from femnl.core.errors import ConvergenceError, MeasurementError
from femnl.core.fit import Fit, Parameter
from femnl.fits.covariance import derived
from femnl.fits.response.linear import linear_starts
from femnl.fits.spectrum.lines import Cluster, Complex, fit_cluster, polynomials
from femnl.observe.response.branches import Layout
from femnl.observe.response.sweeps import collect

WIDEST = 3.0
"""Spans of the widest line."""
NARROWEST = 1e-3
"""Spacings of points of the narrowest."""
LEAST = 16
"""Points that a line needs beside the others."""


@dataclass(frozen=True)
class ModesFit:
    """Linear modes of one sweep.

    fit: parameters frequency[k], linewidth[k], quality_factor[k], amplitude[k] and phase[k], k from
    1 by rising frequency; prediction (point,) complex [V], NaN where nothing was measured.
    """

    fit: Fit
    prediction: Complex


def fit_modes(dataset: xr.Dataset, count: int, sweep: int = 0) -> ModesFit:
    """Fit a number of linear modes to one sweep, their background smooth and complex.

    V(f) = Σ_k A_k f_kw_k/(f_k² − f² + i f w_k) + a polynomial of second degree. Modes are added one
    by one where most is left, and fitted together each time.

    Args: dataset of kind `response`, with phases; count: of modes; sweep: which one.
    Returns: the ModesFit, its standard deviations scaled by √(χ²/ν).
    Raises: MeasurementError for magnitudes alone or too few points; ConvergenceError where a mode
    is not to be found.
    """
    data = collect(dataset.isel(sweep=[sweep]))
    if not data.phases:
        raise MeasurementError("response: magnitudes alone; several modes need real and imag")
    if len(data.frequency) < LEAST * count:
        raise MeasurementError(
            f"response: {len(data.frequency)} points for {count} modes; a fit needs {LEAST} a mode"
        )
    f = data.frequency
    window = (float(f[0]), float(f[-1]))
    widths = (NARROWEST * float(np.median(np.diff(f))), WIDEST * data.span)
    layout = Layout(
        float(f.mean()), data.span / 10, data.span, data.reference, 1, False, True, True, 2
    )
    lines = np.empty((0, 2))
    best: Cluster | None = None
    left = data
    for _ in range(count):
        tried = []
        for theta in linear_starts(left, layout, late=False):
            f0, w, *_ = layout.split(theta)
            start = np.vstack([lines, [f0, w]])
            tried.append(fit_cluster(f, data.voltage, data.noise, start, window, widths))
        if not tried:
            raise ConvergenceError(f"response: no start for {count} modes; fit fewer")
        best = min(tried, key=lambda one: one.chi2)
        lines = np.column_stack([best.frequency, best.linewidth])
        left = replace(data, voltage=data.voltage - best.lines(f))
    if best is None:
        raise MeasurementError("response: no mode was asked for; give at least one")
    return _result(dataset, sweep, data.notes, best)


def _result(dataset: xr.Dataset, sweep: int, notes: tuple[str, ...], best: Cluster) -> ModesFit:
    """Return the parameters by rising frequency, and the prediction at every point."""
    order = np.argsort(best.frequency)
    free = 4 * len(order) + 2 * len(best.background)
    reduced = best.chi2 / max(best.n_points - free, 1)
    factor = float(np.sqrt(reduced))
    found: dict[str, Parameter] = {}
    variances: list[float] = []
    for k, index in enumerate(order, start=1):
        f0 = float(best.frequency[index])
        w = float(best.linewidth[index])
        size = complex(best.amplitude[index])
        sd = float(best.amplitude_sd[index]) * factor
        for name, value, error, unit in (
            ("frequency", f0, float(best.frequency_sd[index]) * factor, "Hz"),
            ("linewidth", w, float(best.linewidth_sd[index]) * factor, "Hz"),
            ("amplitude", abs(size), sd, "V"),
            ("phase", float(np.angle(size)), sd / max(abs(size), 1e-300), "rad"),
        ):
            found[f"{name}[{k}]"] = Parameter(f"{name}[{k}]", value, error, unit)
            variances.append(error**2)
    covariance = np.diag(variances)
    values = np.array([one.value for one in found.values()])

    def quality(x: Complex) -> dict[str, tuple[complex, str]]:
        return {
            f"quality_factor[{k + 1}]": (complex(x[4 * k] / x[4 * k + 1]), "")
            for k in range(len(order))
        }

    f = np.asarray(dataset["frequency"].values[sweep], float)
    prediction = best.lines(f) + polynomials(f, best.window) @ best.background
    told = f"standard deviations are scaled by √(χ²/ν) = {factor:.3g}"
    fit = Fit(
        found | derived(quality, values, covariance),
        covariance,
        reduced,
        best.n_points,
        free,
        (*notes, told),
    )
    return ModesFit(fit, np.asarray(prediction))
