"""How a model is fitted with one more effect: from every place that promises much, over jumps, and again beside later ones."""

from collections.abc import Iterable

import numpy as np

from femnl.core.effect import Effect
from femnl.core.readout import Array
from femnl.diagnose.adequacy import Look, looks
from femnl.diagnose.global_starts import centres, scan
from femnl.diagnose.least_squares import Solution, fit, improve
from femnl.observe.model import Extended, scale_of

SHAPES, ALIKE = 4, 0.98
"""Trial shapes of an effect that are starts of its fit, and the square of the cosine from which on two are the same to the data."""
ROUGH, FAR = 4, 8
"""Evaluations by which starts are ranked: where they differ in what a scan moved, and where in the shape of an effect or from afar."""
SAME = 1e-9
"""Relative difference of χ² up to which two starts predict the same."""
ABSURD = 10.0
"""Times what a set leaves of χ² from which on it is not worth a fit with a part of the model in another's place."""
REFINED = 2
"""Starts that are fitted to the end, the best by then."""
FEW, MOSTLY = 0.01, 0.3
"""Part of the residuals that hold this part of the excess of χ² where a fit stopped at a jump: points on the wrong side of it."""
KICKS = (-0.03, -0.01, -0.003, -0.001, 0.001, 0.003, 0.01, 0.03)
"""Relative changes of what moves a jump by which such a fit is led over it."""
PARTS = np.geomspace(1 / 200, 1, 120)
"""Parts of their range at which parameters that move data of their own are sought."""
SEED, STEPS_BACK = 1e-4, 12
"""Least part of its range at which the fit of a strength starts, and how often a start is brought nearer to zero, by a third."""


def extended(solution: Solution, effect: Effect, shapes: list[dict[str, float]]) -> Solution:
    """Fit with one more effect, from where looks point or as far towards that as is no worse than without it."""
    base, earlier = solution.model.split(solution.vector)
    model = Extended(solution.model.problem, (*solution.model.effects, effect))
    limits = {knob.name: knob.high * scale_of(model.problem, knob) for knob in effect.parameters if knob.strength}
    starts, elsewhere = [], []
    for values in shapes:
        # What is of second order shows no slope at zero; a small start lets it grow.
        start = values | {name: np.copysign(max(abs(values[name]), SEED * high), values[name]) for name, high in limits.items()}
        for _ in range(STEPS_BACK):
            vector = model.pack(base, [*earlier, start])
            if np.sum(model.residuals(vector) ** 2) <= solution.chi2:
                break
            start = start | {name: start[name] / 3 for name in limits}
        starts.append(vector)
        left = np.sum(model.residuals(vector) ** 2)
        others = [model.pack(other, [*earlier, start]) for other in model.problem.alike(base)]
        # What the effects do not change leads nowhere else.
        elsewhere += [other for other in others if abs(np.sum(model.residuals(other) ** 2) - left) > SAME * left]
    if model.problem.rugged and len(effect.parameters) == 1:  # whose ray is short; tangents at zero may lead into a trap beside it
        far = scan(solution, effect)[0]
        elsewhere.append(model.pack(far.base, [*earlier, far.values]))
    # What predicts alike is not told apart by a few evaluations.
    return min([*_finished(model, starts, solution, FAR), *(fit(model, start, near=solution) for start in elsewhere)], key=lambda s: s.chi2)


def replaced(solution: Solution, effect: Effect) -> Solution | None:
    """Fit with an effect that has no strength, from the places all over its priors where it leaves least, unless absurdly much."""
    base, earlier = solution.model.split(solution.vector)
    model = Extended(solution.model.problem, (*solution.model.effects, effect))
    lowest: list[Array] = []
    for other in (base, *model.problem.alike(base)):
        starts = [model.pack(other, [*earlier, v]) for v in centres(model.problem, effect)]
        left = np.pad([np.sum(model.residuals(start) ** 2) for start in starts], 1, constant_values=np.inf)
        lowest += [starts[i] for i in np.flatnonzero((left[1:-1] <= left[:-2]) & (left[1:-1] < left[2:]))]
    rough = sorted((improve(model, start, ROUGH, solution) for start in lowest), key=lambda found: found[0])
    if rough[0][0] > ABSURD * solution.chi2:
        return None
    return min((fit(model, vector, near=solution) for _, vector in rough[:REFINED]), key=lambda s: s.chi2)


