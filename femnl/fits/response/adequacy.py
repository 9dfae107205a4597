"""Whether a model meets the data, and what that means for standard deviations."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from femnl.fits.response.choice import Candidate

Kind = Literal["stated", "scaled", "withheld"]
HOPELESS = 25.0
"""χ²/ν from which on residuals in a pattern are five times the noise: no scale makes errors honest.
"""
EXCESS = 3.0
"""Standard deviations of χ²/ν above 1 from which on stated noise is too small."""
MISSED = 4.0
"""χ²/ν from which on residuals in a pattern, twice the noise, are told."""
ALIKE = 0.4
"""Correlation of neighbouring residuals from which on they are no noise of another size."""
SEEN = 4.0
"""Standard deviations of that correlation, of white noise, that it must exceed as well."""


@dataclass(frozen=True)
class Errors:
    """How standard deviations are given.

    kind: as the noise states, scaled by √(χ²/ν), or withheld. factor: on them, NaN where withheld.
    notes for the report.
    """

    kind: Kind
    factor: float
    notes: tuple[str, ...]


def errors_of(best: Candidate, *, estimated: bool) -> Errors:
    """Return how the standard deviations of a fit are to be given.

    Args: estimated: whether the noise is estimated from the data.
    """
    nu = max(best.n_points - best.n_free, 1)
    reduced = best.chi2_reduced
    correlation = alike(best)
    if misses(best):
        told = (
            f"the model misses the data: χ²/ν = {reduced:.3g}, and neighbouring residuals are "
            f"alike (correlation {correlation:.2f})"
        )
        if reduced > HOPELESS:
            return Errors("withheld", np.nan, (f"{told}; no standard deviations are given",))
        # Of alike residuals only so many count: variances grow by (1 + r)/(1 − r)
        factor = float(np.sqrt(reduced * (1 + correlation) / max(1 - correlation, 0.01)))
        return Errors(
            "scaled", factor, (f"{told}; standard deviations are scaled by {factor:.3g} for both",)
        )
    if estimated or reduced > 1 + EXCESS * np.sqrt(2 / nu):
        why = "the noise is estimated from the data" if estimated else "it is more than 1"
        told = f"standard deviations are scaled by √(χ²/ν) = {np.sqrt(reduced):.3g}, as {why}"
        return Errors("scaled", float(np.sqrt(reduced)), (told,))
    return Errors("stated", 1.0, ())


def misses(best: Candidate) -> bool:
    """Whether residuals are larger than the noise and form a pattern along the sweeps.

    Larger residuals that are white are noise of another size than stated or estimated.
    """
    correlation = alike(best)
    white = 1 / np.sqrt(max(best.n_points, 1))
    pattern = correlation > max(ALIKE, SEEN * white)
    return best.chi2_reduced > MISSED and pattern


def alike(best: Candidate) -> float:
    """Return the correlation of residuals of neighbouring points, over all sweeps."""
    residual = best.misfit.residual(best.theta)
    n = len(best.misfit.sweeps.frequency)
    parts = residual[: len(residual) // n * n].reshape(-1, n)
    together = 0.0
    power = 0.0
    for span in best.misfit.sweeps.spans:
        here = parts[:, span]
        together += float(np.sum(here[:, 1:] * here[:, :-1]))
        power += float(np.sum(here[:, 1:] ** 2 + here[:, :-1] ** 2) / 2)
    return together / power if power else 0.0
