"""Fit the Duffing response to driven sweeps.

F₀, Q and α_y/α_c shared, gain and phase by position, with honest uncertainties.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from femnl.core.choices import Use
from femnl.core.errors import ParameterError
from femnl.core.fit import Fit
from femnl.fits.covariance import covariance, strongest_correlation
from femnl.fits.response.misfit import Misfit, usable
from femnl.fits.response.result import natural, parameters, vector
from femnl.fits.response.solve import Bounds, solve
from femnl.observe.response.branches import Layout
from femnl.observe.response.sweeps import Array, Sweeps, collect


def fit_response(
    dataset: xr.Dataset,
    use: Use = "complex",
    *,
    nonlinear_damping: bool = False,
    bounds: Bounds | None = None,
    force_per_volt: float | None = None,
    responsivity: ArrayLike | None = None,
) -> Fit:
    """Fit all sweeps of a driven response at once.

    f₀, w, α_y/α_c and delay are shared; y_max and φ belong to each position.

    y(f) = V/drive = y_max (w/2) e^{iφ − 2πi(f − f₀)τ} / (f₀ (1 + ⅜ α_y |y|²) − f + i w/2 (1 + d
    |y/y_max|²)). In y, α_y grows with the square of the drive; it is quoted, as α_y/α_c and d are,
    at the strongest drive.

    Args:
        dataset: of kind `response`; first harmonics are fitted.
        use: `complex`, `magnitude`, `phase`, or `phase-mod-pi` where a nonlinear readout may turn
            the sign of the signal.
        nonlinear_damping: whether to fit d as well (0 otherwise).
        bounds: (low, high) by parameter name, SI.
        force_per_volt: 𝓕/drive [m s⁻² V⁻¹]; gives α in m⁻².
        responsivity: dV/du · ξ [V/m] for each position, in the order of rising x, then y; gives α
            in m⁻².

    Returns:
        Free parameters frequency, linewidth, alpha_ratio, damping_ratio, y_max, phase, delay, as
        far as `use` sees them; derived drive (the strongest), quality_factor, alpha_c and alpha_y,
        and with a calibration alpha and eta. With several positions, y_max, phase, alpha_c and
        alpha_y carry [position].

    Raises:
        MeasurementError: data that cannot be fitted.
        ParameterError: an argument that means nothing.
        ConvergenceError: no start led to a minimum.
    Valid: w ≪ f₀; noise normal and equal in both quadratures; one mode; readout linear, or
    `phase-mod-pi`.
    Source: arXiv:2502.19191, S2; the published factor of α is corrected by (4π²)².
    """
    if use not in get_args(Use):
        raise ParameterError(f"use = {use!r}: give one of {', '.join(get_args(Use))}")
    if force_per_volt is not None and responsivity is not None:
        raise ParameterError(
            "force_per_volt and responsivity both calibrate the amplitude: give one of them"
        )
    whole = collect(dataset)
    sweeps = whole.keep(usable(whole, use), "points too weak to have a phase left out")
    layout = _layout(sweeps, use, nonlinear_damping)
    misfit, theta = solve(sweeps, layout, use, bounds or {})
    chi2 = float(np.sum(misfit.residual(theta) ** 2))
    slopes = misfit.jacobian(theta, cautious=True)
    names, _, scale = natural(layout, theta)
    found, blind = covariance(slopes, names, np.ones(layout.size))
    found = found * np.outer(scale, scale)
    n_points = len(slopes)
    derived = parameters(
        sweeps, layout, theta, found, force_per_volt=force_per_volt, responsivity=responsivity
    )
    notes = [*sweeps.notes, *blind, *_fold_notes(misfit, theta)]
    notes += [sentence for sentence in [strongest_correlation(found, names)] if sentence]
    return Fit(
        derived, found, chi2 / max(n_points - layout.size, 1), n_points, layout.size, tuple(notes)
    )


def predict_response(fit: Fit, dataset: xr.Dataset) -> xr.DataArray:
    """Return the complex voltage (sweep, point) [V] of a fit at the points of a dataset.

    NaN where nothing was fitted.

    States are chosen as in the fit: by the data of each sweep. A missing y_max is taken as 1 V/V, a
    missing phase as 0.
    """
    whole = collect(dataset)
    places = max(1, sum(name.startswith(("y_max[", "phase[")) for name in fit.parameters))
    if whole.n_positions not in (places, places / 2):
        raise ParameterError(
            f"dataset: {whole.n_positions} positions, but the fit has another number; give the "
            "dataset that was fitted"
        )
    whole = replace(
        whole, drive=whole.drive * whole.reference / fit["drive"], reference=fit["drive"]
    )
    centre = fit["frequency"]
    width = fit["linewidth"]
    damping = "damping_ratio" in fit.parameters
    layout = Layout(
        centre, width, whole.span, fit["drive"], whole.n_positions, damping, gain=True, phase=True
    )
    theta = vector(layout, fit)
    use: Use = "complex"
    if not any(name.startswith("y_max") for name in fit.parameters):
        use = "phase-mod-pi"
    elif "delay" not in fit.parameters:
        use = "magnitude"
    misfit = Misfit.of(whole, layout, use)
    misfit.assign(theta)
    voltage, _ = misfit.real_state(theta)
    out = np.full(dataset["real"].shape, np.nan + 0j)
    out[whole.row, whole.column] = voltage
    return xr.DataArray(out, dims=("sweep", "point"), attrs={"units": "V"})


def _layout(sweeps: Sweeps, use: Use, damping: bool) -> Layout:
    """Centre and scale the parameters on the data."""
    centre = float(np.mean(sweeps.frequency))
    gain = not use.startswith("phase")
    phase = use != "magnitude"
    return Layout(
        centre,
        sweeps.span / 10,
        sweeps.span,
        sweeps.reference,
        sweeps.n_positions,
        damping,
        gain,
        phase,
    )


def _fold_notes(misfit: Misfit, theta: Array) -> Sequence[str]:
    past = misfit.past_fold(theta)
    return [f"{past} points lie on a branch just past the fold where it ends"] if past else []