def sought_beyond(solution: Solution) -> Solution | None:
    """Fit from beyond the jumps of the data, and from where parameters that move data of their own suit these best."""
    return min([*_over_jumps(solution), *_from_all_over(solution)], key=lambda s: s.chi2, default=None)


def sought_again(solution: Solution, k: int) -> Solution | None:
    """Seek effect k anew beside the others: an earlier one was found without the latest, and tangents may have led astray."""
    model, effect = solution.model, solution.model.effects[k]
    base, values = model.split(solution.vector)
    shaped = effect is not model.effects[-1] and not all(knob.strength for knob in effect.parameters)
    if not (model.problem.rugged or shaped):
        return None
    others = [i for i in range(len(values)) if i != k]
    without = Extended(model.problem, tuple(model.effects[i] for i in others))
    rest = fit(without, without.pack(base, [values[i] for i in others]), near=solution)
    start, kept = without.split(rest.vector)
    found: list[Solution] = []
    if shaped:
        mine = [look for look in looks(rest, [effect]) if look.effect is not None and look.gain > 0]
        ranked = sorted(mine, key=lambda look: -look.gain)
        found += _finished(model, (model.pack(start, [*kept[:k], look.values, *kept[k:]]) for look in unlike(ranked)), solution, FAR)
    if model.problem.rugged:
        found += _finished(model, (model.pack(s.base, [*kept[:k], s.values, *kept[k:]]) for s in scan(rest, effect)), solution)
    return min(found, key=lambda s: s.chi2, default=None)


def unlike(found: list[Look]) -> list[Look]:
    """Return the best looks of one effect that do not all point the same way, as mirror images and neighbours do."""
    kept: list[Look] = []
    for look in found:
        if all(look.whole != other.whole or np.sum((look.basis @ other.basis.T) ** 2) < ALIKE * len(look.basis) for other in kept):
            kept.append(look)
        if len(kept) == SHAPES:
            break
    return kept


def _finished(model: Extended, starts: Iterable[Array], near: Solution, most: int = ROUGH) -> list[Solution]:
    """Fit to the end from every start, or where there are many, from what the best come to after a few evaluations."""
    chosen = list(starts)
    if len(chosen) > REFINED:
        rough = sorted((improve(model, start, most, near) for start in chosen), key=lambda found: found[0])
        chosen = [vector for _, vector in rough[:REFINED]]
    return [fit(model, start, near=near) for start in chosen]


def _over_jumps(solution: Solution) -> list[Solution]:
    """Fit from beyond the jumps of the data, where few points leave most of what is left."""
    largest = np.sort(solution.residuals**2)[::-1][: max(1, int(FEW * len(solution.residuals)))]
    if np.sum(largest) < MOSTLY * (solution.chi2 - solution.degrees):
        return []
    base, values = solution.model.split(solution.vector)
    starts = [base | {name: base[name] * (1 + kick)} for name in solution.model.problem.jumps for kick in KICKS]
    return _finished(solution.model, (solution.model.pack(start, values) for start in starts), solution)


def _from_all_over(solution: Solution) -> list[Solution]:
    """Fit from where parameters that move data of their own suit these best, sought over all their range, angles turned by half or not.

    Without the effects each of them may have come to rest in a valley of its own, as the amplitude at a step of a trace whose harmonics
    are worn down: a small one looks much like a large one, and no tangent leads from the one to the other.
    """
    model, problem = solution.model, solution.model.problem
    places = {knob.name: i for i, (owner, knob) in enumerate(model.knobs) if owner == "base"}
    lanes = [lane for group in problem.apart if len(group) > 1 for lane in group.items()]
    mine = [(places[name], mask) for name, mask in lanes if name in places]
    if not mine or any(effect.across for effect in model.effects):
        return []
    low, high = model.bounds
    angle = np.array([knob.unit == "rad" for _, knob in model.knobs])
    moved, masks = np.array([i for i, _ in mine]), np.stack([mask for _, mask in mine])
    swept, turned = moved[~angle[moved]], moved[angle[moved]]
    start, least = solution.vector.copy(), masks @ solution.residuals**2
    for part in PARTS:
        for turn in (0.0, np.pi):
            trial = solution.vector.copy()
            trial[swept] = low[swept] + part * (high - low)[swept]
            trial[turned] += np.where(trial[turned] + turn <= high[turned], turn, -turn)
            left = masks @ model.residuals(trial) ** 2
            better = left < least
            start[moved[better]], least = trial[moved[better]], np.minimum(left, least)
    return [] if np.array_equal(start, solution.vector) else [fit(model, start, near=solution)]
