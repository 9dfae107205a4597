"""How far inexact equations of causes may have moved the values that were fitted."""

import numpy as np

from femnl.core.portions import portions
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate
from femnl.diagnose.distortions import Distortions
from femnl.diagnose.done_by import changed_by, effects_of


def equation_sd(best: Candidate, base: Candidate) -> Array:
    """Return standard deviations (p,) of fitted values by the accuracy of the causes' equations.

    Where an equation misses the data by d, a linear fit moves by C Jᵀd, with the covariance C and
    the Jacobian J. Each cause may miss the data by a part of what it changes of them, the same part
    everywhere, and by the ways in which that part may vary (`Distortions`). All of them are
    independent and have the stated accuracy of the equation as their standard deviation. More data
    do not lower these errors.

    Args: best: a fitted set of causes. base: the base model, which has none and gets zeros.
    """
    result = best.result
    variance = np.zeros(result.vector.size)
    for effect in effects_of(best):
        changed = changed_by(best, base, effect)
        ways = Distortions(changed, result.model.base_model)
        pull = sum(
            result.slopes[at].T @ np.concatenate([changed[at, None], ways.of(at)], axis=1)
            for at in portions(len(changed))
        )
        moved = effect.accuracy * (result.covariance @ pull)
        variance += np.sum(moved**2, axis=1)
    return np.sqrt(variance)
