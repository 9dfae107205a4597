"""Fit the response of a driven mode to its sweeps, at any quality factor.

F₀, Q and α_y/α_c shared, gain, phase and background by position, with honest uncertainties.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from femnl.core.choices import Background, Use
from femnl.core.errors import ParameterError
from femnl.fits.covariance import covariance, strongest_correlation
from femnl.fits.held import said
from femnl.fits.response.adequacy import Errors, errors_of
from femnl.fits.response.candidate import Candidate
from femnl.fits.response.choice import CONJUGATED, Choice, choose, turned
from femnl.fits.response.limits import Bounds
from femnl.fits.response.misfit import Misfit, usable
from femnl.fits.response.result import ResponseFit, natural, parameters, vector
from femnl.fits.response.tried import Asked
from femnl.fits.response.variant import TERMS
from femnl.observe.response.sweeps import Array, Sweeps, collect
from femnl.observe.response.theta import Layout


def fit_response(
    dataset: xr.Dataset,
    use: Use | None = None,
    *,
    background: Background | Literal["auto"] = "auto",
    duffing: bool | None = None,
    delay: bool | None = None,
    phase_sign: int | None = None,
    nonlinear_damping: bool = False,
    bounds: Bounds | None = None,
    fixed: Mapping[str, float] | None = None,
    force_per_volt: float | None = None,
    responsivity: ArrayLike | None = None,
) -> ResponseFit:
    """Fit all sweeps of a driven response at once.

    f₀, w, α_y/α_c and delay are shared; y_max, φ and the background belong to each position.

    V = drive · y_max e^{iφ} b + background, with the delay e^{−2πi(f − f₀)τ} of the resonance or of
    both, and b = 1/(Δ + a |b|² + i (f/f₀)(1 + d |b|²)), Δ = (f₀² − f²)/(f₀ w), a = (8√3/9) α_y/α_c:
    the balance of the first harmonic, whose linear part is exact. The background is C₀ + C₁(f −
    f₀), or one that grows with the drive. What is left open is chosen by evidence, see `choice`.

    Args:
        dataset: of kind `response`; first harmonics are fitted.
        use: `complex`, `magnitude`, `phase`, or `phase-mod-pi` where a nonlinear readout may turn
            the sign of the signal; by default what the file has.
        background: none, constant, slope, or auto.
        duffing: whether there is a Duffing term; None: where the evidence says so.
        delay: whether there is a delay; None: likewise.
        phase_sign: +1 for e^{+iωt}, whose phase falls through the resonance, −1 for e^{−iωt}; None:
            as the data say.
        nonlinear_damping: whether to fit d as well (0 otherwise).
        bounds: (low, high) by parameter name, SI.
        fixed: values by parameter name, SI.
        force_per_volt: 𝓕/drive [m s⁻² V⁻¹]; gives α in m⁻².
        responsivity: dV/du · ξ [V/m] for each position, in the order of rising x, then y; gives α
            in m⁻².

    Returns:
        Parameters frequency, linewidth, alpha_ratio, damping_ratio, y_max, phase, delay and
        background_real, background_imag, background_slope_real, background_slope_imag, as far as
        `use` sees them, those that are fitted first; derived drive (the strongest),
        quality_factor, alpha_c and alpha_y [V⁻²], and with a calibration alpha and eta. With
        several positions, y_max, phase, background, alpha_c and alpha_y carry [position].
        alpha_ratio is 0 with the standard deviation of the test where there is no Duffing term.
        Standard deviations are scaled by √(χ²/ν) where the noise is estimated from the data or
        exceeds what is stated; where the model misses the data they are NaN.

    Raises:
        MeasurementError: data that cannot be fitted.
        ParameterError: an argument that means nothing.
        ConvergenceError: no start led to a minimum.
    Valid: one mode of any Q ≥ 3, linear: exact; Duffing: third harmonic of the motion below 1 %,
    |α_y/α_c| ≪ 40 Q; noise normal and equal in both quadratures; readout linear, or
    `phase-mod-pi`. Magnitudes are taken as those of such noise (Rice): their mean and variance
    are, and their distribution is taken as normal.
    Source: arXiv:2502.19191, S2, beyond the rotating wave; the published factor of α is corrected
    by (4π²)².
    """
    whole = collect(dataset)
    use = use or ("complex" if whole.phases else "magnitude")
    _check(use, whole, background, force_per_volt, responsivity)
    sweeps = whole.keep(usable(whole, use), "points too weak to have a phase left out")
    asked = Asked(
        background if use in ("complex", "magnitude") else "none",
        True if nonlinear_damping else duffing,
        delay,
        phase_sign,
        bounds or {},
        fixed or {},
    )
    choice = choose(sweeps, first_layout(sweeps, use, damping=nonlinear_damping), use, asked)
    best = choice.best
    errors = errors_of(best, estimated=sweeps.estimated)
    found, sd, blind = _uncertainty(best, choice, errors)
    derived = parameters(
        sweeps,
        best.misfit.layout,
        best.theta,
        found,
        free=best.limits.free,
        sd=sd,
        force_per_volt=force_per_volt,
        responsivity=responsivity,
    )
    free = best.limits.free
    names = [name for name, kept in zip(_names(best), free, strict=True) if kept]
    inner = found[np.ix_(free, free)]
    notes = [
        *([said(tuple(fixed))] if fixed else []),
        *sweeps.notes,
        *_said(choice),
        *errors.notes,
        *blind,
        *_fold_notes(best),
    ]
    notes += [sentence for sentence in [strongest_correlation(inner, names)] if sentence]
    ordered = {name: derived[name] for name in names} | derived
    return ResponseFit(
        ordered,
        inner,
        best.chi2_reduced,
        best.n_points,
        best.n_free,
        tuple(notes),
        background=best.variant.background,
        driven=best.variant.driven,
        delayed=best.variant.delay,
        duffing=best.variant.duffing,
        phase_sign=choice.phase_sign,
        errors=errors.kind,
        use=use,
        evidence={str(one.variant): choice.gain(one) for one in choice.candidates},
    )


def predict_response(fit: ResponseFit, dataset: xr.Dataset) -> xr.DataArray:
    """Return the complex voltage (sweep, point) [V] of a fit at the points of a dataset.

    NaN where nothing was fitted.

    States are chosen as in the fit: by the data of each sweep. A missing y_max is taken as 1 V at
    the strongest drive of the fit, a missing phase as 0.
    """
    whole = turned(collect(dataset), fit.phase_sign)
    indexed = [name for name in fit.parameters if name.startswith(("y_max[", "phase["))]
    places = max(1, len({name.partition("[")[2] for name in indexed}))
    if whole.n_positions != places:
        raise ParameterError(
            f"dataset: {whole.n_positions} positions, but the fit has {places}; give the "
            "dataset that was fitted"
        )
    whole = replace(
        whole, drive=whole.drive * whole.reference / fit["drive"], reference=fit["drive"]
    )
    layout = Layout(
        fit["frequency"],
        fit["linewidth"],
        whole.span,
        fit["drive"],
        whole.n_positions,
        "damping_ratio" in fit.parameters,
        gain=True,
        phase=True,
        background=TERMS[fit.background],
        driven=fit.driven,
        delayed=fit.delayed == "all",
    )
    theta = vector(layout, fit)
    use: Use = "phase-mod-pi" if fit.use == "phase" else fit.use
    misfit = Misfit.of(whole, layout, use)
    misfit.assign(theta)
    voltage, _ = misfit.real_state(theta)
    out = np.full(dataset["frequency"].shape, np.nan + 0j)
    out[whole.row, whole.column] = voltage if fit.phase_sign > 0 else voltage.conj()
    return xr.DataArray(out, dims=("sweep", "point"), attrs={"units": "V"})


def _check(
    use: Use,
    sweeps: Sweeps,
    background: str,
    force_per_volt: float | None,
    responsivity: ArrayLike | None,
) -> None:
    """Refuse arguments that mean nothing, or not together."""
    if use not in get_args(Use):
        raise ParameterError(f"use = {use!r}: give one of {', '.join(get_args(Use))}")
    if use != "magnitude" and not sweeps.phases:
        raise ParameterError(
            f"use = {use!r}: the measurement holds magnitudes alone; use 'magnitude'"
        )
    if background not in (*get_args(Background), "auto"):
        known = ", ".join((*get_args(Background), "auto"))
        raise ParameterError(f"background = {background!r}: give one of {known}")
    if force_per_volt is not None and responsivity is not None:
        raise ParameterError(
            "force_per_volt and responsivity both calibrate the amplitude: give one of them"
        )


def _names(best: Candidate) -> list[str]:
    return natural(best.misfit.layout, best.theta)[0]


def _uncertainty(
    best: Candidate, choice: Choice, errors: Errors
) -> tuple[Array, Array, tuple[str, ...]]:
    """Return the covariance (size, size) in SI, standard deviations, and what is undetermined.

    What is held has none, but α_y/α_c where the evidence says that there is no Duffing term: it has
    that of the test, the best model with one.
    """
    free = best.limits.free
    names, _, scale = natural(best.misfit.layout, best.theta)
    slopes = best.misfit.jacobian(best.theta, cautious=True)[:, free]
    kept = [name for name, fitted in zip(names, free, strict=True) if fitted]
    inner, blind = covariance(slopes, kept, np.ones(len(kept)))
    found = np.zeros((len(names), len(names)))
    found[np.ix_(free, free)] = inner * np.outer(scale[free], scale[free]) * errors.factor**2
    sd = np.sqrt(np.diag(found))
    rival = choice.rival(duffing=True)
    if not best.variant.duffing and rival is not None and not free[2] and rival.limits.free[2]:
        tested = rival.misfit.jacobian(rival.theta, cautious=True)[:, rival.limits.free]
        size = np.ones(tested.shape[1])
        # Columns are those of what is free: f₀ and w before it may be held
        column = int(np.count_nonzero(rival.limits.free[:2]))
        spread, _ = covariance(tested, [""] * tested.shape[1], size)
        sd[2] = np.sqrt(spread[column, column]) * errors.factor
    return found, sd, blind


def _said(choice: Choice) -> list[str]:
    """Return what the evidence chose, in sentences."""
    best = choice.best
    said = [f"model chosen by evidence: {best.variant}"] if len(choice.candidates) > 1 else []
    if choice.phase_sign < 0:
        said.append(CONJUGATED)
    rival = choice.rival(duffing=not best.variant.duffing)
    if rival is not None:
        f0, w, ratio, *_ = rival.misfit.layout.split(rival.theta)
        found = f"f₀ = {f0:.9g} Hz, w = {w:.4g} Hz"
        found += f", α_y/α_c = {ratio:.3g}" if rival.variant.duffing else ""
        said.append(
            f"{'with' if rival.variant.duffing else 'without'} a Duffing term the fit has {found}, "
            f"and its criterion (BIC) is {abs(choice.gain(rival)):.3g} "
            f"{'higher' if choice.gain(rival) > 0 else 'lower'}"
        )
    return said


def first_layout(sweeps: Sweeps, use: Use, *, damping: bool = False) -> Layout:
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


def _fold_notes(best: Candidate) -> list[str]:
    past = best.misfit.past_fold(best.theta)
    if not past:
        return []
    points = "1 point lies" if past == 1 else f"{past} points lie"
    return [f"{points} on a branch just past the fold where it ends"]
