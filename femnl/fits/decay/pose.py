"""Decays and the diagnosis."""

import xarray as xr

from femnl.core.errors import MeasurementError


def pose(dataset: xr.Dataset, film: object, checkpoint: object = None) -> None:
    """Refuse: no effect acts on decays yet. Raises: MeasurementError."""
    raise MeasurementError(
        "femnl diagnose does not take decays yet; femnl fit finds their quality factor"
    )
