"""Which causes, alone or together, explain what the base model leaves: ranked cheaply, fitted, compared."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import TypeVar

import numpy as np
from scipy.stats import chi2

from femnl.core.effect import Effect
from femnl.core.readout import Array
from femnl.diagnose.adequacy import Look, adequacy, looks
from femnl.diagnose.global_starts import scan
from femnl.diagnose.least_squares import Solution, fit, improve
from femnl.diagnose.multistart import FAR, REFINED, extended, replaced, sought_again, sought_beyond, unlike
from femnl.diagnose.worker_pool import Job, Run, in_turn
from femnl.observe.model import Extended, Problem

PROGRESS = logging.getLogger("femnl.progress")
T = TypeVar("T")
Names = tuple[str, ...]
FALSE_ALARMS = 0.01
"""p-value below which causes are sought beside the base model, and below which a set of causes does not explain the data."""
HOPELESS = 1e-3
"""p-value that is rare, but not too rare for chance, for what the base model or one cause predicts of data that were left out."""
DOUBTFUL = 0.05
"""p-value below which a set that explains the data may lack a cause that is too weak to rule it out."""
MOST = 7
"""Effects that are fitted at each step, those that the residuals point to most."""
TELLING = 2
"""Effects whose looks are the least likely by chance, which are fitted however little they promise: what is of second order shows
that it is there, but not how much it could take up."""
FEWEST, FAINT = 4, 0.01
"""Effects that are fitted in any case, and the part of the excess of χ² that any other must promise to take up."""
BEAM, PEERS = 2, 2.0
"""Sets of causes that are extended at each step; single causes up to this ratio of what they and the best leave of χ² are, too."""
PAIR = 1
"""Step at which pairs of causes are sought."""
NEARLY = 0.01
"""Part of what the base model leaves beyond noise, up to which a set beside one that explains the data is fitted anew: it may equal it."""
AGAIN = (3, 3, 1)
"""Sets of one, two and three whose causes are sought anew, or pairs that are fitted from afar, where no set explains the data well."""
LARGEST = 3
"""Causes in the largest set."""
PER_CAUSE = 0.1
"""Prior odds of one more cause."""


@dataclass(frozen=True)
class Pointer:
    """An effect that residuals point to, and its parameters where the best looks that differ would start a fit."""

    effect: Effect
    shapes: tuple[dict[str, float], ...]


@dataclass(frozen=True)
class Candidate:
    """A fitted set of causes: its p-value, the look that speaks most against it, and where its residuals point (None: not looked at)."""

    solution: Solution
    p_value: float
    worst: str
    pointers: tuple[Pointer, ...] | None

    @property
    def names(self) -> Names:
        """Names of the causes, sorted."""
        return _names(self.solution)

    @property
    def weight(self) -> float:
        """Logarithm of evidence times prior odds."""
        return self.solution.log_evidence + len(self.names) * float(np.log(PER_CAUSE))

    @property
    def viable(self) -> bool:
        """Whether the set explains the data: adequate, with no parameter at a bound."""
        return self.p_value >= (FALSE_ALARMS if self.names else HOPELESS) and not self.solution.stuck

    @property
    def least(self) -> float:
        """p-value of data left out below which the set does not explain them: one cause is given the benefit of the doubt."""
        return HOPELESS if len(self.names) <= 1 else FALSE_ALARMS


def applicable(problem: Problem, library: Iterable[Effect]) -> list[Effect]:
    """Return the effects that can show in this measurement."""
    return [effect for effect in library if problem.kind in effect.kinds and all(fact in problem.facts for fact in effect.needs)]


def criticise(solution: Solution, library: list[Effect]) -> Candidate:
    """Look at the residuals in every way, the effects that the model lacks included."""
    mine = {effect.name for effect in solution.model.effects}
    others = [effect for effect in library if effect.name not in mine]
    found = looks(solution, others)
    p_value, worst = adequacy(solution, found)
    return Candidate(solution, p_value, worst, tuple(_pointers(solution, found, others)))


def _pointers(solution: Solution, found: list[Look], library: list[Effect]) -> list[Pointer]:
    """Return the effects that promise most, and those whose looks are the least likely by chance."""
    best: dict[str, list[Look]] = {}
    for look in sorted(found, key=lambda look: -look.gain):
        if look.effect is not None and look.gain > 0:
            best.setdefault(look.name, []).append(look)
    excess = solution.chi2 - solution.degrees
    promising = {name for i, name in enumerate(best) if i < FEWEST or (i < MOST and best[name][0].gain > FAINT * excess)}
    promising.update(sorted(best, key=lambda name: min(look.p_value for look in best[name]))[:TELLING])
    return [Pointer(e, tuple(look.values for look in unlike(best[e.name]))) for e in library if e.name in promising]


def search(problem: Problem, library: list[Effect], run: Run = in_turn) -> list[Candidate]:
    """Return the base model first, then every set of causes that was fitted.

    Greedy: sets grow by the effects that their residuals point to most, and no further once one of them explains the data well.
    run: does jobs that do not wait for each other.
    """
    model = Extended(problem)
    PROGRESS.info("%s: fitting the base model", problem.kind)
    base = criticise(fit(model, problem.start), library)
    found = [base]
    if base.p_value >= FALSE_ALARMS:
        return found
    beam = [base]
    for size in range(LARGEST):
        grown: dict[Names, Candidate] = {}
        parents, done = list(beam), list[Candidate]()
        while parents:
            _keep(grown, run(_growing(parents, library)), library, run)
            done += parents
            parents = _partners(grown, found, done, library, run) if size == PAIR and (problem.rugged or _settled(grown)) else []
        if not _settled(grown):
            ranked = sorted(grown.values(), key=lambda c: -c.weight)
            if problem.rugged and size == PAIR:
                others = _from_afar(found, library, run)
            else:
                few = len(ranked) if problem.rugged and size == 0 else AGAIN[size]
                others = run(_seeking(ranked[:few]))
            _keep(grown, others, library, run)
        else:
            short = [c for c in grown.values() if not c.viable and _excess(c) < NEARLY * _excess(base)]
            _keep(grown, run(_seeking(short)), library, run)
        found += grown.values()
        beam = sorted(grown.values(), key=lambda c: -c.weight)
        beam = [c for i, c in enumerate(beam) if i < BEAM or (size == 0 and _excess(c) < PEERS * _excess(beam[0]))]
        if _settled(grown):
            break
        beam = _looked_at(beam, library, run)
    return _simpler(found, library, run)


def _simpler(found: list[Candidate], library: list[Effect], run: Run) -> list[Candidate]:
    """Fit the best set that explains the data without each of its causes: what was found beside another may do without it."""
    kept, (plain, _) = {candidate.names: candidate for candidate in found}, found[0].solution.model.split(found[0].solution.vector)
    several = [candidate for candidate in found if candidate.viable and len(candidate.names) > 1]
    todo = sorted(several, key=lambda c: c.weight)[-1:]
    while todo:
        solution = todo.pop().solution
        model, (base, values) = solution.model, solution.model.split(solution.vector)
        for k, effect in enumerate(model.effects):
            start = base | {name: plain[name] for name in effect.replaces}
            fewer = Extended(model.problem, (*model.effects[:k], *model.effects[k + 1 :]))
            names = tuple(sorted(effect.name for effect in fewer.effects))
            before = kept.get(names)
            _keep(kept, [fit(fewer, fewer.pack(start, [*values[:k], *values[k + 1 :]]), near=solution)], library, run)
            if kept[names] is not before and kept[names].viable and len(names) > 1:
                todo.append(kept[names])
    return list(kept.values())


def _settled(grown: dict[Names, Candidate]) -> bool:
    """Whether a set explains the data beyond doubt."""
    return any(candidate.viable and candidate.p_value >= DOUBTFUL for candidate in grown.values())


def _partners(
    grown: dict[Names, Candidate], found: list[Candidate], parents: list[Candidate], library: list[Effect], run: Run
) -> list[Candidate]:
    """Return the causes of the best pair, alone, that have not been extended: another partner may do as well, or better."""
    best = max(grown, key=lambda names: grown[names].weight, default=())
    done = {parent.names for parent in parents}
    alone = [c for c in found if len(c.names) == 1 and c.names[0] in best and c.names not in done]
    return _looked_at(alone, library, run)


def _looked_at(candidates: list[Candidate], library: list[Effect], run: Run) -> list[Candidate]:
    """Criticise what has not been yet."""
    todo = [c.solution for c in candidates if c.pointers is None]
    fresh = iter(run([_job("looking at", _names(s), s, partial(criticise, s, library)) for s in todo]))
    return [next(fresh) if c.pointers is None else c for c in candidates]


def _keep(grown: dict[Names, Candidate], solutions: Iterable[Solution | None], library: list[Effect], run: Run) -> None:
    """Criticise what was fitted, the best of each set of causes; where χ² alone rules it out, leave it at that."""
    best: dict[Names, Solution] = {}
    for solution in (solution for solution in solutions if solution is not None):
        names = _names(solution)
        known = best[names] if names in best else grown[names].solution if names in grown else None
        if known is None or solution.chi2 < known.chi2:
            best[names] = solution
    plain = {names: Candidate(s, float(chi2.sf(s.chi2, s.degrees)), "chi-square", None) for names, s in best.items()}
    worth = [c for c in plain.values() if c.p_value >= HOPELESS / 10]
    grown |= plain | {c.names: c for c in _looked_at(worth, library, run)}


def _excess(candidate: Candidate) -> float:
    return max(candidate.solution.chi2 - candidate.solution.degrees, 0.0)


def _from_afar(found: list[Candidate], library: list[Effect], run: Run) -> list[Solution]:
    """Fit the pairs that promise most where one effect is sought from afar beside each other one."""
    base, alone = found[0].solution, {c.names[0]: c.solution for c in found if len(c.names) == 1}
    rest = [effect for effect in library if effect.name not in alone]
    alone |= zip((e.name for e in rest), run([_job("seeking", (e.name,), base, partial(_alone, base, e)) for e in rest]), strict=True)
    pairs = [(alone[one.name], other) for one, other in combinations(sorted(library, key=_shaped), 2)]
    rough = run([_job("seeking", _names(single, other), base, partial(_roughly, single, other)) for single, other in pairs])
    best = sorted(zip(rough, pairs, strict=True), key=lambda pair: pair[0][0])[: AGAIN[PAIR]]
    return run([_job("trying", _names(single, other), base, partial(_paired, single, other, v)) for (_, v), (single, other) in best])


def _alone(base: Solution, effect: Effect) -> Solution:
    """Fit an effect from the best of the places all over its priors."""
    start, model = scan(base, effect)[0], Extended(base.model.problem, (effect,))
    return fit(model, model.pack(start.base, [start.values]), near=base)


def _roughly(single: Solution, other: Effect) -> tuple[float, Array]:
    """Return χ² and the vector to which a few evaluations lead from where another effect suits best beside one."""
    model, (_, own) = Extended(single.model.problem, (*single.model.effects, other)), single.model.split(single.vector)
    starts = [model.pack(start.base, [*own, start.values]) for start in scan(single, other)[:REFINED]]
    return min((improve(model, start, FAR, single) for start in starts), key=lambda found: found[0])


def _paired(single: Solution, other: Effect, vector: Array) -> Solution:
    return fit(Extended(single.model.problem, (*single.model.effects, other)), vector, near=single)


def _shaped(effect: Effect) -> tuple[int, int]:
    """How many parameters of an effect are no strengths, and how many are: of two, the one with more is sought beside the other."""
    shapes = sum(not knob.strength for knob in effect.parameters)
    return shapes, -len(effect.parameters)


def _growing(parents: list[Candidate], library: list[Effect]) -> list[Job[Solution | None]]:
    """Return the fits of each parent's model with one more effect, for each of those that its residuals point to."""
    jobs: list[Job[Solution | None]] = []
    for parent in parents:
        solution, mine = parent.solution, parent.names
        for pointer in parent.pointers or ():
            find = partial(extended, solution, pointer.effect, list(pointer.shapes))
            jobs.append(_job("trying", _names(solution, pointer.effect), solution, find))
        others = [e for e in library if e.name not in mine and not any(knob.strength for knob in e.parameters)]
        jobs += [_job("trying", _names(solution, e), solution, partial(replaced, solution, e)) for e in others]
    return jobs


def _seeking(candidates: list[Candidate]) -> list[Job[Solution | None]]:
    """Return the fits that seek each cause of some sets anew, and what else may have been missed."""
    jobs: list[Job[Solution | None]] = []
    for solution in (c.solution for c in candidates):
        jobs.append(_job("seeking", _names(solution), solution, partial(sought_beyond, solution)))
        for k, effect in enumerate(solution.model.effects):
            doing = f"seeking {effect.name} again in"
            jobs.append(_job(doing, _names(solution), solution, partial(sought_again, solution, k)))
    return jobs


def _names(solution: Solution, *more: Effect) -> Names:
    return tuple(sorted(effect.name for effect in (*solution.model.effects, *more)))


def _job(doing: str, names: Names, solution: Solution, find: Callable[[], T]) -> Job[T]:
    return Job(f"{solution.model.problem.kind}: {doing} {' + '.join(names)}", find)
