"""Fit the film to a spectrum.

The speed of waves in it, and by how much the ratios of modes leave the simulated ones.
"""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from femnl.core.device import Film
from femnl.core.errors import MeasurementError
from femnl.core.fit import Fit, Parameter
from femnl.core.spectrum import Array, Assignment, FilmFit
from femnl.fits.spectrum.assignment import assign

MARGIN = 0.02
"""Of frequency: by so much beyond its lines a spectrum without labels is taken to have been swept.
"""


def fit_film(
    dataset: xr.Dataset, labels: Sequence[str | None], simulated: ArrayLike, film: Film
) -> FilmFit:
    """Fit f_i = c/c_sim · g_i to the lines of a spectrum.

    The simulation may scatter about them.

    ln(f_i/g_i) = ln(c/c_sim) + e_i, e_i of variance (σ_i/f_i)² + s²; s is such that χ² equals its n
    − 1 degrees of freedom, and 0 where the errors of measurement explain everything. c = √(σ/ρ) of
    the film before release, with the density of the geometry file.

    Args:
        dataset: of kind `spectrum`; lines without any label are assigned to modes first, see
            `femnl.fits.spectrum.assignment.assign`.
        labels: of the simulated modes, "(m,n)" or None.
        simulated: their frequencies g [Hz].
        film: the film that was simulated.

    Returns: the FilmFit. Raises: MeasurementError where no line has a simulated mode.
    Valid: bending small, so that all frequencies go as √σ; one film.
    Source of s: R. C. Paule and J. Mandel, J. Res. Natl. Bur. Stand. 87, 377 (1982).
    """
    f = dataset["frequency"].values
    sd = dataset["frequency_sd"].values
    g = np.asarray(simulated, dtype=float)
    known = [str(label or f"mode {number}") for number, label in enumerate(labels, start=1)]
    assignment: Assignment | None = None
    if "label" in dataset.coords and any(str(label) for label in dataset["label"].values):
        plain = {name.strip("()"): index for index, name in enumerate(known)}
        mode = [plain.get(str(label).strip("()")) for label in dataset["label"].values]
    else:
        usable = np.isfinite(f)
        f = f[usable]
        sd = sd[usable]
        assignment = assign(f, sd, known, g, ((1 - MARGIN) * f.min(), (1 + MARGIN) * f.max()))
        mode = list(assignment.best.mode)
    kept = [
        (line, index)
        for line, index in enumerate(mode)
        if index is not None and np.isfinite(f[line])
    ]
    if not kept:
        raise MeasurementError(
            "spectrum: none of its lines has a simulated mode; check the labels, or ask for "
            "another --geometry"
        )
    kept.sort(key=lambda pair: float(f[pair[0]]))
    lines, modes = (np.array(column, dtype=int) for column in zip(*kept, strict=True))
    shift = np.log(f[lines] / g[modes])
    own = np.nan_to_num(sd[lines] / f[lines])
    scatter = _scatter(shift, own)
    log_scale, error = _mean(shift, own**2 + scatter**2)
    chi2 = float(
        np.sum(
            (shift - _mean(shift, np.maximum(own, 1e-12) ** 2)[0]) ** 2
            / np.maximum(own, 1e-12) ** 2
        )
    )
    scale = float(np.exp(log_scale))
    degrees = max(len(lines) - 1, 1)
    speed = scale * float(np.sqrt(film.stress / film.density))
    named = (
        ("scale", scale, 1, ""),
        ("wave_speed", speed, 1, "m/s"),
        ("stress", scale**2 * film.stress, 2, "Pa"),
    )
    parameters = {
        name: Parameter(name, value, value * power * error, unit)
        for name, value, power, unit in named
    }
    parameters["scatter"] = Parameter("scatter", scatter, scatter / np.sqrt(2 * degrees), "")
    left = f"{len(mode) - len(kept)} lines without a simulated mode left out"
    notes = (
        f"the ratios of modes leave the simulated ones by {scatter:.2g} of the frequency beyond "
        "the errors of measurement"
        if scatter > 0
        else "the ratios of modes are the simulated ones within the errors of measurement",
        "σ, ρ and size enter through c alone: the stress holds for the density and the size of "
        "the geometry",
        *([left] if len(mode) > len(kept) else []),
    )
    fit = Fit(parameters, np.array([[(scale * error) ** 2]]), chi2 / degrees, len(lines), 1, notes)
    deviation = np.exp(shift - log_scale) - 1
    return FilmFit(
        fit,
        tuple(known[index] for index in modes),
        f[lines],
        sd[lines],
        g[modes],
        deviation,
        assignment,
    )


def _mean(values: Array, variance: Array) -> tuple[float, float]:
    """Weighted mean and its standard deviation."""
    weight = 1 / np.maximum(variance, 1e-30)
    return float(np.sum(weight * values) / np.sum(weight)), float(np.sum(weight) ** -0.5)


def _scatter(shift: Array, own: Array) -> float:
    """The s for which Σ (x − mean)²/(σ² + s²) = n − 1.

    0 where the sum falls short already without it.
    """

    def excess(s: float) -> float:
        variance = np.maximum(own**2 + s**2, 1e-30)
        return float(np.sum((shift - _mean(shift, variance)[0]) ** 2 / variance)) - (len(shift) - 1)

    top = float(np.ptp(shift))
    return (
        0.0
        if len(shift) < 2 or excess(0.0) <= 0
        else float(brentq(excess, 0.0, max(top, 1e-15), xtol=1e-12))
    )
