"""A fitted set of causes: how well it explains the data, and what its residuals point to."""

from dataclasses import dataclass

import numpy as np

from femnl.core.effect import Effect
from femnl.diagnose.adequacy import ScoreTest, adequacy, score_tests
from femnl.diagnose.multistart import unlike
from femnl.fits.least_squares import FitResult

Names = tuple[str, ...]
FALSE_ALARMS = 0.01
"""p-value below which causes are sought beside the base model, and below which a set of causes does
not explain the data.
"""
HOPELESS = 1e-3
"""p-value that is rare, but not too rare for chance, for what the base model or one cause predicts
of data that were left out.
"""
DOUBTFUL = 0.05
"""p-value below which a set that explains the data may lack a cause that is too weak to rule it
out.
"""
MOST = 7
"""Effects that are fitted at each step, those that the residuals point to most."""
TELLING = 2
"""Effects whose looks are the least likely by chance, which are fitted however little they promise:
what is of second order shows that it is there, but not how much it could take up."""
FEWEST = 4
FAINT = 0.01
"""Effects that are fitted in any case, and the part of the excess of χ² that any other must promise
to take up.
"""
PER_CAUSE = 0.1
"""Prior odds of one more cause."""


@dataclass(frozen=True)
class Pointer:
    """An effect that residuals point to.

    With the values of its parameters from which fits start.
    """

    effect: Effect
    shapes: tuple[dict[str, float], ...]


@dataclass(frozen=True)
class Candidate:
    """A fitted set of causes.

    Its p-value, the score test that speaks most against it, and where its residuals point
    (None: not tested).
    """

    result: FitResult
    p_value: float
    worst: str
    pointers: tuple[Pointer, ...] | None

    @property
    def names(self) -> Names:
        """Names of the causes, sorted."""
        return names_of(self.result)

    @property
    def weight(self) -> float:
        """Logarithm of evidence times prior odds."""
        return self.result.log_evidence + len(self.names) * float(np.log(PER_CAUSE))

    @property
    def viable(self) -> bool:
        """Whether the set explains the data: adequate, with no parameter at a bound."""
        return self.p_value >= (FALSE_ALARMS if self.names else HOPELESS) and not self.result.stuck

    @property
    def least(self) -> float:
        """p-value of data left out below which the set does not explain them.

        One cause is given the benefit of the doubt.
        """
        return HOPELESS if len(self.names) <= 1 else FALSE_ALARMS


def criticise(result: FitResult, library: list[Effect]) -> Candidate:
    """Look at the residuals in every way, the effects that the model lacks included."""
    mine = {effect.name for effect in result.model.effects}
    others = [effect for effect in library if effect.name not in mine]
    found = score_tests(result, others)
    p_value, worst = adequacy(result, found)
    return Candidate(result, p_value, worst, tuple(_pointers(result, found, others)))


def _pointers(result: FitResult, found: list[ScoreTest], library: list[Effect]) -> list[Pointer]:
    """Return the effects that promise most, and those whose tests are least likely by chance."""
    best: dict[str, list[ScoreTest]] = {}
    for test in sorted(found, key=lambda test: -test.gain):
        if test.effect is not None and test.gain > 0:
            best.setdefault(test.name, []).append(test)
    excess = result.chi2 - result.degrees
    promising = {
        name
        for i, name in enumerate(best)
        if i < FEWEST or (i < MOST and best[name][0].gain > FAINT * excess)
    }
    promising.update(
        sorted(best, key=lambda name: min(test.p_value for test in best[name]))[:TELLING]
    )
    return [
        Pointer(e, tuple(test.values for test in unlike(best[e.name])))
        for e in library
        if e.name in promising
    ]


def names_of(result: FitResult, *more: Effect) -> Names:
    """Return the names of a model's effects, and of more, sorted."""
    return tuple(sorted(effect.name for effect in (*result.model.effects, *more)))
