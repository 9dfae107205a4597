"""How far a datum has to stand out before it is no chance."""

import numpy as np
from scipy.special import ndtr

from femnl.core.readout import Array

FAINT = 3.5
"""σ below which no datum counts as a glitch."""
RARE = 0.02
"""Data that chance puts beyond the limit, all together, where there are few glitches."""
MANY = 10
"""Times as many data beyond the limit as chance puts there, from which on they are glitches."""
MOST_GLITCHES = 0.02
"""Part of the data that may be glitches; more are no glitches, but what the model lacks."""


def outlier_limit(away: Array) -> float:
    """Return the σ beyond which data are glitches, ∞ where none are.

    So far out that chance puts hardly any datum there, or only one of `MANY` that are there.

    Args: away (n,): how far each datum stands out, in σ of normal noise.
    """
    falling = np.sort(away)[::-1]
    seen = np.arange(1, len(falling) + 1)
    chance = len(falling) * 2 * ndtr(-falling)
    glitches = (chance <= RARE) | ((chance * MANY <= seen) & (seen >= MANY))
    glitches &= falling >= FAINT
    return float(falling[glitches].min()) * (1 - 1e-12) if glitches.any() else np.inf
