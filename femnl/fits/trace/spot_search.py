"""The search for the motion at one spot that meets the harmonics of all steps best."""

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtri

from femnl.core.errors import MeasurementError
from femnl.core.readout import Array
from femnl.fits.held import Held
from femnl.fits.trace.folding import Beyond
from femnl.fits.trace.one_step import OneStep
from femnl.fits.trace.spot_model import DEEPEST, SpotModel
from femnl.optics.unit_fringe import Orders, real_part

STEP = 0.1
"""Step of the search in z = qU, in rad."""
N_SEARCHED = 15
N_ORDERS = 8
"""Steps of the drive, and harmonics, that decide on the fringe in the search."""
FEW = 12
"""Harmonics up to which a motion is sought with the folded ones; more tell motions apart."""
CHANCE = 0.01
MISFIT = 0.5
"""A motion is sought so where chance makes a larger χ² of its step more rarely. Where no noise is
known, what is folded counts as noise, and χ² is larger than this for each datum.
"""


def all_held(fringe: Array, size: int) -> Held:
    """Return what is held of a whole vector, of which `fringe` (2,) is held where it is no NaN."""
    names = [str(k) for k in range(size)]
    return Held(tuple(names), np.concatenate([fringe, np.full(size - 2, np.nan)]))


@dataclass(frozen=True)
class SpotSearch:
    """The search for the least χ² of a model.

    held (2,): V_C and θ where they are held, NaN where free.
    """

    model: SpotModel
    held: Array

    def best(self, sharp: SpotModel) -> Array:
        """Return the minimum of χ² of a model that may be sharper than that of the search.

        Raises: MeasurementError where there is no voltage at all.
        """
        optima = sorted((self._refine(start, 10) for start in self._starts()), key=itemgetter(1))
        if not optima:
            raise MeasurementError(
                "traces: no harmonic has any voltage; nothing moves, or no light"
            )
        ends = [end for vector, _ in optima[:2] for end in self._ends(vector, sharp)]
        finish = replace(self, model=sharp)
        return min((finish._refine(end, 100) for end in ends), key=itemgetter(1))[0]

    def _refine(self, vector: Array, most: int) -> tuple[Array, float]:
        """Return the nearest minimum of χ² and χ² there, or where `most` evaluations led."""
        held = all_held(self.held, vector.size)
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

    def _ends(self, vector: Array, sharp: SpotModel) -> list[Array]:
        """Return where searching every step's motion and refining all in turn leads.

        Where harmonics are few, a second end has the motions that the folded ones ask for.
        """
        best = self._refine(vector, 100)
        for _ in range(5):
            fringe = self.model.split(best[0])[0]
            again = self._refine(self._with_motion(fringe["contrast"], fringe["fringe_phase"]), 100)
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
        large = chdtri(n_data + 1, CHANCE) if beyond.noise else MISFIT * n_data
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

    def _starts(self) -> list[Array]:
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
