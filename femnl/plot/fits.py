"""A fit beside its data, by the kind of the data."""

import xarray as xr
from matplotlib.figure import Figure

from femnl.core.errors import ParameterError
from femnl.core.fit import Fit
from femnl.fits.response.fit import predict_response
from femnl.fits.response.result import ResponseFit
from femnl.plot.decays import ringdown_figure
from femnl.plot.response import response_figure


def fit_figure(fit: Fit, data: xr.Dataset) -> Figure:
    """Draw a fit of a driven response or of a free decay.

    Args: fit: from `fit_response`, or from `fit_ringdown` of a voltage; data: what was fitted.
    Returns: the Figure. Raises: ParameterError for a fit or data of another kind.
    """
    kind = data.attrs.get("kind")
    if kind == "response" and isinstance(fit, ResponseFit):
        return response_figure(data, predict_response(fit, data), fit.use)
    if kind == "trace" and "decay_rate" in fit.parameters and data.sizes["step"] == 1:
        return ringdown_figure(data["time"].values, data["voltage"].values[0], fit)
    raise ParameterError(
        f"data of kind {kind!r}: a fit of a response or of a decay in one step is drawn with the "
        "data that it was made to; femnl.plot has the other figures"
    )
