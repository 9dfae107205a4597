"""Which causes, alone or together, explain what the base model leaves.

Ranked cheaply, fitted, compared.
"""

import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

from scipy.special import chdtrc

from femnl.core.checkpoint import Checkpoint
from femnl.core.effect import Effect
from femnl.diagnose.afar import PAIR, from_afar
from femnl.diagnose.candidate import Candidate, Names, job, names_of
from femnl.diagnose.criticism import criticise, glance
from femnl.diagnose.extending import partners, to_extend
from femnl.diagnose.multistart import (
    extended_elsewhere,
    followed,
    seekable_elsewhere,
)
from femnl.diagnose.search_rules import (
    falls_short,
    leaves_other_noise,
    may_leave_larger_noise,
    needs_global_search,
    outweighed,
    settled,
    takes_up_nearly_all,
)
from femnl.diagnose.sets_fitted import fitted, seeking
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.worker_pool import Run, in_turn
from femnl.fits.least_squares import FitResult, fit
from femnl.observe.extended import ExtendedModel
from femnl.observe.model import MeasurementModel

PROGRESS = logging.getLogger("femnl.progress")

SIZES = ("single causes", "pairs", "triples")
"""The steps of the search, by the size of the sets that they fit."""


def search(
    base_model: MeasurementModel,
    library: list[Effect],
    run: Run = in_turn,
    checkpoint: Checkpoint | None = None,
    other_noise: Callable[[Candidate], float | None] = lambda best: None,
) -> list[Candidate]:
    """Return the base model first, then every set of causes that was fitted.

    Greedy: sets grow by the effects that their residuals point to most, and no further once one of
    them explains the data beyond doubt.

    Args: base_model, library: the data and the effects that may act on them. run: does jobs that do
    not wait for each other. checkpoint: keeps every fit. other_noise: the noise that
    a fit's remainder shows, over that of the model, None where it is the same; where one cause
    takes up most of the deviation and its remainder shows other noise, larger sets would only
    describe that noise, and the search ends.
    """
    PROGRESS.info("%s: fitting the base model", base_model.kind)
    first = fit(ExtendedModel(base_model), base_model.start, checkpoint=checkpoint)
    base = criticise(first, library, run=run)
    found = [base]
    if base.p_value >= THRESHOLDS.base_inadequate:
        return found
    grown: dict[Names, Candidate] = {}
    parents = [base]
    for size in range(len(SIZES)):
        if size:
            parents, library = to_extend(grown, size - 1, found, library, run)
        grown = _grown(parents, found, size, library, run)
        if settled(grown):
            short = [c for c in grown.values() if falls_short(c, base)]
            return _simpler(
                [*found, *_kept(grown, run(seeking(short)), found, library, run).values()],
                library,
                run,
            )
        if size < PAIR or not takes_up_nearly_all(grown, base):
            sought = _sought_anew(grown, found, size, library, run)
            grown = _kept(grown, sought, found, library, run)
        found += grown.values()
        if size == 0 and leaves_other_noise(grown, base, other_noise):
            break
        if settled(grown) or (size >= PAIR and takes_up_nearly_all(grown, base)):
            break
    return _simpler(found, library, run)


def refitted(
    base_model: MeasurementModel,
    library: list[Effect],
    earlier: list[Candidate],
    run: Run = in_turn,
) -> list[Candidate]:
    """Return the likeliest sets of an earlier search, fitted to data whose noise is better known.

    With them comes whatever was tried of fewer of their causes, which tells what each is worth.

    Args: base_model: under that noise. earlier: what was found under another.
    """

    def begun(before: FitResult) -> FitResult:
        # Of the model at hand, which helpers know by name, and not of the one of another noise
        return replace(before, model=ExtendedModel(base_model, before.model.effects))

    found = [criticise(_again(begun(earlier[0].result)), library, run=run)]
    ranked = sorted(earlier[1:], key=lambda c: -c.weight)[: THRESHOLDS.most_refitted]
    largest = [set(c.names) for c in ranked]
    for size in range(1, len(SIZES) + 1):
        sized = [c for c in earlier[1:] if len(c.names) == size]
        kept = [c for c in sized if any(set(c.names) <= names for names in largest)]
        fits = [
            job("fitting again", c.names, c.result, partial(_again, begun(c.result))) for c in kept
        ]
        grown = _kept({}, run(fits), found, library, run)
        found += grown.values()
        if settled(grown):  # as in a search, no larger ones
            break
    return _simpler(found, library, run)


def better(found: list[Candidate], others: list[Candidate]) -> list[Candidate]:
    """Return all sets of two searches, of each the fit that leaves less; the base model first."""
    best = {candidate.names: candidate for candidate in others}
    for candidate in found:
        known = best.get(candidate.names)
        if known is None or candidate.result.chi2 <= known.result.chi2:
            best[candidate.names] = candidate
    return sorted(best.values(), key=lambda candidate: len(candidate.names))


