"""Fits to a part of many data, which lead those to all of them."""

from collections.abc import Iterable

import numpy as np

from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import FitResult, covariance, fit, stored
from femnl.fits.tangents import jacobian_at, steps_for
from femnl.observe.extended import ExtendedModel

RULED_OUT = 10.0
"""Standard deviations of χ² beyond which no noise leaves so much."""


def in_part(result: FitResult) -> FitResult:
    """Return a fit as seen by a part of its data; itself where its data are few."""
    thin = result.model.base_model.thinned
    if thin is None:
        return result
    model = ExtendedModel(thin.model, result.model.effects)
    residuals = model.residuals(result.vector)
    slopes = result.jacobian[thin.at]
    if not np.allclose(residuals, result.residuals[thin.at]):
        # Whitened otherwise, as correlated neighbours are farther apart
        steps = steps_for(model, np.linalg.norm(slopes, axis=0))
        slopes = jacobian_at(model, result.vector, residuals, steps)
    low, high = model.bounds
    return FitResult(
        model,
        result.vector,
        residuals,
        stored(slopes),
        covariance(slopes, high - low),
        result.checkpoint,
    )


def best_in_all(found: Iterable[FitResult], near: FitResult) -> FitResult:
    """Return a fit to all data, begun where the fit to a part of them ended that leaves them least.

    Args: found: fits with the same effects to the part that `in_part` gives of `near`, or to all
        data where that is `near` itself. near: a fit to all data, whose steps suit the parameters.
    """
    fits = list(found)
    if near.model.base_model.thinned is None:
        return min(fits, key=lambda one: one.chi2)

    def in_all(one: FitResult) -> ExtendedModel:
        return ExtendedModel(near.model.base_model, one.model.effects)

    best = min(fits, key=lambda one: float(np.sum(in_all(one).residuals(one.vector) ** 2)))
    # A cause that does hardly anything leaves valleys along which a fit creeps for long, and so do
    # two that do nearly the same beside a misfit
    n = len(near.residuals)
    worth = min(near.chi2 - THRESHOLDS.least_taken, n + RULED_OUT * (2 * n) ** 0.5)
    return fit(in_all(best), best.vector, near=near, worth=worth)
