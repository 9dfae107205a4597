"""Residuals of several sets of parameters: one by one, and as a model takes them at once."""

import numpy as np

from femnl.core.readout import Array
from femnl.observe.extended import ExtendedModel


def alone(model: ExtendedModel, vectors: Array) -> Array:
    """Return the residuals (m, n) of vectors (m, p), one after the other."""
    return np.array([model.residuals(vector) for vector in vectors])


def together(model: ExtendedModel, vectors: Array) -> Array:
    """Return the same at once."""
    return np.array(list(model.residuals_of_each(vectors)))
