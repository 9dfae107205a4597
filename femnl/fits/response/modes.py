"""Several linear modes in the span of a sweep, on a common background."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

from femnl.core.errors import ConvergenceError, MeasurementError
from femnl.core.fit import Fit, Parameter
from femnl.fits.covariance import derived
from femnl.fits.held import Held, hold_fixed
from femnl.fits.response.linear import linear_starts
from femnl.fits.spectrum.lines import (
    Cluster,
    Complex,
    derivatives,
    fit_cluster,
    line,
    polynomials,
)
from femnl.observe.response.sweeps import Array, Sweeps, collect
from femnl.observe.response.theta import Layout

WIDEST = 3.0
"""Spans of the widest line."""
NARROWEST = 1e-3
"""Spacings of points of the narrowest."""
UNITS = {"frequency": "Hz", "linewidth": "Hz", "amplitude": "V", "phase": "rad"}
"""Parameters of each mode with their units."""
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


def fit_modes(
    dataset: xr.Dataset,
    count: int,
    sweep: int = 0,
    fixed: Mapping[str, float] | None = None,
) -> ModesFit:
    """Fit a number of linear modes to one sweep, their background smooth and complex.

    V(f) = Σ_k A_k f_kw_k/(f_k² − f² + i f w_k) + a polynomial of second degree. Modes are added one
    by one where most is left, and fitted together each time.

    Args: dataset of kind `response`, with phases; count: of modes; sweep: which one; fixed: values
    by parameter name, SI, which are held: the modes are found with all free, then the rest is
    fitted once more.
    Returns: the ModesFit, its standard deviations scaled by √(χ²/ν).
    Raises: MeasurementError for magnitudes alone or too few points; ConvergenceError where a mode
    is not to be found; ParameterError for a name in `fixed` that the fit does not have.
    """
    held = hold_fixed(_names(count), fixed, f"{count} modes")
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
    if not held.free.all():
        return _held_fit(dataset, sweep, data, best, held)
    return _result(dataset, data, best)


def _names(count: int) -> list[str]:
    return [f"{name}[{k}]" for k in range(1, count + 1) for name in UNITS]


@dataclass(frozen=True)
class _LineSum:
    """Lines on a polynomial background, as a function of all parameters x (k,) of a fit.

    x: frequency, linewidth, height and phase of each of `n_lines` lines, then the real and the
    imaginary parts of the background's coefficients. basis (n, c): polynomials at the points.
    """

    data: Sweeps
    basis: Array
    n_lines: int

    def rows(self, x: Array) -> Array:
        """Return the parameters of the lines, one row a line."""
        return x[: self.n_lines * len(UNITS)].reshape(-1, len(UNITS))

    def voltage(self, x: Array) -> tuple[Complex, Complex]:
        """Return V (n,) and its derivatives (n, k)."""
        f = self.data.frequency
        real, imag = x[self.n_lines * len(UNITS) :].reshape(2, -1)
        total = np.asarray(self.basis @ (real + 1j * imag), dtype=complex)
        slopes = []
        for f0, w, height, phase in self.rows(x):
            turn = height * np.exp(1j * phase)
            shape = line(f, f0, w)
            total = total + turn * shape
            by_frequency, by_width = derivatives(f, f0, w)
            slopes += [turn * by_frequency, turn * by_width]
            slopes += [np.exp(1j * phase) * shape, 1j * turn * shape]
        return total, np.asarray(np.column_stack([*slopes, self.basis, 1j * self.basis]))

    def residuals(self, x: Array) -> Array:
        """Return (V − data)/noise (2n,), real parts first."""
        away = (self.voltage(x)[0] - self.data.voltage) / self.data.noise
        return np.concatenate([away.real, away.imag])

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives (2n, k) of the residuals."""
        slopes = self.voltage(x)[1] / self.data.noise
        return np.vstack([slopes.real, slopes.imag])

    def unit(self, x: Array) -> Array:
        """Return a step of each parameter (k,) that would matter."""
        high = float(np.abs(self.data.voltage).max())
        steps = [[w, w, abs(height) or high, 1.0] for _, w, height, _ in self.rows(x)]
        n_background = len(x) - self.n_lines * len(UNITS)
        return np.concatenate([np.ravel(steps), np.full(n_background, high)])


def _held_fit(dataset: xr.Dataset, sweep: int, data: Sweeps, best: Cluster, held: Held) -> ModesFit:
    """Return the fit with some parameters held, which starts from that with all free."""
    order = np.argsort(best.frequency)
    size = best.amplitude[order]
    columns = (best.frequency[order], best.linewidth[order], np.abs(size), np.angle(size))
    background = np.concatenate([best.background.real, best.background.imag])
    start = np.concatenate([held.put(np.column_stack(columns).ravel()), background])
    names = (*held.names, *(f"background {k}" for k in range(len(background))))
    held_of_all = Held(names, np.concatenate([held.values, np.full(len(background), np.nan)]))
    lines = _LineSum(data, polynomials(data.frequency, best.window), len(order))
    residuals, jacobian = held_of_all.of_free(lines.residuals, lines.jacobian)
    found = least_squares(
        residuals,
        start[held_of_all.free],
        jacobian,
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
    )
    x = held_of_all.whole(found.x)
    n_free = int(np.count_nonzero(held_of_all.free))
    reduced = float(2 * found.cost) / max(2 * data.frequency.size - n_free, 1)
    spread, blind = held_of_all.covariance(lines.jacobian(x), lines.unit(x))
    count = len(held.names)
    spread = spread[:count, :count] * reduced
    sd = np.sqrt(np.diag(spread))
    own = {
        name: Parameter(name, float(value), float(error), UNITS[name.partition("[")[0]])
        for name, value, error in zip(held.names, x[:count], sd, strict=True)
    }
    told = f"standard deviations are scaled by √(χ²/ν) = {np.sqrt(reduced):.3g}"
    fit = Fit(
        held.ordered(own) | derived(_qualities, x[:count], spread),
        held.inner(spread),
        reduced,
        2 * data.frequency.size,
        n_free,
        (*data.notes, *held.notes, *blind, told),
    )
    prediction = np.full(dataset["frequency"].shape[1], np.nan + 0j)
    prediction[data.column] = lines.voltage(x)[0]
    return ModesFit(fit, prediction)


def _qualities(x: Complex) -> dict[str, tuple[complex, str]]:
    """Return the quality factor of each mode from its frequency and width."""
    rows = x.reshape(-1, len(UNITS))
    return {f"quality_factor[{k}]": (complex(f / w), "") for k, (f, w, *_) in enumerate(rows, 1)}


def _result(dataset: xr.Dataset, data: Sweeps, best: Cluster) -> ModesFit:
    """Return the parameters by rising frequency, and the prediction at every measured point."""
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
    f = data.frequency
    prediction = np.full(dataset["frequency"].shape[1], np.nan + 0j)
    prediction[data.column] = best.lines(f) + polynomials(f, best.window) @ best.background
    told = f"standard deviations are scaled by √(χ²/ν) = {factor:.3g}"
    fit = Fit(
        found | derived(_qualities, values, covariance),
        covariance,
        reduced,
        best.n_points,
        free,
        (*data.notes, told),
    )
    return ModesFit(fit, prediction)
