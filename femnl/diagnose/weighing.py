"""What fitted candidates are worth: evidence, prediction of held-out data, and their rivals."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femnl.diagnose.candidate import Candidate, Names, predict_held_out, weight_if_noisier
from femnl.diagnose.freeform import fitted_forms
from femnl.diagnose.graded import Graded
from femnl.diagnose.rivals import (
    EVEN,
    contradicted,
    equals,
    free_form_evidence,
    likelier_if_inexact,
    may_be_right,
    predicts_better,
    scatter_evidence,
)
from femnl.diagnose.thresholds import THRESHOLDS
from femnl.diagnose.worker_pool import Run, in_turn


@dataclass(frozen=True)
class Weighed:
    """Fitted candidates, the base model first, with what the rules ask of them.

    run: does what does not wait for each other. considered: names of the effects that were, or that
    the device cannot have.
    """

    found: list[Candidate]
    run: Run = in_turn
    considered: frozenset[str] = frozenset()

    @property
    def base(self) -> Candidate:
        """The base model."""
        return self.found[0]

    @cached_property
    def graded(self) -> Graded:
        """The same candidates where any equation may be inexact."""
        return Graded(self.found, self.considered)

    @cached_property
    def prior_share(self) -> dict[Names, float]:
        """Evidence times prior odds of every candidate, in parts of their sum."""
        weights = np.array([c.weight for c in self.found])
        shares = np.exp(weights - weights.max())
        total = shares.sum()
        return {c.names: float(s / total) for c, s in zip(self.found, shares, strict=True)}

    @cached_property
    def likely(self) -> list[Candidate]:
        """Return the sets that explain all data together, the most likely first.

        Each of their causes is worth its parameters. Several causes, or one that fits badly, must
        also outdo a smooth form of unknown cause, and several causes must outdo deviations at
        random: in just the right ratio they imitate what the library lacks.
        """
        tried = self.found[1:]
        worth = [
            c
            for c in tried
            if not any(set(o.names) < set(c.names) and o.weight >= c.weight for o in tried)
        ]
        likely = [c for c in worth if c.viable]
        if any(len(c.names) > 1 for c in likely):
            likely = [c for c in likely if len(c.names) == 1 or c in self.graded.needed]
        if any(len(c.names) > 1 or c.p_value < THRESHOLDS.set_doubtful for c in likely):
            smooth = free_form_evidence(self.base) - EVEN
            likely = [
                c
                for c in likely
                if c.weight > smooth
                and (len(c.names) == 1 or c.weight > scatter_evidence(self.base))
            ]
        return sorted(likely, key=lambda c: -c.weight)

    @cached_property
    def viable(self) -> list[Candidate]:
        """Those of the likeliest sets that predict each part of the data from the others.

        What fits all data together, but no part by what the others say, is bent to them, no cause.
        """
        nearest = self.likely[: 1 + THRESHOLDS.most_rivals]
        if nearest:
            predict_held_out([c.result for c in (self.base, *nearest)], self.run)
        return [c for c in nearest if c.result.cross_validation.p_value >= c.least_heldout]

    @property
    def best(self) -> Candidate:
        """The most likely viable set."""
        return self.viable[0]

    @cached_property
    def doubted(self) -> list[Candidate]:
        """Sets that are not viable, and may be right for all that is known."""
        return [
            c
            for c in self.found[1:]
            if c not in self.viable
            and (may_be_right(c, self.best) or likelier_if_inexact(c, self.best))
        ]

    @cached_property
    def share(self) -> dict[Names, float]:
        """Probability of every candidate; those that may be right share the whole."""
        possible = [c.names for c in (*self.viable, *self.doubted)]
        total = sum(self.prior_share[names] for names in possible)
        return self.prior_share | {names: self.prior_share[names] / total for names in possible}

    @cached_property
    def rivals(self) -> list[Candidate]:
        """Return the sets that keep the best from being named alone.

        These are the sets that are likely enough. Where there are none, all viable sets are rivals
        if they predict held-out data better than the best, or if the best predicts them no better
        than the base model.
        """
        others = self.viable[1:]
        unlikely = (1 - THRESHOLDS.named_alone) / 2
        near = [c for c in others if self.share[c.names] > unlikely or equals(c, self.best)]
        if near or self.doubted:
            return near + self.doubted
        if contradicted(self.best, others) or not self.predicts_better_than_base:
            return others
        return []

    @cached_property
    def share_if_noisier(self) -> dict[Names, float]:
        """Return the probability of every candidate where the noise is not the stated one."""
        weights = np.array([c.weight_if_noisier for c in self.found])
        shares = np.exp(weights - weights.max())
        return {c.names: float(s) for c, s in zip(self.found, shares / shares.sum(), strict=True)}

    @cached_property
    def noisier(self) -> list[Candidate]:
        """Return the single causes that leave nothing but noise, larger than stated.

        Those are returned that predict held-out data better than the base model and are about as
        likely as the likeliest of all sets and free forms, simplest and likeliest first; none where
        a set that holds none of them is as likely, too.
        """
        weights = {c.names: c.weight_if_noisier for c in self.found}
        least = max(weights.values()) - EVEN
        near = [c for c in self.found if weights[c.names] >= least]
        single = [c for c in near if len(c.names) == 1 and c.may_be_noisier]
        known = {name for c in single for name in c.names}
        if any(known.isdisjoint(c.names) for c in near):
            return []
        odds = float(2 * np.log(THRESHOLDS.odds_per_cause))
        forms = fitted_forms(self.base.result) if single else []
        smooth = [weight_if_noisier(form.log_evidence + odds, form) - EVEN for form in forms]
        before = self.base.result.cross_validation
        return sorted(
            (
                c
                for c in single
                if weights[c.names] >= max(smooth, default=-np.inf)
                and predicts_better(c.result.cross_validation, before)
            ),
            key=lambda c: (c.result.vector.size, -weights[c.names]),
        )

    @cached_property
    def predicts_better_than_base(self) -> bool:
        """Whether the best set predicts held-out data better than the base model."""
        return predicts_better(self.best.result.cross_validation, self.base.result.cross_validation)
