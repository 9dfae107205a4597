"""Fits to the end from the most promising of several starts."""

from collections.abc import Iterable

from femnl.core.readout import Array
from femnl.fits.least_squares import FitResult, fit, improve
from femnl.observe.extended import ExtendedModel

ROUGH = 4
FAR = 8
"""Evaluations by which starts are ranked: where they differ in what a scan moved, and where in the
shape of an effect or from afar.
"""
REFINED = 2
PROMISING = 2.0
"""Starts that are fitted to the end, the best by then, and what they may leave of χ² over what the
best of them does.
"""


def finished(
    model: ExtendedModel, starts: Iterable[Array], near: FitResult, most: int = ROUGH
) -> list[FitResult]:
    """Fit to the end from every start, or from the most promising ones where there are many.

    Args: most: evaluations that a start gets before the most promising are chosen; near: a solution
    whose tangents tell what steps suit the parameters.
    """
    chosen = list(starts)
    if len(chosen) > REFINED:
        rough = sorted(
            (improve(model, start, most, near) for start in chosen), key=lambda found: found[0]
        )
        worth = [vector for chi2, vector in rough if chi2 <= PROMISING * rough[0][0]]
        chosen = worth[:REFINED]
    return [fit(model, start, near=near) for start in chosen]
