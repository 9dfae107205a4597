"""How a model is fitted with one more effect.

From every place that promises much, and again beside later ones.
"""

from collections.abc import Mapping

import numpy as np

from femnl.core.effect import Effect
from femnl.core.readout import Array
from femnl.diagnose.best_starts import FAR, REFINED, ROUGH, finished
from femnl.diagnose.global_starts import centres, scan
from femnl.diagnose.part_of_data import best_in_all, in_part
from femnl.diagnose.score_tests import score_tests, tangents_mislead, unlike
from femnl.fits.least_squares import FitResult, fit, improve
from femnl.observe.extended import ExtendedModel
from femnl.observe.model import scale_of

SAME = 1e-9
"""Relative difference of χ² up to which two starts predict the same."""
ABSURD = 10.0
"""Times what a set leaves of χ² from which on it is not worth a fit with a part of the model in
another's place.
"""
FEW_PARAMETERS = 3
"""Parameters, but for whole numbers, up to which an effect is sought by rays wherever tangents
mislead.
"""
MUCH = 2.0
"""χ² per degree of freedom from which on an effect is fitted with its other whole numbers, too."""
GROWTH = 1.5
"""Factor by which blocks that are fitted become more."""
AT_END = 1e-3
"""Part of its range from a bound at which an angle is at it."""
SEED = 1e-4
STEPS_BACK = 12
"""Least part of its range at which the fit of a strength starts, and how often a start is brought
nearer to zero, by a third.
"""


def extended(whole: FitResult, effect: Effect, shapes: list[dict[str, float]]) -> list[FitResult]:
    """Fit a part of the data with one more effect, from where score tests point.

    A start goes as far towards that as is no worse than without the effect. Where data are few, the
    part is all of them; else `best_in_all` goes on.
    """
    result = in_part(whole)
    _, earlier = result.model.split(result.vector)
    model = ExtendedModel(result.model.base_model, (*result.model.effects, effect))
    starts = []
    elsewhere = []
    for values in shapes:
        vector, start = _no_worse(model, result, effect, values)
        starts.append(vector)
        left = float(np.sum(model.residuals(vector) ** 2))
        elsewhere += _from_equivalents(model, result, start, left)
    if model.base_model.needs_global_search and len(effect.parameters) == 1:
        # whose ray is short; tangents at zero may lead into a trap beside it
        far = scan(result, effect)[0]
        elsewhere.append(model.pack(far.base, [*earlier, far.values]))
    elif tangents_mislead(result) and _continuous(effect) <= FEW_PARAMETERS:
        far_starts = scan(result, effect)[:REFINED]
        starts += [model.pack(far.base, [*earlier, far.values]) for far in far_starts]
    # A few evaluations do not separate what predicts alike.
    found = [
        *finished(model, starts, result, FAR),
        *(fit(model, start, near=result) for start in elsewhere),
    ]
    return [*found, *_of_other_numbers(model, result, found, starts)]


def _of_other_numbers(
    model: ExtendedModel, result: FitResult, found: list[FitResult], starts: list[Array]
) -> list[FitResult]:
    """Fit from the first start of every whole number that no fit has, where all leave much.

    As which mode is the partner: no fit leads from one to the next, and the right one may be slow
    to gain where the base model is far off. There are none beside other causes.
    """
    whole = [i for i, (_, spec) in enumerate(model.parameters) if spec.whole]
    much = all(one.chi2 > MUCH * one.degrees for one in found)
    if not whole or not much or not tangents_mislead(result):
        return []
    known = {tuple(np.rint(one.vector[whole])) for one in found}
    others = []
    for start in starts:
        number = tuple(np.rint(start[whole]))
        if number not in known:
            known.add(number)
            others.append(fit(model, start, near=result))
    return others


def seekable_elsewhere(result: FitResult, library: list[Effect]) -> list[Effect]:
    """Return the effects that `extended_elsewhere` fits: those that rays are enough to seek.

    There are none where tangents do not mislead, or where the model knows no place far away.
    """
    base, _ = result.model.split(result.vector)
    if not tangents_mislead(result) or not result.model.base_model.far_from(base):
        return []
    return [e for e in library if e.has_strength and _continuous(e) <= FEW_PARAMETERS]


def extended_elsewhere(result: FitResult, effect: Effect) -> FitResult:
    """Fit with one more effect from base parameters far from the solution without it."""
    part = in_part(result)
    base, earlier = part.model.split(part.vector)
    model = ExtendedModel(part.model.base_model, (*part.model.effects, effect))
    starts = []
    for other in model.base_model.far_from(base):
        there = fit(part.model, part.model.pack(other, earlier), most=1, near=part)
        starts += [
            model.pack(far.base, [*earlier, far.values]) for far in scan(there, effect)[:REFINED]
        ]
    return best_in_all(finished(model, starts, part, FAR), result)


def followed(result: FitResult, effect: Effect) -> FitResult | None:
    """Fit with one more effect to the first block, then to ever more, each from the last end.

    So a mode that drifts far is followed from sweep to sweep, from a solution that something hides.
    There is none where blocks have no order.
    """
    order = result.model.base_model.order_of_blocks
    base, earlier = result.model.split(result.vector)
    model = ExtendedModel(result.model.base_model, (*result.model.effects, effect))
    none = {spec.name: 0.0 for spec in effect.parameters}
    found = []
    for hidden in model.base_model.equivalent_solutions(base) if len(order) else []:
        vector = model.pack(hidden, [*earlier, none])
        count = 0
        while count < len(order):
            count = max(count + 1, int(GROWTH * count))
            blocks = model.base_model.blocks
            keep = (blocks < 0) | np.isin(blocks, order[:count])
            vector = _turned_over(fit(model, vector, keep, near=result))
        found.append(fit(model, vector, near=result))
    return min(found, key=lambda one: one.chi2, default=None)


