"""Fit the film to a spectrum.

The speed of waves in it, and by how much the ratios of modes leave the simulated ones.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from femnl.core.device import Film
from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import Fit, Parameter
from femnl.core.spectrum import Array, Assignment, FilmFit
from femnl.fits.held import said, unknown
from femnl.fits.spectrum.assignment import assign, need_few_lines

UNITS = {"scale": "", "wave_speed": "m/s", "stress": "Pa", "scatter": ""}
"""Parameters of a film with their units."""
MARGIN = 0.02
"""Of frequency: by so much beyond its lines a spectrum without labels is taken to have been swept.
"""


def fit_film(
    dataset: xr.Dataset,
    labels: Sequence[str | None],
    simulated: ArrayLike,
    film: Film,
    fixed: Mapping[str, float] | None = None,
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
        fixed: values by name, SI, which are held: scatter, and one of scale, wave_speed and stress,
            which are one parameter.

    Returns: the FilmFit.
    Raises: MeasurementError where no line has a simulated mode; ParameterError for a name in
    `fixed` that the fit does not have, or two of the three.
    Valid: bending small, so that all frequencies go as √σ; one film.
    Source of s: R. C. Paule and J. Mandel, J. Res. Natl. Bur. Stand. 87, 377 (1982).
    """
    scale_held, scatter_held = _held(fixed or {}, film)
    f = dataset["frequency"].values
    sd = dataset["frequency_sd"].values
    g = np.asarray(simulated, dtype=float)
    known = [str(label or f"mode {number}") for number, label in enumerate(labels, start=1)]
    assignment: Assignment | None = None
    if _labelled(dataset):
        plain = {name.strip("()"): index for index, name in enumerate(known)}
        words = [str(label).strip("()").replace("-", "−") for label in dataset["label"].values]
        mode = [plain.get(word) for word in words]
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
            "spectrum: none of its lines has a simulated mode; check the labels, of the "
            "form m,n, or ask for another --geometry"
        )
    kept.sort(key=lambda pair: float(f[pair[0]]))
    lines, modes = (np.array(column, dtype=int) for column in zip(*kept, strict=True))
    shift = np.log(f[lines] / g[modes])
    own = np.nan_to_num(sd[lines] / f[lines])
    centre = None if scale_held is None else float(np.log(scale_held))
    scatter = _scatter(shift, own, centre) if scatter_held is None else scatter_held
    log_scale, error = _mean(shift, own**2 + scatter**2)
    stated = np.maximum(own, 1e-12)
    middle = _mean(shift, stated**2)[0]
    if centre is not None:
        log_scale, error, middle = centre, 0.0, centre
    chi2 = float(np.sum((shift - middle) ** 2 / stated**2))
    scale = float(np.exp(log_scale))
    n_free = 1 if centre is None else 0
    degrees = max(len(lines) - n_free, 1)
    speed = scale * float(np.sqrt(film.stress / film.density))
    named = (
        ("scale", scale, 1),
        ("wave_speed", speed, 1),
        ("stress", scale**2 * film.stress, 2),
    )
    parameters = {
        name: Parameter(name, value, value * power * error, UNITS[name])
        for name, value, power in named
    }
    scatter_sd = scatter / np.sqrt(2 * degrees) if scatter_held is None else 0.0
    parameters["scatter"] = Parameter("scatter", scatter, scatter_sd, "")
    left = f"{len(mode) - len(kept)} lines without a simulated mode left out"
    notes = (
        f"the ratios of modes leave the simulated ones by {scatter:.2g} of the frequency beyond "
        "the errors of measurement"
        if scatter > 0
        else "the ratios of modes are the simulated ones within the errors of measurement",
        "σ, ρ and size enter through c alone: the stress holds for the density and the size of "
        "the geometry",
        *([said(tuple(fixed))] if fixed else []),
        *([left] if len(mode) > len(kept) else []),
    )
    covariance = np.full((n_free, n_free), (scale * error) ** 2)
    fit = Fit(parameters, covariance, chi2 / degrees, len(lines), n_free, notes)
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


def _held(fixed: Mapping[str, float], film: Film) -> tuple[float | None, float | None]:
    """Return the scale and the scatter that are held, None where free."""
    speed = float(np.sqrt(film.stress / film.density))
    scales = {
        "scale": lambda value: value,
        "wave_speed": lambda value: value / speed,
        "stress": lambda value: float(np.sqrt(value / film.stress)),
    }
    for name, value in fixed.items():
        if name not in UNITS:
            raise ParameterError(unknown(name, tuple(UNITS), "a film"))
        least = "0 or more" if name == "scatter" else "positive"
        if not np.isfinite(value) or value < 0 or (value == 0 and name != "scatter"):
            raise ParameterError(f"fixed: {name} = {value:g}: must be {least}")
    given = [name for name in scales if name in fixed]
    if len(given) > 1:
        raise ParameterError(
            f"fixed: {' and '.join(given)} are one parameter of a film; hold one of them"
        )
    scale = scales[given[0]](fixed[given[0]]) if given else None
    return scale, fixed.get("scatter")


def need_assignable(dataset: xr.Dataset) -> None:
    """Refuse a spectrum of more lines than can be assigned, before modes are solved for it.

    Raises: MeasurementError.
    """
    if not _labelled(dataset):
        need_few_lines(int(np.isfinite(dataset["frequency"].values).sum()))


def _labelled(dataset: xr.Dataset) -> bool:
    """Whether lines say which modes they are."""
    return "label" in dataset.coords and any(str(label) for label in dataset["label"].values)


def _mean(values: Array, variance: Array) -> tuple[float, float]:
    """Return the weighted mean and its standard deviation."""
    weight = 1 / np.maximum(variance, 1e-30)
    return float(np.sum(weight * values) / np.sum(weight)), float(np.sum(weight) ** -0.5)


def _scatter(shift: Array, own: Array, held: float | None) -> float:
    """Return the s for which Σ (x − mean)²/(σ² + s²) = n − 1, or n where the mean is held.

    It is 0 where the sum falls short already at s = 0.
    """
    degrees = len(shift) - (1 if held is None else 0)

    def excess(s: float) -> float:
        variance = np.maximum(own**2 + s**2, 1e-30)
        middle = _mean(shift, variance)[0] if held is None else held
        return float(np.sum((shift - middle) ** 2 / variance)) - degrees

    top = float(np.ptp(shift))
    if held is not None:
        top = float(np.sqrt(len(shift)) * np.abs(shift - held).max())
    return (
        0.0
        if degrees < 1 or excess(0.0) <= 0
        else float(brentq(excess, 0.0, max(top, 1e-15), xtol=1e-12))
    )
