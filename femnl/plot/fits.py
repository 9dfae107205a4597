"""A fit beside its data, by the kind of the data."""

import xarray as xr
from matplotlib.figure import Figure

from femnl.core.choices import Use
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
    if kind == "response" and "linewidth" in fit.parameters:
        whole = fit if isinstance(fit, ResponseFit) else _plain(fit)
        return response_figure(data, predict_response(whole, data), whole.use)
    if kind == "trace" and "decay_rate" in fit.parameters and data.sizes["step"] == 1:
        return ringdown_figure(data["time"].values, data["voltage"].values[0], fit)
    raise ParameterError(
        f"data of kind {kind!r}: a fit of a response or of a decay in one step is drawn with the "
        "data that it was made to; femnl.plot has the other figures"
    )


def _plain(fit: Fit) -> ResponseFit:
    """Return the parameters of a response alone as a fit without background.

    Phases alone do not tell whether they counted modulo π; they are drawn as if they did.
    """
    use: Use = "complex" if "delay" in fit.parameters else "magnitude"
    if not any(name.startswith("y_max") for name in fit.parameters):
        use = "phase-mod-pi"
    return ResponseFit(
        fit.parameters,
        fit.covariance,
        fit.chi2_reduced,
        fit.n_points,
        fit.n_parameters,
        fit.notes,
        use=use,
    )
