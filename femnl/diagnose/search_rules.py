"""When a search for causes goes on, and with what."""

from collections.abc import Callable, Iterable

import numpy as np

from femnl.core.effect import Effect
from femnl.diagnose.candidate import Candidate, Names
from femnl.diagnose.rivals import EVEN
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.fits.least_squares import FitResult
from femnl.observe.extended import ExtendedModel


def worth_extending(grown: dict[Names, Candidate], size: int) -> list[Candidate]:
    """Return the likeliest sets, and single causes that leave about as little as the best."""
    ranked = sorted(grown.values(), key=lambda c: -c.weight)
    near = THRESHOLDS.peer_ratio * _excess(ranked[0]) if ranked else 0.0
    return [
        c for i, c in enumerate(ranked) if i < THRESHOLDS.beam or (size == 0 and _excess(c) < near)
    ]


def tangents_tell(base: Candidate, single: Iterable[Candidate]) -> bool:
    """Whether every cause takes up of the base model's χ² what its score test promised.

    The data are then so near to the base model that causes add up, and what two do together is
    promised by score tests beside one of them.
    """
    if base.result.model.base_model.needs_global_search:
        return False
    promised = {pointer.effect.name: pointer.gain for pointer in base.pointers or ()}
    pairs = [
        (base.result.chi2 - c.result.chi2, promised[c.names[0]])
        for c in single
        if len(c.names) == 1 and c.names[0] in promised
    ]
    few = THRESHOLDS.least_taken
    return bool(pairs) and all(gain / 2 - few <= found <= 2 * gain + few for found, gain in pairs)


def takes_nothing(candidate: Candidate, base: Candidate) -> bool:
    """Whether a cause takes no more of χ² than chance."""
    return base.result.chi2 - candidate.result.chi2 < THRESHOLDS.least_taken


def spoils(candidate: Candidate, base: Candidate) -> bool:
    """Whether a cause that takes the place of part of the base model leaves more than it."""
    return candidate.result.chi2 - base.result.chi2 > THRESHOLDS.least_taken


def points_farther(candidate: Candidate, base: Candidate) -> bool:
    """Whether a cause promises more beside a set than beside the base model.

    Args: both with pointers from the same data.
    """
    alone = {pointer.effect.name: pointer.gain for pointer in base.pointers or ()}
    return any(
        pointer.gain > alone.get(pointer.effect.name, 0.0) + THRESHOLDS.least_taken
        for pointer in candidate.pointers or ()
    )


def outweighed(candidate: Candidate, found: list[Candidate]) -> bool:
    """Whether fewer of a set's causes are likelier beyond even odds, so that it is never named."""
    names = set(candidate.names)
    return any(set(one.names) < names and one.weight - candidate.weight > EVEN for one in found[1:])


def falls_short(candidate: Candidate, base: Candidate) -> bool:
    """Whether a set explains nearly all that the base model leaves, and may explain it all."""
    return not candidate.viable and _excess(candidate) < (
        THRESHOLDS.nearly_explained * _excess(base)
    )


def saturates(result: FitResult, effect: Effect) -> bool:
    """Whether a set with one more effect has as many parameters as data, and is not worth a fit.

    A cause alone is tried all the same, since readers look for it.
    """
    model = result.model
    more = ExtendedModel(model.base_model, (*model.effects, effect))
    return bool(model.effects) and len(more.parameters) >= len(result.residuals)


def leaves_other_noise(
    grown: dict[Names, Candidate],
    base: Candidate,
    other_noise: Callable[[Candidate], float | None],
) -> bool:
    """Whether the best cause takes up most of the deviation, and leaves noise not yet known.

    The deviation counts beyond the noise that is left: beside one that is stated too small, a weak
    cause takes up little of χ².
    """
    if not grown:
        return False
    best = min(grown.values(), key=lambda c: c.result.chi2)
    factor = other_noise(best)
    if factor is None:
        return False
    return _excess(best, factor) < THRESHOLDS.mostly_explained * _excess(base, factor)


def takes_up_nearly_all(grown: dict[Names, Candidate], base: Candidate) -> bool:
    """Whether a set leaves too little of the excess χ² for better starts of fits to gain any."""
    least = min((_excess(c) for c in grown.values()), default=np.inf)
    return least < THRESHOLDS.little_left * _excess(base)


def needs_global_search(found: list[Candidate]) -> bool:
    """Whether effects act by jumps, so that each is sought all over its range in any case."""
    return found[0].result.model.base_model.needs_global_search


def settled(grown: dict[Names, Candidate]) -> bool:
    """Whether a set explains the data beyond doubt."""
    return any(
        candidate.viable and candidate.p_value >= THRESHOLDS.set_doubtful
        for candidate in grown.values()
    )


def may_leave_larger_noise(candidate: Candidate) -> bool:
    """Whether a single cause leaves no more than noise may be where no neighbours tell it."""
    tells = candidate.result.model.base_model.tells_noise
    return len(candidate.names) == 1 and not tells and candidate.factor <= THRESHOLDS.largest_factor


def _excess(candidate: Candidate, factor: float = 1.0) -> float:
    """Return χ² beyond the degrees of freedom, under noise larger by a factor."""
    return max(candidate.result.chi2 / factor**2 - candidate.result.degrees, 0.0)
