"""Pairs of causes that are found only from afar: one effect scanned globally beside another."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations
from typing import TypeVar

from femnl.core.effect import Effect
from femnl.core.readout import Array
from femnl.diagnose.best_starts import FAR, REFINED
from femnl.diagnose.candidate import Candidate, job, names_of
from femnl.diagnose.global_starts import Start, look_over, scan, scan_beside
from femnl.diagnose.search_rules import saturates
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.worker_pool import Run
from femnl.fits.least_squares import FitResult, fit, improve
from femnl.observe.extended import ExtendedModel

T = TypeVar("T")
P = TypeVar("P")
PAIR = 1
"""The step of pairs."""


def from_afar(found: list[Candidate], library: list[Effect], run: Run) -> list[FitResult]:
    """Fit the pairs that promise most, one effect scanned globally beside each other one."""
    base = found[0].result
    alone = {c.names[0]: c.result for c in found if len(c.names) == 1}
    rest = [effect for effect in library if effect.name not in alone]
    alone |= zip(
        (e.name for e in rest),
        run([job("seeking", (e.name,), base, partial(_alone, base, e)) for e in rest]),
        strict=True,
    )
    shaped = sorted(library, key=_shaped)
    looked = run([job("seeking", (e.name,), base, partial(look_over, base, e)) for e in shaped])
    seen = {effect.name: place for effect, place in zip(shaped, looked, strict=True)}
    pairs = [
        (alone[one.name], other)
        for one, other in combinations(shaped, 2)
        if not saturates(alone[one.name], other)
    ]
    starts = run(
        [
            job(
                "seeking",
                names_of(single, other),
                base,
                partial(scan_beside, single, other, base, seen[other.name]),
            )
            for single, other in pairs
        ]
    )
    promising = _lowest(starts, pairs, THRESHOLDS.pairs_tried, lambda found: found[0].chi2)
    rough = run(
        [
            job(
                "trying",
                names_of(single, other),
                base,
                partial(_roughly, single, other, found[:REFINED]),
            )
            for found, (single, other) in promising
        ]
    )
    best = _lowest(
        rough,
        [pair for _, pair in promising],
        THRESHOLDS.sought_again[PAIR],
        lambda tried: tried[0],
    )
    return run(
        [
            job("trying", names_of(single, other), base, partial(_paired, single, other, v))
            for (_, v), (single, other) in best
        ]
    )


def _lowest(
    found: Sequence[T], pairs: Sequence[P], most: int, chi2_of: Callable[[T], float]
) -> list[tuple[T, P]]:
    """Return what was found of the pairs that leave the least χ², best first."""
    return sorted(zip(found, pairs, strict=True), key=lambda one: chi2_of(one[0]))[:most]


def _alone(base: FitResult, effect: Effect) -> FitResult:
    """Fit an effect from the best of the places all over its priors."""
    start = scan(base, effect)[0]
    model = ExtendedModel(base.model.base_model, (effect,))
    return fit(model, model.pack(start.base, [start.values]), near=base)


def _roughly(single: FitResult, other: Effect, starts: list[Start]) -> tuple[float, Array]:
    """Return χ² and the vector after a few evaluations from where another effect suits best."""
    model = ExtendedModel(single.model.base_model, (*single.model.effects, other))
    (_, own) = single.model.split(single.vector)
    vectors = [model.pack(start.base, [*own, start.values]) for start in starts]
    return min((improve(model, v, FAR, single) for v in vectors), key=lambda found: found[0])


def _paired(single: FitResult, other: Effect, vector: Array) -> FitResult:
    return fit(
        ExtendedModel(single.model.base_model, (*single.model.effects, other)), vector, near=single
    )


def _shaped(effect: Effect) -> tuple[int, int]:
    """Return the sort key of an effect: how many parameters are no strengths, then minus all.

    Of a pair of effects, the one with the larger key is sought beside the other.
    """
    shapes = sum(not spec.strength for spec in effect.parameters)
    return shapes, -len(effect.parameters)