def _turned_over(result: FitResult) -> Array:
    """Return the parameters; an angle that ended at one bound is moved by 2π to the other."""
    low, high = result.model.bounds
    part = result.model.part_of_range(result.vector)
    turns = np.isclose(high - low, 2 * np.pi) & (np.minimum(part, 1 - part) < AT_END)
    return np.where(turns, np.where(part < 0.5, high, low), result.vector)


def _no_worse(
    model: ExtendedModel, result: FitResult, effect: Effect, values: Mapping[str, float]
) -> tuple[Array, dict[str, float]]:
    """Return a start that leaves no more χ² than without the effect, and the effect's values there.

    Its strengths are brought nearer to zero from `values`. Where `STEPS_BACK` thirds are not
    enough, the values are one step nearer than the start.
    """
    base, earlier = result.model.split(result.vector)
    # On the side of zero where it starts
    largest = {
        spec.name: (spec.high if values[spec.name] >= 0 else -spec.low)
        * scale_of(model.base_model, spec)
        for spec in effect.parameters
        if spec.strength
    }
    # What is of second order shows no slope at zero; a small start lets it grow.
    start = {
        **values,
        **{
            name: float(np.copysign(max(abs(values[name]), SEED * high), values[name]))
            for name, high in largest.items()
        },
    }
    for _ in range(STEPS_BACK):
        vector = model.pack(base, [*earlier, start])
        if np.sum(model.residuals(vector) ** 2) <= result.chi2:
            break
        start = start | {name: start[name] / 3 for name in largest}
    return vector, start


def _from_equivalents(
    model: ExtendedModel, result: FitResult, start: Mapping[str, float], left: float
) -> list[Array]:
    """Return the starts from equivalent solutions of the base model that predict something else.

    What the effects do not change leads nowhere else. Args: left: χ² at the start from the base
    model's own solution.
    """
    base, earlier = result.model.split(result.vector)
    others = [
        model.pack(other, [*earlier, start])
        for other in model.base_model.equivalent_solutions(base)
    ]
    return [
        other for other in others if abs(np.sum(model.residuals(other) ** 2) - left) > SAME * left
    ]


def replaced(whole: FitResult, effect: Effect) -> list[FitResult]:
    """Fit a part of the data with an effect without a strength, from all over its priors.

    There is none where all starts leave absurdly much.
    """
    result = in_part(whole)
    base, earlier = result.model.split(result.vector)
    model = ExtendedModel(result.model.base_model, (*result.model.effects, effect))
    lowest: list[Array] = []
    for other in (base, *model.base_model.equivalent_solutions(base)):
        starts = [model.pack(other, [*earlier, v]) for v in centres(model.base_model, effect)]
        left = np.pad(
            [np.sum(model.residuals(start) ** 2) for start in starts], 1, constant_values=np.inf
        )
        lowest += [
            starts[i] for i in np.flatnonzero((left[1:-1] <= left[:-2]) & (left[1:-1] < left[2:]))
        ]
    rough = sorted(
        (improve(model, start, ROUGH, result) for start in lowest), key=lambda found: found[0]
    )
    if rough[0][0] > ABSURD * result.chi2:
        return []
    return [fit(model, vector, near=result) for _, vector in rough[:REFINED]]


def sought_again(result: FitResult, k: int) -> FitResult | None:
    """Seek effect k anew beside the others.

    An earlier one was found without the latest, and tangents may have led astray.
    """
    found = _sought_again(in_part(result), k)
    return best_in_all(found, result) if found else None


def _sought_again(result: FitResult, k: int) -> list[FitResult]:
    """Return the fits of `sought_again`."""
    model = result.model
    effect = result.model.effects[k]
    base, values = model.split(result.vector)
    shaped = effect is not model.effects[-1] and not all(
        spec.strength for spec in effect.parameters
    )
    if not (model.base_model.needs_global_search or shaped):
        return []
    others = [i for i in range(len(values)) if i != k]
    without = ExtendedModel(model.base_model, tuple(model.effects[i] for i in others))
    rest = fit(without, without.pack(base, [values[i] for i in others]), near=result)
    start, kept = without.split(rest.vector)
    found: list[FitResult] = []
    if shaped:
        mine = [
            test
            for test in score_tests(rest, [effect])
            if test.effect is not None and test.gain > 0
        ]
        ranked = sorted(mine, key=lambda test: -test.gain)
        found += finished(
            model,
            (model.pack(start, [*kept[:k], test.values, *kept[k:]]) for test in unlike(ranked)),
            result,
            FAR,
        )
    if model.base_model.needs_global_search:
        found += finished(
            model,
            (model.pack(s.base, [*kept[:k], s.values, *kept[k:]]) for s in scan(rest, effect)),
            result,
        )
    return found


def _continuous(effect: Effect) -> int:
    """Return how many parameters of an effect are no whole numbers."""
    return sum(not spec.whole for spec in effect.parameters)
