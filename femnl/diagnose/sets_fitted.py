"""Fits of sets of causes: with one more of them, and from elsewhere."""

from functools import partial

from femnl.core.effect import Effect
from femnl.diagnose.candidate import Candidate, Names, job, names_of
from femnl.diagnose.multistart import extended, replaced, sought_again
from femnl.diagnose.other_valleys import sought_beyond
from femnl.diagnose.part_of_data import best_in_all
from femnl.diagnose.search_rules import saturates
from femnl.diagnose.worker_pool import Job, Run
from femnl.fits.least_squares import FitResult


def fitted(parents: list[Candidate], library: list[Effect], run: Run) -> list[FitResult]:
    """Fit each parent's model with one more effect that its residuals point to.

    A part of many data leads to one fit to all of them for each set, whichever parents led to it.
    """
    trying = [(parent.result, one) for parent in parents for one in _growing(parent, library)]
    tried = run([one for _, one in trying])
    if parents[0].result.model.base_model.thinned is None:
        return [result for fits in tried for result in fits]
    begun: dict[Names, list[FitResult]] = {}
    near: dict[Names, FitResult] = {}
    for (parent, _), fits in zip(trying, tried, strict=True):
        for result in fits:
            names = names_of(result)
            begun.setdefault(names, []).append(result)
            near[names] = min(near.get(names, parent), parent, key=lambda one: one.chi2)
    return run(
        [
            job("fitting", names, near[names], partial(best_in_all, fits, near[names]))
            for names, fits in begun.items()
        ]
    )


def _growing(parent: Candidate, library: list[Effect]) -> list[Job[list[FitResult]]]:
    """Return the jobs that fit a part of many data; saturated sets are left out."""
    result = parent.result
    finds = [
        (pointer.effect, partial(extended, result, pointer.effect, list(pointer.shapes)))
        for pointer in parent.pointers or ()
    ]
    finds += [
        (effect, partial(replaced, result, effect))
        for effect in library
        if effect.name not in parent.names and not effect.has_strength
    ]
    return [
        job("trying", names_of(result, effect), result, find)
        for effect, find in finds
        if not saturates(result, effect)
    ]


def seeking(candidates: list[Candidate]) -> list[Job[FitResult | None]]:
    """Return fits that scan each cause of some sets anew, and what else may have been missed."""
    jobs: list[Job[FitResult | None]] = []
    for result in (c.result for c in candidates):
        jobs.append(job("seeking", names_of(result), result, partial(sought_beyond, result)))
        for k, effect in enumerate(result.model.effects):
            doing = f"seeking {effect.name} again in"
            jobs.append(job(doing, names_of(result), result, partial(sought_again, result, k)))
    return jobs
