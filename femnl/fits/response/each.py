"""One fit a sweep, as a series of frequency and quality factor."""

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from femnl.core.errors import MeasurementError
from femnl.core.kinds import CONTROLS
from femnl.fits.response.fit import fit_response
from femnl.fits.response.result import ResponseFit
from femnl.io.measurement import controls, series, varies
from femnl.observe.response.sweeps import first_harmonics


def fit_each_sweep(
    dataset: xr.Dataset, fit: Callable[[xr.Dataset], ResponseFit] = fit_response
) -> tuple[tuple[ResponseFit, ...], xr.Dataset]:
    """Fit every sweep of a `response` on its own, and gather the results in a `series`.

    Sweeps of higher harmonics are left out.

    Args: dataset of kind `response`; fit: what fits one sweep, `fit_response` or a `partial` of it.
    Returns: one fit a sweep, in their order; Dataset of kind `series` with frequency and
    quality_factor and their standard deviations (NaN where a fit gives none), against those
    control variables (drive, time, temperature, …) that differ between the sweeps.
    Raises: MeasurementError for fewer than two sweeps, or where no control variable differs.
    """
    dataset = dataset.isel(sweep=first_harmonics(dataset)[0])
    count = dataset.sizes["sweep"]
    if count < 2:
        raise MeasurementError(
            "response: has one sweep, and a series needs two; fit it without --each-sweep"
        )
    varied = _varied(dataset)
    fits = tuple(fit(dataset.isel(sweep=[row])) for row in range(count))
    data: dict[str, list[float]] = {}
    for name in ("frequency", "quality_factor"):
        found = [one.parameters[name] for one in fits]
        data[name] = [parameter.value for parameter in found]
        data[f"{name}_sd"] = [_given(parameter.sd) for parameter in found]
    return fits, series({name: dataset[name].values for name in varied}, **data, units=varied)


def _given(sd: float) -> float:
    """Return a standard deviation, NaN where it is withheld or its parameter was held."""
    return sd if np.isfinite(sd) and sd > 0 else float("nan")


def _varied(dataset: xr.Dataset) -> Mapping[str, str]:
    """Return the units of the control variables that differ between the sweeps."""
    found = {
        name: unit or "1"
        for name, unit in controls(dataset).items()
        if varies(dataset, name) and np.isfinite(dataset[name].values).all()
    }
    if not found:
        raise MeasurementError(
            f"response: no control variable differs between the sweeps; a series needs one of "
            f"{', '.join(CONTROLS)}, or another with its unit, one value a sweep"
        )
    return found
