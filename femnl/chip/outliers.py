"""Devices that deviate from the rest of their chip, found by evidence.

Each device is either of the chip, or an outlier whose quantity is anywhere near: normal about the
prediction of the others, with a standard deviation of WIDE times the unit of the scales, in all its
modes alike or in each for itself. The set of outliers of the highest posterior probability is
sought by steps: one device fewer, one or two more.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import expit, logsumexp

from femnl.chip.hierarchy import Hierarchy, hierarchy
from femnl.chip.values import Values

OUTLIER_PRIOR = 0.05
"""Prior probability that a device is an outlier: one device in twenty is damaged or mixed up."""
WIDE = np.array([5.0, 15.0, 50.0, 200.0])
"""Standard deviations of where outliers lie, each as probable as another.

In what the devices of a design differ by without any variation over the chip (`Values.unit`).
"""
MOST = 0.4
"""Largest part of the devices that can be outliers; beyond it there is no chip to deviate from."""


@dataclass(frozen=True)
class Cleaned:
    """The model of the devices that are alike, and the probability of each other one.

    outliers: number of each outlier, with the probability that it is one.
    """

    model: Hierarchy
    outliers: dict[int, float]


def clean(values: Values) -> Cleaned:
    """Return the model of a quantity without its outliers."""
    unit = values.unit
    devices = frozenset(int(d) for d in np.unique(values.device))
    most = int(MOST * len(devices))
    out: frozenset[int] = frozenset()
    known: dict[frozenset[int], float] = {}

    def log_posterior(some: frozenset[int]) -> float:
        if some not in known:
            known[some] = _log_posterior(values, some, len(devices), unit)
        return known[some]

    while True:
        model = hierarchy(values.without(out), unit)
        steps = [s for s in _steps(out, model) if len(s) <= most]
        best = max(steps, key=log_posterior, default=out)
        if not log_posterior(best) > log_posterior(out):
            break
        out = best
    probabilities = {
        d: float(expit(log_posterior(out) - log_posterior(out - {d}))) for d in sorted(out)
    }
    return Cleaned(model, probabilities)


CANDIDATES = 4
"""Devices that are tried as outliers in each step, those furthest from their prediction."""


def _steps(out: frozenset[int], model: Hierarchy) -> Iterator[frozenset[int]]:
    """Yield the sets to try next: one outlier fewer, or one or two of the furthest devices more.

    Two, as each of two outliers can hide the other. model: of the devices that are not in the set.
    """
    yield from (out - {d} for d in sorted(out))
    rest = model.values
    predicted = model.left_out
    off = np.abs(rest.y - predicted.mean) / predicted.sd
    far = {int(d): float(off[rest.device == d].max()) for d in np.unique(rest.device)}
    furthest = sorted(far, key=lambda d: -far[d])[:CANDIDATES]
    yield from (out | {d} for d in furthest)
    yield from (out | {*pair} for pair in combinations(furthest, 2))


def _log_posterior(values: Values, out: frozenset[int], devices: int, unit: float) -> float:
    """Return the log probability of all data with these outliers, up to a constant."""
    model = hierarchy(values.without(out), unit)
    found = (
        model.log_evidence
        + (devices - len(out)) * np.log(1 - OUTLIER_PRIOR)
        + len(out) * np.log(OUTLIER_PRIOR)
    )
    for d in out:
        own = values.only(values.device == d)
        found += log_anywhere(model, own)
    return float(found)


def log_anywhere(model: Hierarchy, own: Values) -> float:
    """Return the log density of an outlier's entries, which may lie anywhere near.

    A device of another film deviates alike in all modes, a particle shifts each mode for itself:
    either is as probable.
    """
    predicted = model.predict(own)
    together = [model.log_density(own, wide * model.unit) for wide in WIDE]
    each = [predicted.log_density(own.y, wide * model.unit).sum() for wide in WIDE]
    return float(logsumexp([*together, *each]) - np.log(2 * len(WIDE)))