def _again(before: FitResult) -> FitResult:
    return fit(before.model, before.vector, near=before)


def _grown(
    parents: list[Candidate],
    found: list[Candidate],
    size: int,
    library: list[Effect],
    run: Run,
) -> dict[Names, Candidate]:
    """Return each parent with one more cause; of pairs, with other partners of the best too."""
    grown: dict[Names, Candidate] = {}
    done = list[Candidate]()
    while parents:
        grown = _kept(grown, fitted(parents, library, run), found, library, run)
        done += parents
        parents = []
        if size == PAIR and (needs_global_search(found) or settled(grown)):
            parents = partners(grown, found, done, library, run)
    return grown


def _sought_anew(
    grown: dict[Names, Candidate],
    found: list[Candidate],
    size: int,
    library: list[Effect],
    run: Run,
) -> list[FitResult | None]:
    """Return fits from elsewhere, where no set explains the data beyond doubt.

    Tangents may have led astray: the best sets are sought anew, all single causes where effects act
    by jumps, and there pairs from afar. A strong cause may have led the base model astray.
    """
    ranked = sorted(grown.values(), key=lambda c: -c.weight)
    if needs_global_search(found) and size == PAIR:
        return [*from_afar(found, library, run)]
    everywhere = needs_global_search(found) and size == 0
    few = len(ranked) if everywhere else THRESHOLDS.sought_again[size]
    jobs = seeking(ranked[:few])
    base = found[0].result
    if size == 0:
        jobs += [
            job("following", names_of(base, e), base, partial(followed, base, e))
            for e in library
            if "time" in e.needs and len(base.model.base_model.order_of_blocks)
        ]
        jobs += [
            job("trying elsewhere", names_of(base, e), base, partial(extended_elsewhere, base, e))
            for e in seekable_elsewhere(base, library)
        ]
    return run(jobs)


def _simpler(found: list[Candidate], library: list[Effect], run: Run) -> list[Candidate]:
    """Fit the best set that explains the data without each of its causes.

    What was found beside another may do without it.
    """
    kept = {candidate.names: candidate for candidate in found}
    (plain, _) = found[0].result.model.split(found[0].result.vector)
    several = [candidate for candidate in found if candidate.viable and len(candidate.names) > 1]
    todo = sorted(several, key=lambda c: c.weight)[-1:]
    while todo:
        result = todo.pop().result
        model = result.model
        (base, values) = result.model.split(result.vector)
        for k, effect in enumerate(model.effects):
            start = base | {name: plain[name] for name in effect.replaces}
            fewer = ExtendedModel(model.base_model, (*model.effects[:k], *model.effects[k + 1 :]))
            names = tuple(sorted(effect.name for effect in fewer.effects))
            before = kept.get(names)
            again = fit(fewer, fewer.pack(start, [*values[:k], *values[k + 1 :]]), near=result)
            kept = _kept(kept, [again], found, library, run)
            if kept[names] is not before and kept[names].viable and len(names) > 1:
                todo.append(kept[names])
    return list(kept.values())


def _kept(
    grown: dict[Names, Candidate],
    results: Iterable[FitResult | None],
    found: list[Candidate],
    library: list[Effect],
    run: Run,
) -> dict[Names, Candidate]:
    """Return what was known and what was fitted: the best fit of each set of causes, criticised.

    A set that χ² alone rules out is not criticised, but for one cause that may leave noise which is
    larger than stated. One that fewer causes outweigh is glanced at.

    Args: found: the base model first, and sets of fewer causes.
    """
    best: dict[Names, FitResult] = {}
    for result in (result for result in results if result is not None):
        names = names_of(result)
        known = best.get(names) or (grown[names].result if names in grown else None)
        if known is None or result.chi2 < known.chi2:
            best[names] = result
    plain = {
        names: Candidate(s, float(chdtrc(s.degrees, s.chi2)), "chi-square", None)
        for names, s in best.items()
    }
    worth = [
        c
        for c in plain.values()
        if c.p_value >= THRESHOLDS.chance_excluded / 10 or may_leave_larger_noise(c)
    ]
    first = found[0].first_tests
    if len(worth) == 1 and not outweighed(worth[0], found):  # whose tests share the processes
        seen = [criticise(worth[0].result, library, first, run)]
    else:
        jobs = []
        for c in worth:
            look = partial(glance if outweighed(c, found) else criticise, c.result, library, first)
            jobs.append(job("looking at", c.names, c.result, look))
        seen = run(jobs)
    return grown | plain | {c.names: c for c in seen}
