"""What fitted candidates are worth where any equation may be inexact.

Every candidate has a discrepancy of unknown size, and so has each of its causes.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import numpy as np

from femnl.core.effect import UNKNOWN, Effect
from femnl.core.readout import Array
from femnl.diagnose.candidate import Candidate, Names
from femnl.diagnose.discrepancy import Discrepancy, discrepancy, log_evidence
from femnl.diagnose.done_by import changed_by, effects_of
from femnl.diagnose.rivals import may_imitate
from femnl.diagnose.thresholds import THRESHOLDS

NEEDLESS = float(np.log(THRESHOLDS.needless_odds))
"""Logarithm of the odds that decide whether further causes are needless, either way."""
OF_FEW_SHAPES = frozenset({"decay", "trace"})
"""Kinds whose causes are smooth functions of one variable: time, or the number of a harmonic."""
OF_ONE_RESONANCE = frozenset({"response"})
"""Kinds whose causes all bend one resonance or its background, so that one resembles another: a
second mode takes up 97 % of a quintic stiffness, a slope 98 % of a Fano line.
"""
NEEDLESS_SQUARE = 4.0
"""What a needless parameter takes up of χ² at most, but for one in twenty."""
LONE = 0.95
"""Part of the squares of what a cause changes, in σ, that makes the datum it is in its only one."""
WITHIN_ACCURACIES = 2.0
"""Of its accuracy, how much an equation may miss the data by: two standard deviations."""


@dataclass(frozen=True)
class Graded:
    """Fitted candidates, the base model first, with a discrepancy in each.

    considered: names of the effects that were, or that the device cannot have.
    """

    found: list[Candidate]
    considered: frozenset[str]

    @property
    def base(self) -> Candidate:
        """The base model."""
        return self.found[0]

    @cached_property
    def allowed(self) -> Discrepancy:
        """What every candidate may miss the data by."""
        possible = [c for c in self.found if c is self.base or not c.stuck]
        best = min(possible, key=lambda c: c.result.chi2)
        return discrepancy(self.base.result, best.result)

    @property
    def alike(self) -> bool:
        """Whether one smooth cause resembles another.

        It does where smooth directions span much of the data, over a plane, where causes are smooth
        fields, and in kinds of few shapes.
        """
        spanned = len(self.allowed.directions) / len(self.base.result.residuals)
        model = self.base.result.model.base_model
        planar = model.layout is not None and model.layout.planar
        return planar or model.kind in OF_FEW_SHAPES or spanned >= THRESHOLDS.few_data

    def least_share(self, candidate: Candidate) -> float:
        """Return the part of the held-out excess χ² that causes named in part must take up.

        A single cause may leave half of what it leaves of anything that no library has, unless it
        imitates a cause that was not considered; a cause of one resonance that does is asked for
        nearly all, however inexact its equation.
        """
        least = self._least_share_of_kind(candidate)
        effects = candidate.result.model.effects
        if len(effects) != 1:
            return least
        kind = self.base.result.model.base_model.kind
        imitated = effects[0].imitates.get(kind, {})
        if UNKNOWN not in imitated:
            return least
        if not imitated.keys() <= {*self.considered, UNKNOWN}:
            return THRESHOLDS.least_share_of_alike if kind in OF_ONE_RESONANCE else least
        return min(least, max((1 + imitated[UNKNOWN]) / 2, THRESHOLDS.least_share_of_unlike))

    def _least_share_of_kind(self, candidate: Candidate) -> float:
        """Return the same whatever each cause imitates.

        Causes of one resonance may leave (2ε)² of it, with the accuracy ε of their equations.
        """
        if self.alike:
            return THRESHOLDS.least_share_of_alike
        if self.base.result.model.base_model.kind not in OF_ONE_RESONANCE:
            return THRESHOLDS.least_share
        accuracy = max((effect.accuracy for effect in candidate.result.model.effects), default=0.0)
        least = 1 - (WITHIN_ACCURACIES * accuracy) ** 2
        return float(np.clip(least, THRESHOLDS.least_share, THRESHOLDS.least_share_of_alike))

    @property
    def least_inclusion(self) -> float:
        """Return the probability from which on a cause is in the right set beyond doubt."""
        return THRESHOLDS.least_inclusion_of_alike if self.alike else THRESHOLDS.least_inclusion

    @cached_property
    def share(self) -> dict[Names, float]:
        """Return the probability of every candidate, with a discrepancy in each of its causes.

        The size of a discrepancy is not known. Candidates that end at a bound are left out. Sets
        that do the same are told apart by their parameters, as where equations are exact.
        """
        possible = [c for c in self.found if c is self.base or not c.stuck]
        allowed = self.allowed
        odds = float(np.log(THRESHOLDS.odds_per_cause))
        # Not side by side: fits and discrepancy of a map would be sent, a tenth of a gigabyte
        evidence = np.array([log_evidence(c, self.base, allowed) for c in possible])
        weights = evidence + odds * np.array([len(c.names) for c in possible])
        weights = _as_likely_as_richer(possible, weights)
        shares = np.exp(weights - weights.max())
        return {c.names: float(s) for c, s in zip(possible, shares / shares.sum(), strict=True)}

    @cached_property
    def needed(self) -> list[Candidate]:
        """Return the sets whose causes each take up what no inexactness of the others could.

        With a discrepancy in each of its causes, such a set is not far less likely than what is
        left without one of them. Else a strong cause whose equation is not exact would be named
        with a second one that describes its error.
        """
        kept = []
        for candidate in self.found[1:]:
            own = self.share.get(candidate.names, 0.0)
            fewer = [
                share
                for names, share in self.share.items()
                if names and set(names) < set(candidate.names)
            ]
            if own * THRESHOLDS.needless_odds >= max(fewer, default=0.0):
                kept.append(candidate)
        return kept

    def may_suffice(self, best: Candidate) -> list[Candidate]:
        """Return fewer causes of a set, whose inexact equations may do what the others take up.

        The likeliest first, where nothing but equations may be inexact: what they leave is then a
        part of what they do, and a further cause must be likelier than that beyond doubt. A cause
        that acts on one datum alone is never beyond doubt: anything may do that.
        """
        fewer = [
            c for c in self.found if c.names and not c.stuck and set(c.names) < set(best.names)
        ]
        if not fewer:
            return []
        exact = self.allowed.none
        odds = float(np.log(THRESHOLDS.odds_per_cause))

        def weight(one: Candidate) -> float:
            return log_evidence(one, self.base, exact) + len(one.names) * odds

        least = weight(best) - NEEDLESS
        lone = {effect.name for effect in effects_of(best) if _acts_on_one(best, self.base, effect)}
        ranked = sorted(((weight(c), i) for i, c in enumerate(fewer)), reverse=True)
        return [
            fewer[i]
            for one, i in ranked
            if one > least or set(best.names) - set(fewer[i].names) <= lone
        ]

    @cached_property
    def left_in_part(self) -> list[Candidate]:
        """Return sets of which one is right beyond doubt, though none is alone, likeliest first.

        What a further cause adds to one of them that does not count speaks for that set, too.
        There are none where one of them seems to imitate what the library lacks, and where there
        would be more than a reader is told.
        """
        ranked = sorted(self.found, key=lambda c: -self.share.get(c.names, 0.0))
        total = 0.0
        sets: list[Candidate] = []
        for candidate in ranked:
            if not candidate.names or may_imitate(candidate):
                return []
            smaller = [one for one in sets if set(one.names) < set(candidate.names)]
            counting: Candidate | None = candidate
            if not self.each_counts(candidate):
                counting = smaller[0] if smaller else self._that_count(candidate)
            if counting is None:
                return []
            if all(one is not counting for one in sets):
                sets.append(counting)
            if len(sets) > THRESHOLDS.most_rivals + 1:
                return []
            total += self.share.get(candidate.names, 0.0)
            if total >= self.least_inclusion:
                return sets
        return []

    def _that_count(self, candidate: Candidate) -> Candidate | None:
        """Return the causes of a set that count, as fitted without the others; None without any."""
        fewer = [c for c in self.found if c.names and set(c.names) < set(candidate.names)]
        sets = [c for c in fewer if not c.stuck and self.each_counts(c)]
        best = min(sets, key=lambda c: c.result.chi2, default=None)
        least = THRESHOLDS.least_share_each * _excess(self.base)
        return None if best is None or _excess(best) - _excess(candidate) >= least else best

    @cached_property
    def beyond_doubt(self) -> Candidate | None:
        """The causes that every likely set has in common, None where there are none.

        The largest fitted set of them. None where that seems to imitate what the library lacks.
        """
        inclusion: dict[str, float] = {}
        for names, share in self.share.items():
            for name in names:
                inclusion[name] = inclusion.get(name, 0.0) + share
        sure = {name for name, share in inclusion.items() if share >= self.least_inclusion}
        sets = [
            c
            for c in self.found[1:]
            if set(c.names) <= sure and not c.stuck and self.each_counts(c)
        ]
        best = max(sets, key=lambda c: (len(c.names), self.share[c.names]), default=None)
        return None if best is None or may_imitate(best) else self._simplest(best)

    def _simplest(self, candidate: Candidate) -> Candidate:
        """Return the cause that a single one contains, where it may do with an inexact equation.

        A leak whose equation misses 10 % of it seems to slope, and a far resonance is one: what
        their further parameters take up must be more than that.
        """
        effects = candidate.result.model.effects
        if len(effects) != 1:
            return candidate
        kind = self.base.result.model.base_model.kind
        imitated = effects[0].imitates.get(kind, {})
        own = {spec.name for spec in effects[0].parameters}
        simpler = []
        for other in self.found[1:]:
            (effect, *more) = other.result.model.effects
            contained = imitated.get(effect.name) == 1 and {s.name for s in effect.parameters} < own
            missed = (WITHIN_ACCURACIES * effect.accuracy) ** 2 * _excess(self.base)
            gain = _excess(other) - _excess(candidate)
            if contained and not more and not other.stuck and gain <= missed:
                simpler.append(other)
        return min(simpler, key=lambda c: c.result.chi2, default=candidate)

    def each_counts(self, candidate: Candidate) -> bool:
        """Whether every one of several causes takes up what inexact equations would not miss.

        And most of what the others leave: else it may take up a part of what no library has.
        """
        least = THRESHOLDS.least_share_each * _excess(self.base)
        fewer = [
            c
            for c in self.found
            if set(c.names) < set(candidate.names) and len(c.names) == len(candidate.names) - 1
        ]
        return len(candidate.names) == 1 or all(
            _excess(c) - _excess(candidate)
            >= max(least, THRESHOLDS.least_share_of_rest * _excess(c))
            for c in fewer
        )

    def inflation(self, candidate: Candidate) -> float:
        """Return by how much standard deviations grow with what a set leaves.

        The root of its χ² per degree of freedom, and of the residuals that count as one.
        """
        result = candidate.result
        scatter = result.chi2 / result.degrees * len(result.residuals) / self.allowed.pieces
        return float(np.sqrt(max(scatter, 1.0)))


def _excess(candidate: Candidate) -> float:
    """Return what a set leaves of χ² beyond noise."""
    return candidate.result.chi2 - candidate.result.degrees


def _acts_on_one(candidate: Candidate, base: Candidate, effect: Effect) -> bool:
    """Whether a cause of a set changes hardly anything but one datum."""
    squares: Array = changed_by(candidate, base, effect) ** 2
    layout = candidate.result.model.base_model.layout
    if layout is not None:
        known = layout.datum >= 0
        squares = np.asarray(np.bincount(layout.datum[known], squares[known]), float)
    return bool(squares.max() >= LONE * squares.sum() > 0)


def _as_likely_as_richer(possible: list[Candidate], weights: Array) -> Array:
    """Raise the weight of sets that do what as many causes with more parameters do.

    To what it is over theirs where equations are exact. The accuracy of equations says how far data
    may be from a cause, and not which of two causes that do the same it is: a leak is as accurate
    as one with a slope that is zero.
    """
    raised = weights.copy()
    for (i, one), (k, richer) in permutations(enumerate(possible), 2):
        if len(one.names) == len(richer.names) and _does_the_same(one, richer):
            raised[i] = max(raised[i], weights[k] + one.weight - richer.weight)
    return raised


def _does_the_same(one: Candidate, richer: Candidate) -> bool:
    """Whether a set has fewer parameters than another, and predicts the same but for noise."""
    needless = NEEDLESS_SQUARE * (richer.result.vector.size - one.result.vector.size)
    if abs(one.result.chi2 - richer.result.chi2) > needless or needless <= 0:
        return False
    apart = one.result.residuals - richer.result.residuals
    return bool(apart @ apart <= needless)
