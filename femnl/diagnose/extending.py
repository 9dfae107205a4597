"""Which fitted sets are extended by one more cause, and by which ones."""

from dataclasses import replace
from functools import partial

from femnl.core.effect import Effect
from femnl.diagnose.candidate import Candidate, Names, job
from femnl.diagnose.criticism import looked_at
from femnl.diagnose.search_rules import (
    points_farther,
    spoils,
    takes_nothing,
    tangents_tell,
    worth_extending,
)
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.worker_pool import Run


def to_extend(
    grown: dict[Names, Candidate],
    size: int,
    found: list[Candidate],
    library: list[Effect],
    run: Run,
) -> tuple[list[Candidate], list[Effect]]:
    """Return the sets that are extended, with what their residuals point to, and the effects left.

    Args: grown: the latest sets, of size + 1 causes. found: the base model first, and all sets.
    """
    base = found[0]
    told = tangents_tell(base, found)
    parents = worth_extending(grown, size)
    if told:
        library = _without_spoilers(library, found)
        parents = _without_idle(parents, base, library, run)
    return _looked_at(parents, library, run, told), library


def partners(
    grown: dict[Names, Candidate],
    found: list[Candidate],
    parents: list[Candidate],
    library: list[Effect],
    run: Run,
) -> list[Candidate]:
    """Return the causes of the best pair, alone, that have not been extended.

    Another partner may do as well, or better.
    """
    best = max(grown, key=lambda names: grown[names].weight, default=())
    done = {parent.names for parent in parents}
    alone = [c for c in found if len(c.names) == 1 and c.names[0] in best and c.names not in done]
    return _looked_at(alone, library, run)


def _looked_at(
    candidates: list[Candidate], library: list[Effect], run: Run, told: bool = False
) -> list[Candidate]:
    """Seek where residuals point, where that was not sought yet.

    Args: told: whether tangents tell what causes take up; then all data are asked, and nothing is
        pointed to that would take hardly anything.
    """
    todo = [c for c in candidates if c.pointers is None]
    look = partial(looked_at, library=library, whole=told)
    fresh = iter(run([job("looking at", c.names, c.result, partial(look, c)) for c in todo]))
    seen = [next(fresh) if c.pointers is None else c for c in candidates]
    return [_with_telling(c) for c in seen] if told else seen


def _without_spoilers(library: list[Effect], found: list[Candidate]) -> list[Effect]:
    """Leave out effects without strength that alone leave more than the base model.

    Where causes add up, they do so beside others, too.
    """
    base, *tried = found
    better = {c.names for c in tried if not spoils(c, base)}
    return [effect for effect in library if effect.has_strength or (effect.name,) in better]


def _without_idle(
    parents: list[Candidate], base: Candidate, library: list[Effect], run: Run
) -> list[Candidate]:
    """Leave out single causes beside which nothing promises more than beside the base model.

    They take nothing themselves, and where causes add up, pairs with them are tried in vain. The
    likeliest sets stay.
    """
    idle = [
        c
        for c in parents[THRESHOLDS.beam :]
        if len(c.names) == 1 and c.pointers is None and takes_nothing(c, base)
    ]
    if not idle:
        return parents
    alone = looked_at(base, library, whole=False)
    seen = _looked_at(idle, library, run)
    vain = {c.names for c in seen if not points_farther(c, alone)}
    return [c for c in parents if c.names not in vain]


def _with_telling(candidate: Candidate) -> Candidate:
    """Leave out pointers to what would take hardly anything, however its shape is chosen."""
    least = THRESHOLDS.least_taken / 2
    pointers = tuple(pointer for pointer in candidate.pointers or () if pointer.gain >= least)
    return replace(candidate, pointers=pointers)
