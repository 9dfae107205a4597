"""Fits of a model as it is, begun in other valleys of χ² than the one where a fit came to rest."""

import numpy as np

from femnl.diagnose.best_starts import finished
from femnl.fits.least_squares import FitResult, fit

FEW = 0.01
MOSTLY = 0.3
"""Part of the residuals that hold this part of the excess of χ² where a fit stopped at a jump:
points on the wrong side of it.
"""
KICKS = (-0.03, -0.01, -0.003, -0.001, 0.001, 0.003, 0.01, 0.03)
"""Relative changes of what moves a jump by which such a fit is led over it."""
PARTS = np.geomspace(1 / 200, 1, 120)
"""Parts of their range at which parameters that move data of their own are sought."""


def sought_beyond(result: FitResult) -> FitResult | None:
    """Fit from beyond the jumps of the data, and from the best of the independent blocks."""
    return min([*_over_jumps(result), *_from_all_over(result)], key=lambda s: s.chi2, default=None)


def _over_jumps(result: FitResult) -> list[FitResult]:
    """Fit from beyond the jumps of the data, where few points leave most of what is left."""
    largest = np.sort(result.residuals**2)[::-1][: max(1, int(FEW * len(result.residuals)))]
    if np.sum(largest) < MOSTLY * (result.chi2 - result.degrees):
        return []
    base, values = result.model.split(result.vector)
    starts = [
        base | {name: base[name] * (1 + kick)}
        for name in result.model.base_model.jumps
        for kick in KICKS
    ]
    return finished(result.model, (result.model.pack(start, values) for start in starts), result)


def _from_all_over(result: FitResult) -> list[FitResult]:
    """Fit from where the parameters of independent blocks suit their data best.

    They are scanned over all their range, angles turned by half or not.

    Without the effects each of them may have come to rest in a valley of its own, as the amplitude
    at a step of a trace whose harmonics are worn down: a small one looks much like a large one, and
    no tangent leads from the one to the other.
    """
    model = result.model
    base_model = result.model.base_model
    places = {spec.name: i for i, (owner, spec) in enumerate(model.parameters) if owner == "base"}
    lanes = [
        lane for group in base_model.independent_blocks if len(group) > 1 for lane in group.items()
    ]
    mine = [(places[name], mask) for name, mask in lanes if name in places]
    if not mine or any(effect.couples_blocks for effect in model.effects):
        return []
    low, high = model.bounds
    angle = np.array([spec.unit == "rad" for _, spec in model.parameters])
    moved = np.array([i for i, _ in mine])
    masks = np.stack([mask for _, mask in mine])
    swept = moved[~angle[moved]]
    turned = moved[angle[moved]]
    start = result.vector.copy()
    least = masks @ result.residuals**2
    for part in PARTS:
        for turn in (0.0, np.pi):
            trial = result.vector.copy()
            trial[swept] = low[swept] + part * (high - low)[swept]
            trial[turned] += np.where(trial[turned] + turn <= high[turned], turn, -turn)
            left = masks @ model.residuals(trial) ** 2
            better = left < least
            start[moved[better]] = trial[moved[better]]
            least = np.minimum(left, least)
    return [] if np.array_equal(start, result.vector) else [fit(model, start, near=result)]
