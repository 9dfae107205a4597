"""Fit a law to a series: a line, a power law or an Arrhenius law."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.optimize import least_squares
from scipy.special import stdtrit

from femnl.core.choices import Law
from femnl.core.errors import MeasurementError, ParameterError
from femnl.core.fit import Fit, Parameter
from femnl.core.readout import Array
from femnl.fits.covariance import strongest_correlation
from femnl.fits.held import Held, hold_fixed, unknown
from femnl.fits.series.forms import PARAMETERS, QUANTITIES, Form, form_of, units_of
from femnl.io.measurement import controls, varies

LEAST = 3
"""Points that two parameters and their errors need."""
EXCESS = 3.0
"""Standard deviations of χ²/ν above 1 from which on stated errors are too small."""
INTERVAL = 0.95
"""Probability of an interval."""
NORMAL_WIDTH = 1.959963984540054
"""Half of the interval of a normal distribution, in standard deviations."""


@dataclass(frozen=True)
class SeriesFit:
    """A law fitted to one quantity of a series against one control variable.

    fit: its parameters. interval: the lower and upper end of the 95 % interval of each, by name.
    x, y, sd (n,): the points used, sd as scaled; line (n,): the law there; unit: of x, "" for a
    plain number.
    """

    quantity: str
    control: str
    unit: str
    law: Law
    fit: Fit
    interval: Mapping[str, tuple[float, float]]
    x: Array
    y: Array
    sd: Array
    line: Array


def fit_series(
    dataset: xr.Dataset,
    law: Law = "line",
    control: str | None = None,
    fixed: Mapping[str, float] | None = None,
) -> tuple[SeriesFit, ...]:
    """Fit a law to the frequency and the quality factor of a series.

    line: y = value + slope (x − x̄), x̄ the weighted mean of x, where the two are independent.
    power: y = value (x/x̄)^exponent, x̄ the geometric mean. arrhenius: y = prefactor exp(−E/(k_B T)).

    Args: dataset of kind `series`; law; control: the variable, by default the only one that varies;
    fixed: values by parameter name, SI, which are held, such as "slope"; where the series has both
    quantities, "slope:frequency" or "slope:quality_factor".
    Returns: one fit for each quantity that it holds. Standard deviations are scaled by √(χ²/ν)
    where the series states no errors, or scatters more than it states; 95 % intervals are those of
    Student's t with ν degrees of freedom where they are scaled. Without stated errors a line takes
    all values to be equally uncertain, and a power law or an Arrhenius law takes all relative
    values to be so: values over decades have no common error.
    Raises: MeasurementError for fewer than three points; ParameterError for a control that does not
    vary, several that do, a law that the values do not allow, or a name in `fixed` that no law has.
    """
    name = _control(dataset, law, control)
    keys = [key for key in QUANTITIES if key in dataset]
    held = _held_by_quantity(fixed or {}, keys, law)
    return tuple(_fit(dataset, key, name, law, held[key]) for key in keys)


def parameter_units(
    dataset: xr.Dataset, law: Law = "line", control: str | None = None
) -> dict[str, str]:
    """Return the unit of each parameter that `fit_series` can hold, by the name that it takes."""
    per = controls(dataset)[_control(dataset, law, control)]
    keys = [key for key in QUANTITIES if key in dataset]
    found: dict[str, str] = {}
    for key in keys:
        units = units_of(law, QUANTITIES[key], per)
        named = zip(_labels(law, key, alone=len(keys) == 1), units, strict=True)
        found |= dict(named)
    return found


def _labels(law: Law, key: str, *, alone: bool) -> list[str]:
    """Return the names by which the parameters of one quantity are held."""
    return [name if alone else f"{name}:{key}" for name in PARAMETERS[law]]


def _held_by_quantity(fixed: Mapping[str, float], keys: Sequence[str], law: Law) -> dict[str, Held]:
    """Return what is held of the law of each quantity."""
    names = PARAMETERS[law]
    labels = {key: _labels(law, key, alone=len(keys) == 1) for key in keys}
    every = [label for of_key in labels.values() for label in of_key]
    for name in fixed:
        if name not in every:
            raise ParameterError(unknown(name, every, f"a series with the law {law}"))
    return {
        key: hold_fixed(
            names,
            {
                name: fixed[label]
                for name, label in zip(names, of_key, strict=True)
                if label in fixed
            },
            f"the law {law}",
        )
        for key, of_key in labels.items()
    }


def _control(dataset: xr.Dataset, law: Law, control: str | None) -> str:
    """Return the control variable on which the law depends."""
    known = controls(dataset)
    varied = [name for name in known if varies(dataset, name)]
    suited = [name for name in varied if law != "arrhenius" or known[name] == "K"]
    if law == "arrhenius" and control is None and "temperature" in suited:
        return "temperature"
    if control is None and len(suited) == 1:
        return suited[0]
    if control not in varied:
        there = " and ".join(varied) or "nothing"
        needed = "a temperature in K" if law == "arrhenius" else "one control variable"
        raise ParameterError(
            f"series: the law {law} needs {control or needed}, and {there} "
            f"{'vary' if len(varied) > 1 else 'varies'}; choose another law, or name one that "
            "varies"
        )
    if control not in suited:
        raise ParameterError(
            f"series: the law arrhenius needs a temperature in K, and {control} is in "
            f"{known[control] or '1'}; choose another law"
        )
    return control


@dataclass(frozen=True)
class _Points:
    """The points of a series that a law is fitted to.

    x, y (n,): control variable and quantity; sd (n,): stated standard deviations of y, or weights
    by which all points count alike. stated: whether the series states them; relative: whether the
    errors of ln y are alike, else those of y.
    """

    x: Array
    y: Array
    sd: Array
    stated: bool
    relative: bool


def _points(dataset: xr.Dataset, key: str, control: str, law: Law) -> _Points:
    """Return the usable points of a quantity.

    Standard deviations are left out where too few points have one: then all points count alike.
    Raises: MeasurementError for too few points.
    """
    x = np.asarray(dataset[control].values, float)
    y = np.asarray(dataset[key].values, float)
    used = np.isfinite(x) & np.isfinite(y)
    stated = f"{key}_sd" in dataset
    if stated:
        sd = np.asarray(dataset[f"{key}_sd"].values, float)
        with_sd = used & np.isfinite(sd)
        stated = bool(np.count_nonzero(with_sd) >= LEAST or np.count_nonzero(used) < LEAST)
    if stated:
        used = with_sd
    if np.count_nonzero(used) < LEAST:
        raise MeasurementError(
            f"series: {np.count_nonzero(used)} usable points of {key}; a law needs {LEAST}"
        )
    if np.ptp(x[used]) == 0:
        raise MeasurementError(
            f"series: {key} is known at one value of {control} only; a law needs several"
        )
    relative = not stated and law != "line"
    weights = sd[used] if stated else _alike(y[used], relative=relative)
    return _Points(x[used], y[used], weights, stated, relative)


@dataclass(frozen=True)
class _Misfit:
    """Deviations of a law from the points of a series, as functions of its parameters p."""

    form: Form
    points: _Points

    def residuals(self, p: Array) -> Array:
        """Return the deviations (n,) in standard deviations.

        With equal relative errors they are y (ln y − ln f), which is linear in the logarithm of the
        value, and so without bias.
        """
        y = self.points.y
        predicted = self.form.predict(p)
        away = y * np.log(y / predicted) if self.points.relative else y - predicted
        return np.asarray(away / self.points.sd)

    def jacobian(self, p: Array) -> Array:
        """Return the derivatives (n, k) of the residuals."""
        growth = self.form.slopes(p)
        if self.points.relative:
            growth = growth * (self.points.y / self.form.predict(p))[:, None]
        return np.asarray(-growth / self.points.sd[:, None])


def _fit(dataset: xr.Dataset, key: str, control: str, law: Law, held: Held) -> SeriesFit:
    """Fit the law of one quantity."""
    points = _points(dataset, key, control, law)
    per = controls(dataset)[control]
    form = form_of(law, key, (control, per), points.x, points.y, points.sd)
    misfit = _Misfit(form, points)
    residuals, jacobian = held.of_free(misfit.residuals, misfit.jacobian)
    with np.errstate(all="ignore"):
        possible = bool(np.isfinite(residuals(form.start[held.free])).all())
    if not possible:
        raise ParameterError(
            f"series: no {law} law can have what is held ({'; '.join(held.notes)}); check value "
            "and unit"
        )
    found = least_squares(
        residuals,
        form.start[held.free],
        jacobian,
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    n_free = int(np.count_nonzero(held.free))
    best = held.whole(found.x)
    nu = len(points.x) - n_free
    reduced = float(2 * found.cost / nu)
    scaled = not points.stated or reduced > 1 + EXCESS * np.sqrt(2 / nu)
    factor = float(np.sqrt(reduced)) if scaled else 1.0
    spread, blind = held.covariance(misfit.jacobian(best), form.steps)
    spread = spread * factor**2
    size = np.sqrt(np.diag(spread))
    width = float(stdtrit(nu, 0.5 + INTERVAL / 2)) if scaled else NORMAL_WIDTH
    listed = zip(form.names, best, size, form.units, strict=True)
    parameters = held.ordered({n: Parameter(n, float(v), float(s), u) for n, v, s, u in listed})
    interval = {
        one.name: (one.value - width * one.sd, one.value + width * one.sd)
        for one in parameters.values()
    }
    told = [_scaling_note(points, factor)] if scaled else []
    correlation = strongest_correlation(spread, form.names)
    notes = (*form.notes, *held.notes, *told, *blind, *([correlation] if correlation else []))
    chi2_reduced = reduced if points.stated else 1.0
    return SeriesFit(
        key,
        control,
        per,
        law,
        Fit(parameters, held.inner(spread), chi2_reduced, len(points.x), n_free, notes),
        interval,
        points.x,
        points.y,
        points.sd * factor,
        form.predict(best),
    )


def _scaling_note(points: _Points, factor: float) -> str:
    """Say that standard deviations follow from the scatter, which is `factor` times `points.sd`."""
    if points.stated:
        return (
            f"standard deviations are scaled by √(χ²/ν) = {factor:.3g}: it scatters more than it "
            "states"
        )
    scatter = (
        f"{factor * points.sd[0] / points.y[0]:.3g} of each value"
        if points.relative
        else f"{factor * points.sd[0]:.3g}"
    )
    return f"standard deviations are those of the scatter, {scatter}: the series states no errors"


def _alike(y: Array, *, relative: bool) -> Array:
    """Return standard deviations (n,) by which all values count alike, or all relative values."""
    if relative:
        return np.abs(y)
    return np.full(len(y), float(np.std(y)) or float(np.abs(y).max()) or 1.0)
