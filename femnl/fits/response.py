"""Fit the Duffing response to driven sweeps: f₀, Q and α_y/α_c shared, gain and phase by position, with honest uncertainties."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.optimize import least_squares, leastsq

from femnl.errors import ConvergenceError, ParameterError
from femnl.fits.covariance import covariance, strongest_correlation
from femnl.fits.response_data import Array, Sweeps, collect
from femnl.fits.response_implicit import refine
from femnl.fits.response_misfit import Misfit, Use, usable
from femnl.fits.response_model import Layout
from femnl.fits.response_result import natural, parameters, vector
from femnl.fits.response_start import starts
from femnl.types.fit import Fit

Bounds = Mapping[str, tuple[float, float]]
MAX_ROUNDS, MAX_CALLS, CLOSE = 10, 80, 1e-8
# A start has led to the answer when χ² exceeds what noise makes by less than this many of its standard deviations.
GOOD = 2.0
SAME, AGREED = 1.001, 3


def fit_response(
    dataset: xr.Dataset,
    use: Use = "complex",
    *,
    nonlinear_damping: bool = False,
    bounds: Bounds | None = None,
    force_per_volt: float | None = None,
    responsivity: ArrayLike | None = None,
) -> Fit:
    """Fit all sweeps of a driven response at once with shared f₀, w, α_y/α_c and delay, and y_max and φ for each position.

    y(f) = V/drive = y_max (w/2) e^{iφ − 2πi(f − f₀)τ} / (f₀ (1 + ⅜ α_y |y|²) − f + i w/2 (1 + d |y/y_max|²)). In y, α_y grows with the
    square of the drive; it is quoted, as α_y/α_c and d are, at the strongest drive.

    Args:
        dataset: of kind `response`; first harmonics are fitted.
        use: `complex`, `magnitude`, `phase`, or `phase-mod-pi` where a nonlinear readout may turn the sign of the signal.
        nonlinear_damping: whether to fit d as well (0 otherwise).
        bounds: (low, high) by parameter name, SI.
        force_per_volt: 𝓕/drive [m s⁻² V⁻¹]; gives α in m⁻².
        responsivity: dV/du · ξ [V/m] for each position, in the order of rising x, then y; gives α in m⁻².

    Returns:
        Free parameters frequency, linewidth, alpha_ratio, damping_ratio, y_max, phase, delay, as far as `use` sees them; derived
        drive (the strongest), quality_factor, alpha_c and alpha_y, and with a calibration alpha and eta. With several positions, y_max,
        phase, alpha_c and alpha_y carry [position].

    Raises:
        MeasurementError: data that cannot be fitted.
        ParameterError: an argument that means nothing.
        ConvergenceError: no start led to a minimum.
    Valid: w ≪ f₀; noise normal and equal in both quadratures; one mode; readout linear, or `phase-mod-pi`.
    Source: arXiv:2502.19191, S2; the published factor of α is corrected by (4π²)².
    """
    if use not in get_args(Use):
        raise ParameterError(f"use = {use!r}: give one of {', '.join(get_args(Use))}")
    if force_per_volt is not None and responsivity is not None:
        raise ParameterError("force_per_volt and responsivity both calibrate the amplitude: give one of them")
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
    derived = parameters(sweeps, layout, theta, found, force_per_volt=force_per_volt, responsivity=responsivity)
    notes = [*sweeps.notes, *blind, *_jump_notes(misfit, theta)]
    notes += [sentence for sentence in [strongest_correlation(found, names)] if sentence]
    return Fit(derived, found, chi2 / max(n_points - layout.size, 1), n_points, layout.size, tuple(notes))


def predict_response(fit: Fit, dataset: xr.Dataset) -> xr.DataArray:
    """Return the complex voltage (sweep, point) [V] of a fit at the points of a dataset, NaN where nothing was fitted.

    States are chosen as in the fit: by the data of each sweep. A missing y_max is taken as 1 V/V, a missing phase as 0.
    """
    whole = collect(dataset)
    places = max(1, sum(name.startswith(("y_max[", "phase[")) for name in fit.parameters))
    if whole.n_positions not in (places, places / 2):
        raise ParameterError(f"dataset: {whole.n_positions} positions, but the fit has another number; give the dataset that was fitted")
    whole = replace(whole, drive=whole.drive * whole.reference / fit["drive"], reference=fit["drive"])
    centre, width, damping = fit["frequency"], fit["linewidth"], "damping_ratio" in fit.parameters
    layout = Layout(centre, width, whole.span, fit["drive"], whole.n_positions, damping, gain=True, phase=True)
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


def solve(sweeps: Sweeps, layout: Layout, use: Use, bounds: Bounds) -> tuple[Misfit, Array]:
    """Minimise the misfit from each start until one leaves only noise; return the best misfit, with its states, and θ."""
    low, high = _limits(layout, bounds)
    n_points = len(sweeps.frequency) * (2 if use == "complex" else 1)
    noisy = n_points + GOOD * np.sqrt(2 * n_points)
    best: tuple[float, Misfit, Array] | None = None
    reached: list[float] = []
    for start in _all_starts(sweeps, layout, use):
        misfit = Misfit.of(sweeps, layout, use)
        candidates = [start, refine(sweeps, layout, start)] if use == "complex" else [start]
        theta = min((np.clip(candidate, low, high) for candidate in candidates), key=misfit.cost)
        # The continuation past a fold helps a fit across it; without one, the first pass has done it all.
        reached.append(np.inf)
        for strict, again in ((True, False), (False, False), (True, True)):
            tried = replace(misfit, strict=strict, last=None)
            found = _settle(tried, best[2] if best and again else theta, low, high)
            cost = tried.cost(found)
            reached[-1] = min(reached[-1], cost)
            if best is None or cost < best[0]:
                best = cost, tried, found
            if not tried.folded:
                break
        # A model that does not describe the data never reaches the noise; then starts that agree tell that there is no better.
        if best and (best[0] < noisy or np.count_nonzero(np.array(reached) < SAME * best[0]) >= AGREED):
            break
    if best is None:
        raise ConvergenceError(f"use = {use!r}: the points show no resonance to start from; choose another range or use='complex'")
    return best[1], best[2]


def _all_starts(sweeps: Sweeps, layout: Layout, use: Use) -> Iterator[Array]:
    """Yield starts; for a magnitude or a phase, what both quadratures say at a glance comes first, and what they say in full last.

    Where the readout is linear, that is the answer; where it is not, it does no harm.
    """
    if use == "complex":
        yield from starts(sweeps, use, layout)
        return
    full = replace(layout, gain=True, phase=True)

    def shared(theta: Array) -> Array:
        parts: list[Array | list[float]] = [
            theta[: full.gains.start],
            theta[full.gains] if layout.gain else [],
            theta[full.phases.start :] if layout.phase else [],
        ]
        return np.concatenate(parts)

    glance, free = Misfit.of(sweeps, full, "complex"), np.full(full.size, np.inf)
    for first in islice(starts(sweeps, "complex", full), 1):
        yield shared(_settle(glance, refine(sweeps, full, first), -free, free))
    yield from starts(sweeps, use, layout)
    yield shared(solve(sweeps, full, "complex", {})[1])


def _settle(misfit: Misfit, theta: Array, low: Array, high: Array) -> Array:
    """Minimise and choose the states in turn, until the choice stands."""
    misfit.assign(theta)
    for _ in range(MAX_ROUNDS):
        theta = _descend(misfit, theta, low, high)
        if not misfit.assign(theta):
            break
    return theta


def _descend(misfit: Misfit, theta: Array, low: Array, high: Array) -> Array:
    """Minimise with the states fixed."""
    if np.isinf(low).all() and np.isinf(high).all():
        slopes: Callable[[Array], Array] = misfit.jacobian
        found, *_ = leastsq(misfit.residual, theta, Dfun=slopes, full_output=True, ftol=CLOSE, xtol=CLOSE, gtol=CLOSE, maxfev=MAX_CALLS)
        return np.asarray(found)
    margin = 1e-9 * np.minimum(high - low, 1.0)
    start = np.clip(theta, low + margin, high - margin)
    limits = (low, high)
    result = least_squares(
        misfit.residual, start, misfit.jacobian, limits, xtol=CLOSE, ftol=CLOSE, gtol=CLOSE, x_scale="jac", max_nfev=MAX_CALLS
    )
    return np.asarray(result.x)


def _layout(sweeps: Sweeps, use: Use, damping: bool) -> Layout:
    """Centre and scale the parameters on the data."""
    centre = float(np.mean(sweeps.frequency))
    gain, phase = not use.startswith("phase"), use != "magnitude"
    return Layout(centre, sweeps.span / 10, sweeps.span, sweeps.reference, sweeps.n_positions, damping, gain, phase)


def _limits(layout: Layout, bounds: Bounds) -> tuple[Array, Array]:
    """Turn bounds by name in SI into bounds of θ."""
    names, _, _ = natural(layout, np.zeros(layout.size))
    low, high = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    if layout.damping:
        low[3] = 0.0
    for name, pair in bounds.items():
        if name not in names or not pair[0] < pair[1]:
            raise ParameterError(f"bounds[{name!r}] = {pair}: give (low, high) for one of {', '.join(names)}")
        k = names.index(name)
        low[k], high[k] = (layout.theta_of(k, value) for value in pair)
    return low, high


def _jump_notes(misfit: Misfit, theta: Array) -> Sequence[str]:
    """Say how many points lie past the fold of their branch, where no such state exists."""
    _, both = misfit.real_state(theta)
    past = int(np.count_nonzero(both.pair[misfit.high, np.arange(len(misfit.high))]))
    return [f"{past} points lie on a branch just past the fold where it ends"] if past else []
