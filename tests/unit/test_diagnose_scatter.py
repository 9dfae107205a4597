"""The evidence of deviations at random, of unknown size: an incomplete gamma function."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.special import gammainc, gammaln

from femnl.diagnose.candidate import Candidate
from femnl.diagnose.rivals import scatter_evidence
from femnl.diagnose.thresholds import THRESHOLDS


def over_the_base(chi2_reduced: float, degrees: int) -> float:
    """Return the evidence of scatter over that of a base model, without prior odds."""
    result = SimpleNamespace(chi2=chi2_reduced * degrees, degrees=degrees)
    base = cast(Candidate, SimpleNamespace(result=result, weight=0.0))
    return scatter_evidence(base) - 2 * float(np.log(THRESHOLDS.odds_per_cause))


@pytest.mark.parametrize("degrees", [10, 1000])
@pytest.mark.parametrize("chi2_reduced", [0.3, 0.8, 1.0, 1.5, 20.0, 1e5])
def test_scatter_is_integrated_over_its_size(chi2_reduced: float, degrees: int) -> None:
    x = chi2_reduced * degrees / 2
    a = degrees / 2
    largest = np.log(THRESHOLDS.largest_scatter)
    inside = gammainc(a, x) - gammainc(a, x * np.exp(-2 * largest))
    expected = x - np.log(2 * largest) - a * np.log(x) + gammaln(a) + np.log(inside)
    assert over_the_base(chi2_reduced, degrees) == pytest.approx(float(expected), abs=1e-3)


@pytest.mark.parametrize("chi2_reduced", [0.3, 0.8])
def test_scatter_below_the_stated_noise_ends_at_it(chi2_reduced: float) -> None:
    degrees = 100_000
    slope = degrees * (1 - chi2_reduced)
    expected = -np.log(slope * np.log(THRESHOLDS.largest_scatter))
    assert over_the_base(chi2_reduced, degrees) == pytest.approx(float(expected), abs=1e-3)
