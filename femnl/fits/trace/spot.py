"""Motion in metres at one spot, step by step of a drive, from the harmonics of recorded traces."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import distributions

from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import Fit, MotionFit, Parameter
from femnl.core.readout import Array, HarmonicSpectrum, PeriodicFringe
from femnl.fits.held import Held, unknown
from femnl.fits.trace.folding import Beyond
from femnl.fits.trace.one_step import OneStep
from femnl.fits.trace.spot_model import DEEPEST, SpotModel
from femnl.optics.unit_fringe import Orders, cosine, real_part, unit_fringe

STEP = 0.1
"""Step of the search in z = qU, in rad."""
N_SEARCHED = 15
N_ORDERS = 8
"""Steps of the drive, and harmonics, that decide on the fringe in the search."""
FRINGE = ("contrast", "fringe_phase")
"""Parameters that all steps share."""
FEW = 12
"""Harmonics up to which a motion is sought with the folded ones; more tell motions apart."""
CHANCE = 0.01
MISFIT = 0.5
"""A motion is sought so where chance makes a larger χ² of its step more rarely. Where no noise is
known, what is folded counts as noise, and χ² is larger than this for each datum.
"""


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
    problem = _Search(model, _held(fixed or {}))
    optima = sorted((problem.refine(start, 10) for start in problem.starts()), key=itemgetter(1))
    if not optima:
        raise MeasurementError("traces: no harmonic has any voltage; nothing moves, or no light")
    sharp = replace(problem, model=model.of_known_noise())
    ends = [end for vector, _ in optima[:2] for end in problem.ends(vector, sharp.model)]
    best = min((sharp.refine(end, 100) for end in ends), key=itemgetter(1))[0]
    return sharp.report(sharp.canonical(best))


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


@dataclass(frozen=True)
class _Search:
    """The search for the least χ² of a model.

    held (2,): V_C and θ where they are held, NaN where free.
    """

    model: SpotModel
    held: Array

    def all_held(self, vector: Array) -> Held:
        """Return what is held of the whole vector."""
        names = [str(k) for k in range(vector.size)]
        return Held(tuple(names), np.concatenate([self.held, np.full(vector.size - 2, np.nan)]))

    def refine(self, vector: Array, most: int) -> tuple[Array, float]:
        """Return the nearest minimum of χ² and χ² there, or where `most` evaluations led."""
        held = self.all_held(vector)
        residuals, jacobian = held.of_free(self.model.residuals, self.model.jacobian)
        found = least_squares(
            residuals,
            vector[held.free],
            jacobian,
            method="lm",
            x_scale="jac",
            xtol=1e-10,
            ftol=1e-12,
            gtol=1e-12,
            max_nfev=most,
        )
        return held.whole(found.x), float(2 * found.cost)

    def ends(self, vector: Array, sharp: SpotModel) -> list[Array]:
        """Return where searching every step's motion and refining all in turn leads.

        Where harmonics are few, a second end has the motions that the folded ones ask for.
        """
        best = self.refine(vector, 100)
        for _ in range(5):
            fringe = self.model.split(best[0])[0]
            again = self.refine(self._with_motion(fringe["contrast"], fringe["fringe_phase"]), 100)
            if again[1] >= best[1] * (1 - 1e-9):
                break
            best = again
        beyond = self.model.beyond
        if beyond is None or self.model.harmonic.size > FEW:
            return [best[0]]
        return [best[0], self._folded(best[0], beyond, sharp)]

    def _folded(self, vector: Array, beyond: Beyond, sharp: SpotModel) -> Array:
        """Return the parameters with motion that the folded harmonics ask for, where it misfits."""
        model = self.model
        fringe, amplitude, phase = model.split(np.array(vector))
        before = sharp.chi2_by_step(vector)
        n_data = 2 * model.harmonic.size
        large = distributions.chi2.isf(CHANCE, n_data + 1) if beyond.noise else MISFIT * n_data
        deep = self._amplitudes[model.wavenumber * self._amplitudes > model.harmonic.size / 2]
        for i in np.flatnonzero(before > large):
            # What is folded counts as noise here, or the grid would miss narrow valleys
            data = (model.harmonic, model.values[:, i], model.sd[:, i])
            step = OneStep(model.series, fringe, data, beyond, int(i))
            _, amplitude[i], phase[i] = step.best(deep)
        moved = np.concatenate([vector[:2], amplitude, phase])
        worse = sharp.chi2_by_step(moved) >= before
        kept = np.concatenate([[False, False], worse, worse])
        return np.where(kept, vector, moved)

    def starts(self) -> list[Array]:
        """Return starting points: the best few of a grid over θ and V_C.

        The motion of every step is searched at each.
        """
        symmetric = bool(np.abs(self.model.series.coefficients.imag).max() < 1e-9)
        theta = np.arange(0, np.pi if symmetric else 2 * np.pi, np.pi / 32) + np.pi / 64
        contrast = np.abs(self.model.values).max() * np.geomspace(0.6, 30, 40)
        theta, contrast = (
            tried if np.isnan(value) else np.array([value])
            for tried, value in zip((theta, contrast), self.held[::-1], strict=True)
        )
        strength = np.argsort(np.sum(np.abs(self.model.values / self.model.sd) ** 2, axis=0))
        steps = strength[
            np.unique(np.linspace(0, strength.size - 1, min(N_SEARCHED, strength.size)).astype(int))
        ]
        orders = np.arange(min(N_ORDERS, self.model.harmonic.size))
        misfit = np.zeros((theta.size, contrast.size))
        for i, angle in enumerate(theta):
            overlap, norm, _ = self._match(float(angle), steps, orders)
            left = self.model.misfit_left(float(angle), steps, self._amplitudes)
            misfit[i] = [
                np.sum(np.min(level**2 * norm - 2 * level * overlap + left(level), axis=1))
                for level in contrast
            ]
        wrapped = np.pad(misfit, ((1, 1), (1, 1)), mode="edge")
        around = np.min(
            [
                wrapped[1 + a : wrapped.shape[0] - 1 + a, 1 + b : wrapped.shape[1] - 1 + b]
                for a in (-1, 0, 1)
                for b in (-1, 0, 1)
            ],
            axis=0,
        )
        rows, columns = np.nonzero(misfit <= around)
        ranked = np.argsort(misfit[rows, columns])[:5]
        return [
            self._with_motion(float(contrast[columns[r]]), float(theta[rows[r]])) for r in ranked
        ]

    def _with_motion(self, contrast: float, theta: float) -> Array:
        """Return the parameters with the best motion of every step at the given fringe."""
        steps = np.arange(self.model.values.shape[1])
        overlap, norm, phase = self._match(theta, steps, np.arange(self.model.harmonic.size))
        left = self.model.misfit_left(theta, steps, self._amplitudes)(contrast)
        best = np.argmin(contrast**2 * norm - 2 * contrast * overlap + left, axis=1)
        return np.concatenate([[contrast, theta], self._amplitudes[best], phase[steps, best]])

    @property
    def _amplitudes(self) -> Array:
        """The amplitudes [m] that are tried."""
        return np.arange(STEP, DEEPEST, STEP) / self.model.wavenumber

    def _match(self, theta: float, steps: Orders, orders: Orders) -> tuple[Array, Array, Array]:
        """Return the largest overlap of data and unit fringe over φ for each step and z.

        The norm of the fringe and that φ come with it.
        """
        n = self.model.harmonic[orders]
        fringe = {"contrast": 1.0, "fringe_phase": theta}
        unit = real_part(self.model.series, n, self._amplitudes, fringe)["motion"].T
        weight = 1 / self.model.sd[np.ix_(orders, steps)] ** 2
        phi = np.arange(0, 2 * np.pi, np.pi / (4 * n.max()))
        turned = (weight * self.model.values[np.ix_(orders, steps)])[..., None] * np.exp(
            -1j * n[:, None, None] * phi
        )
        met = unit @ turned.real.transpose(1, 0, 2)
        return met.max(axis=2), (unit**2 @ weight).T, phi[met.argmax(axis=2)]

    def canonical(self, vector: Array) -> Array:
        """Return the equal solution with U ≥ 0 and φ in (−π, π].

        V_C > 0 for a cosine, θ of a symmetric fringe in [0, π]; what is held stays.
        """
        fringe, amplitude, phase = self.model.split(vector)
        contrast = fringe["contrast"]
        theta = fringe["fringe_phase"]
        phase = phase + np.where(amplitude < 0, np.pi, 0.0)
        if not np.isnan(self.held).all():
            turned = np.pi - (np.pi - phase) % (2 * np.pi)
            return np.concatenate([[contrast, theta], np.abs(amplitude), turned])
        if self.model.series.coefficients.size == 2 and contrast < 0:
            contrast = -contrast
            theta = theta + np.pi
        if np.sin(theta) < 0 and np.abs(self.model.series.coefficients.imag).max() < 1e-9:
            theta = -theta
            phase = phase + np.pi
        angles = np.pi - (np.pi - np.concatenate([[theta], phase])) % (2 * np.pi)
        return np.concatenate([[contrast, angles[0]], np.abs(amplitude), angles[1:]])

    def report(self, vector: Array) -> MotionFit:
        """Put values, uncertainties, prediction and notes together."""
        fringe, amplitude, phase = self.model.split(vector)
        names = [
            "contrast",
            "fringe_phase",
            *(f"amplitude at step {i}" for i in range(amplitude.size)),
        ]
        names += [f"phase at step {i}" for i in range(amplitude.size)]
        unit = np.concatenate(
            [[abs(vector[0]), 1.0], np.full(amplitude.size, 1e-9), np.ones(amplitude.size)]
        )
        held = replace(self.all_held(vector), names=tuple(names))
        found, notes = held.covariance(self.model.jacobian(vector), unit)
        if np.isnan(self.held[1]) and np.abs(self.model.series.coefficients.imag).max() < 1e-9:
            notes = (
                *notes,
                "θ and −θ are indistinguishable: the fringe is symmetric, and the other sign turns "
                "every phase of motion by π",
            )
        sd = np.sqrt(np.diag(found))
        residuals = self.model.residuals(vector)[: self.model.n_data]
        parameters = {
            name: Parameter(name, fringe[name], float(sd[i]), unit)
            for i, (name, unit) in enumerate((("contrast", "V"), ("fringe_phase", "rad")))
        }
        amplitude_sd, phase_sd = sd[2:].reshape(2, -1)
        n_free = int(np.count_nonzero(held.free))
        if not (degrees := residuals.size - n_free):
            notes = (*notes, "there are as many parameters as data, so that nothing tests the fit")
        fringe_held = Held(FRINGE, self.held)
        notes = (*fringe_held.notes, *notes)
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
            self.model.predict(vector),
            (self.model.values - self.model.predict(vector)) / self.model.sd,
        )
