"""Whether a model meets the data, and what that means for standard deviations."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from femnl.fits.response.candidate import Candidate

Kind = Literal["stated", "scaled", "withheld"]
HOPELESS = 25.0
"""χ²/ν from which on residuals in a pattern are five times the noise: no scale makes errors honest.
"""
EXCESS = 3.0
"""Standard deviations of χ²/ν above 1 from which on stated noise is too small."""


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
    correlation = best.alike
    if best.misses:
        told = (
            f"the model misses the data: χ²/ν = {reduced:.3g}, and neighbouring residuals are "
            f"alike (correlation {correlation:.2f})"
        )
        if reduced > HOPELESS:
            return Errors("withheld", np.nan, (f"{told}; no standard deviations are given",))
        # Of alike residuals only so many count: variances grow by (1 + r)/(1 − r)
        factor = float(np.sqrt(best.effective))
        return Errors(
            "scaled", factor, (f"{told}; standard deviations are scaled by {factor:.3g} for both",)
        )
    if estimated or reduced > 1 + EXCESS * np.sqrt(2 / nu):
        why = "the noise is estimated from the data" if estimated else "it is more than 1"
        told = f"standard deviations are scaled by √(χ²/ν) = {np.sqrt(reduced):.3g}, as {why}"
        return Errors("scaled", float(np.sqrt(reduced)), (told,))
    return Errors("stated", 1.0, ())
