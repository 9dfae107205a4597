"""What is said of the next best explanation where one is named."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from femnl.diagnose.candidate import Candidate
from femnl.diagnose.measure_next import measure_next
from femnl.diagnose.verdict import Judgement


def fitted(names: str, chi2: float, log_evidence: float) -> Candidate:
    """Return a candidate of causes of one letter each, with two base parameters."""
    effects = [SimpleNamespace(name=name) for name in names]
    result = SimpleNamespace(
        model=SimpleNamespace(effects=effects),
        chi2=chi2,
        residuals=np.zeros(20),
        vector=np.zeros(2 + len(names)),
        log_evidence=log_evidence,
    )
    return Candidate(cast(Any, result), 0.5, "", ())


def told(named: Candidate, *others: Candidate) -> str:
    judged = Judgement("explained", named, (), {})
    return measure_next(judged, [*others, named])


BASE = fitted("", 500.0, 0.0)


def test_the_next_best_explanation_does_not_hold_what_is_named() -> None:
    named = fitted("a", 20.0, 220.0)
    found = told(named, BASE, fitted("ab", 19.0, 219.0), fitted("b", 120.0, 180.0))
    assert found.endswith("the next best explanation, b, is 10σ worse on these data")


def test_an_explanation_that_fits_as_well_is_told_by_its_parameters() -> None:
    named = fitted("a", 20.0, 220.0)
    found = told(named, BASE, fitted("bc", 19.0, 210.0))
    assert found.endswith("b + c, takes one more parameter to fit these data as well")
