"""One fit a sweep, as a series of frequency and quality factor."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from femnl.core.errors import MeasurementError
from femnl.core.kinds import CONTROLS
from femnl.fits.response.fit import fit_response
from femnl.fits.response.result import ResponseFit
from femnl.io.measurement import series


def fit_each_sweep(
    dataset: xr.Dataset, **asked: object
) -> tuple[tuple[ResponseFit, ...], xr.Dataset]:
    """Fit every sweep of a `response` on its own, and return the fits and what they make together.

    Args: dataset of kind `response`; asked: arguments of `fit_response`, the same for each sweep.
    Returns: one fit a sweep, in their order; Dataset of kind `series` with frequency and
    quality_factor and their standard deviations (NaN where a fit gives none), against those of
    drive, time, pressure, temperature, laser_power and voltage that differ between the sweeps.
    Raises: MeasurementError for fewer than two sweeps, or where nothing tells them apart.
    """
    count = dataset.sizes["sweep"]
    if count < 2:
        raise MeasurementError(
            "response: has one sweep, and a series needs two; fit it without --each-sweep"
        )
    controls = _controls(dataset)
    fits = tuple(fit_response(dataset.isel(sweep=[row]), **asked) for row in range(count))  # type: ignore[arg-type]
    data: dict[str, list[float]] = {}
    for name in ("frequency", "quality_factor"):
        found = [fit.parameters[name] for fit in fits]
        data[name] = [one.value for one in found]
        data[f"{name}_sd"] = [
            one.sd if np.isfinite(one.sd) and one.sd > 0 else np.nan for one in found
        ]
    return fits, series(controls, **data)


def _controls(dataset: xr.Dataset) -> Mapping[str, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """Return the control variables that differ between the sweeps."""
    found = {}
    for name in CONTROLS:
        if name in dataset.coords and dataset[name].dims == ("sweep",):
            values = np.asarray(dataset[name].values, float)
            if np.isfinite(values).all() and np.ptp(values) > 0:
                found[name] = values
    if not found:
        raise MeasurementError(
            f"response: no control variable differs between the sweeps; a series needs one of "
            f"{', '.join(CONTROLS)}, one value a sweep"
        )
    return found
