"""Numbers that are normal for every scale of a hierarchy, with the weights of the scales."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from femnl.chip.values import Array

LOG2PI = float(np.log(2 * np.pi))
TINY = float(np.finfo(float).tiny)
"""In the place of a weight of 0, which a scale that is out of the question has."""


@dataclass(frozen=True)
class Mixture:
    """Normal distributions with weights, (scales, n) each, for n numbers."""

    weights: Array
    means: Array
    variances: Array

    @cached_property
    def mean(self) -> Array:
        """Mean of each number."""
        return np.asarray((self.weights * self.means).sum(axis=0))

    @cached_property
    def sd(self) -> Array:
        """Standard deviation of each number."""
        # About the mean: the difference of squares loses a spread of 1e-7 about ln f = 14
        off = self.means - self.mean
        return np.asarray(np.sqrt((self.weights * (self.variances + off**2)).sum(axis=0)))

    def log_density(self, y: Array, wider: float = 0.0) -> Array:
        """Log density at y; each normal wider by a standard deviation."""
        variance = self.variances + wider**2
        log_each = -0.5 * ((y - self.means) ** 2 / variance + np.log(variance) + LOG2PI)
        log_weights = np.log(np.maximum(self.weights, TINY))
        return np.asarray(logsumexp(log_weights + log_each, axis=0))
