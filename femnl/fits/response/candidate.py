"""One model of a response as fitted, and how well it meets the data."""

from dataclasses import dataclass

import numpy as np

from femnl.fits.response.limits import Limits
from femnl.fits.response.misfit import Misfit
from femnl.fits.response.variant import Variant
from femnl.observe.response.sweeps import Array

MISSED = 4.0
"""χ²/ν from which on residuals in a pattern, twice the noise, are told."""
ALIKE = 0.4
"""Correlation of neighbouring residuals from which on they are no noise of another size."""
SEEN = 4.0
"""Standard deviations of that correlation, of white noise, that it must exceed as well."""


@dataclass(frozen=True)
class Candidate:
    """One model fitted: its misfit with the states it chose, θ, its limits, and χ²."""

    variant: Variant
    misfit: Misfit
    theta: Array
    limits: Limits
    chi2: float
    n_points: int

    @property
    def n_free(self) -> int:
        """How many parameters were fitted."""
        return int(np.count_nonzero(self.limits.free))

    @property
    def chi2_reduced(self) -> float:
        """χ²/ν."""
        return self.chi2 / max(self.n_points - self.n_free, 1)

    @property
    def alike(self) -> float:
        """The correlation of residuals of neighbouring points, over all sweeps."""
        residual = self.misfit.residual(self.theta)
        n = len(self.misfit.sweeps.frequency)
        parts = residual[: len(residual) // n * n].reshape(-1, n)
        together = 0.0
        power = 0.0
        for span in self.misfit.sweeps.spans:
            here = parts[:, span]
            together += float(np.sum(here[:, 1:] * here[:, :-1]))
            power += float(np.sum(here[:, 1:] ** 2 + here[:, :-1] ** 2) / 2)
        return together / power if power else 0.0

    @property
    def misses(self) -> bool:
        """Whether residuals are larger than the noise and form a pattern along the sweeps.

        Larger residuals that are white are noise of another size than stated or estimated.
        """
        if self.chi2_reduced < MISSED:
            return False
        return self.alike > max(ALIKE, SEEN / float(np.sqrt(max(self.n_points, 1))))

    @property
    def effective(self) -> float:
        """Return χ²/ν divided by the share of residuals that are independent.

        Of n residuals with a correlation r from one to the next, n(1 − r)/(1 + r) are independent.
        """
        if not self.misses:
            return self.chi2_reduced
        correlation = self.alike
        return self.chi2_reduced * (1 + correlation) / max(1 - correlation, 0.01)

    def criterion(self, scale: float) -> float:
        """Return χ²/s² + k ln n."""
        return self.chi2 / scale + self.n_free * float(np.log(self.n_points))
