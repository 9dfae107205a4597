"""Motion in metres at one spot, step by step of a drive, from the harmonics of recorded traces."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from femnl.core.errors import ParameterError
from femnl.core.fit import Fit, MotionFit, Parameter
from femnl.core.readout import Array, HarmonicSpectrum, PeriodicFringe
from femnl.fits.held import Held, unknown
from femnl.fits.trace.folding import Beyond
from femnl.fits.trace.spot_model import SpotModel
from femnl.fits.trace.spot_search import CHANCE, SpotSearch, all_held
from femnl.optics.unit_fringe import cosine, unit_fringe

FRINGE = ("contrast", "fringe_phase")
"""Parameters that all steps share."""
UNEXPLAINED = (
    "more is left of the records than the stated noise, and no motion explains it: it counts as "
    "noise"
)


def fit_spot(
    spectrum: HarmonicSpectrum,
    wavelength: float,
    fringe: PeriodicFringe | None = None,
    fixed: Mapping[str, float] | None = None,
    beyond: Beyond | None = None,
) -> MotionFit:
    """Fit the harmonics of all steps of a drive by one fringe.

    The motion is U cos(ωt + φ) at each step.

    V_n = V_C e^{inφ} Σ_k 2Re(c_k iⁿ e^{ikθ}) J_n(kqU): V_C and θ are shared, U and φ belong to a
    step. No smoothness along the steps is assumed; the offset V_0 is not used.

    Args:
        spectrum: harmonics of the traces, from `decompose`.
        wavelength: λ [m].
        fringe: f(u); one cosine unless given.
        fixed: values of `contrast` [V] or `fringe_phase` [rad], which are held.
        beyond: what higher harmonics do to these and leave of the records, from `folding.beyond`.
            Where samples are few a period, it tells which motion it is.

    Returns:
        The motion at each step, with U ≥ 0, V_C > 0 for a cosine, and θ of a symmetric fringe in
        [0, π], where they are free; fit: `contrast`, `fringe_phase`.

    Raises:
        ParameterError: fewer than two harmonics, a fringe without contrast, or a name in `fixed`
            that the fit does not have. MeasurementError: no voltage at all.

    Valid: sinusoidal motion with z below 30, and at least one step that bends the fringe (z > 1),
    else the data do not separate V_C from U, unless V_C is held.
    Source: Sommer et al. 2025, supplement S7, harmonics against drive frequency.
    """
    kept = spectrum.harmonic > 0
    if kept.sum() < 2:
        raise ParameterError(
            f"{int(kept.sum())} harmonics cannot tell motion from contrast: decompose the traces "
            "into two or more"
        )
    series = cosine(wavelength) if fringe is None else unit_fringe(fringe.fourier)
    model = SpotModel(
        series,
        spectrum.harmonic[kept],
        spectrum.values[kept],
        spectrum.values_sd[kept],
        beyond,
    )
    known = _held(fixed or {})
    sharp = model.of_known_noise()
    best = SpotSearch(model, known).best(sharp)
    if beyond is None or not beyond.noise or not _missed(sharp, best):
        return _report(sharp, known, _canonical(sharp, known, best))
    # Something else may be left of the records: then harmonics contradict what it asks for
    blurred = replace(model, beyond=replace(beyond, noise=0.0))
    other = SpotSearch(blurred, known).best(blurred)
    gained = blurred.chi2_by_step(best).sum() - blurred.chi2_by_step(other).sum()
    if gained < chdtri(blurred.n_steps, CHANCE):
        return _report(sharp, known, _canonical(sharp, known, best))
    return _report(blurred, known, _canonical(blurred, known, other), UNEXPLAINED)


def _missed(model: SpotModel, vector: Array) -> bool:
    """Whether the noise makes so large a χ² only rarely."""
    n_residuals = model.n_data + model.n_steps
    return bool(model.chi2_by_step(vector).sum() > chdtri(n_residuals, CHANCE))


def _held(fixed: Mapping[str, float]) -> Array:
    """Return V_C and θ where they are held, NaN where free."""
    found = np.full(len(FRINGE), np.nan)
    for name, value in fixed.items():
        if name not in FRINGE:
            raise ParameterError(unknown(name, FRINGE, "the motion at a spot"))
        if not np.isfinite(value) or (name == "contrast" and value == 0):
            raise ParameterError(f"fixed: {name} = {value:g}: give a finite number but 0 V")
        found[FRINGE.index(name)] = value
    return found


def _canonical(model: SpotModel, known: Array, vector: Array) -> Array:
    """Return the equal solution with U ≥ 0 and φ in (−π, π].

    V_C > 0 for a cosine, θ of a symmetric fringe in [0, π]; what is held stays.
    """
    fringe, amplitude, phase = model.split(vector)
    contrast = fringe["contrast"]
    theta = fringe["fringe_phase"]
    phase = phase + np.where(amplitude < 0, np.pi, 0.0)
    if not np.isnan(known).all():
        turned = np.pi - (np.pi - phase) % (2 * np.pi)
        return np.concatenate([[contrast, theta], np.abs(amplitude), turned])
    if model.series.coefficients.size == 2 and contrast < 0:
        contrast = -contrast
        theta = theta + np.pi
    if np.sin(theta) < 0 and np.abs(model.series.coefficients.imag).max() < 1e-9:
        theta = -theta
        phase = phase + np.pi
    angles = np.pi - (np.pi - np.concatenate([[theta], phase])) % (2 * np.pi)
    return np.concatenate([[contrast, angles[0]], np.abs(amplitude), angles[1:]])


def _report(model: SpotModel, known: Array, vector: Array, *said: str) -> MotionFit:
    """Put values, uncertainties, prediction and notes together, among them what is said already."""
    fringe, amplitude, phase = model.split(vector)
    names = [
        "contrast",
        "fringe_phase",
        *(f"amplitude at step {i}" for i in range(amplitude.size)),
    ]
    names += [f"phase at step {i}" for i in range(amplitude.size)]
    unit = np.concatenate(
        [[abs(vector[0]), 1.0], np.full(amplitude.size, 1e-9), np.ones(amplitude.size)]
    )
    held = replace(all_held(known, vector.size), names=tuple(names))
    found, notes = held.covariance(model.jacobian(vector), unit)
    if np.isnan(known[1]) and np.abs(model.series.coefficients.imag).max() < 1e-9:
        notes = (
            *notes,
            "θ and −θ are indistinguishable: the fringe is symmetric, and the other sign turns "
            "every phase of motion by π",
        )
    sd = np.sqrt(np.diag(found))
    residuals = model.residuals(vector)[: model.n_data]
    parameters = {
        name: Parameter(name, fringe[name], float(sd[i]), unit)
        for i, (name, unit) in enumerate((("contrast", "V"), ("fringe_phase", "rad")))
    }
    amplitude_sd, phase_sd = sd[2:].reshape(2, -1)
    n_free = int(np.count_nonzero(held.free))
    if not (degrees := residuals.size - n_free):
        notes = (*notes, "there are as many parameters as data, so that nothing tests the fit")
    fringe_held = Held(FRINGE, known)
    notes = (*fringe_held.notes, *notes, *said)
    return MotionFit(
        Fit(
            fringe_held.ordered(parameters),
            fringe_held.inner(found[:2, :2]),
            float(residuals @ residuals) / degrees if degrees else np.nan,
            residuals.size,
            n_free,
            notes,
        ),
        amplitude,
        amplitude_sd,
        phase,
        phase_sd,
        model.predict(vector),
        (model.values - model.predict(vector)) / model.sd,
    )
