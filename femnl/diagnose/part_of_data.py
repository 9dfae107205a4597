"""Fits to a part of many data, which lead those to all of them."""

from collections.abc import Iterable

import numpy as np

from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import FitResult, covariance, fit, improve, stored
from femnl.observe.extended import ExtendedModel

ROUGH = 6
"""Evaluations after which a fit to all data must have gained what makes a cause worth a fit."""


def in_part(result: FitResult) -> FitResult:
    """Return a fit as seen by a part of its data; itself where its data are few."""
    thin = result.model.base_model.thinned
    if thin is None:
        return result
    model = ExtendedModel(thin.model, result.model.effects)
    slopes = result.jacobian[thin.at]
    low, high = model.bounds
    return FitResult(
        model,
        result.vector,
        model.residuals(result.vector),
        stored(slopes),
        covariance(slopes, high - low),
        result.checkpoint,
    )


def best_in_all(found: Iterable[FitResult], near: FitResult) -> FitResult:
    """Return a fit to all data, begun where the fit to a part of them ended that leaves them least.

    Args: found: fits of one model to the part that `in_part` gives of `near`, or to all data where
        that is `near` itself. near: a fit to all data, whose steps suit the parameters.
    """
    fits = list(found)
    if near.model.base_model.thinned is None:
        return min(fits, key=lambda one: one.chi2)
    whole = ExtendedModel(near.model.base_model, fits[0].model.effects)
    start = min(
        (one.vector for one in fits), key=lambda vector: float(np.sum(whole.residuals(vector) ** 2))
    )
    chi2, vector = improve(whole, start, ROUGH, near)
    # A cause that does hardly anything leaves valleys along which a fit creeps for long
    gains = near.chi2 - chi2 > THRESHOLDS.least_taken
    return fit(whole, vector, most=100 if gains else 1, near=near)
