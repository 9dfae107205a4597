"""Fits of a stretch of a record, without what interrupts it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.robust import MAD
from femnl.fits.decay.interruptions import spikes, without
from femnl.fits.decay.likelihood import Likelihood, averages_of, start_values
from femnl.observe.decay.law import Array, Term
from femnl.observe.decay.phases import THRESHOLDS, Segmentation, logical
from femnl.observe.decay.record import DB, PowerRecord

MOST_FITS = 3
"""Fits between which interruptions are looked for."""
OUTLIER_SIGMAS = 6.0
"""Standard deviations of a datum that interrupts the decay."""
FLOOR_BELOW = 2.0
"""ln of the weakest datum over the floor to begin with, where a record shows no floor."""
SLOW_PART = 1 / 20
"""Correlation time of noise, in parts of a record, from which on bumps bend it."""
GAIN = 0.1
"""dB by which the gain wanders where it bends a record, however little its points scatter.

Without it, the first decibels, which scatter least, would be followed into their bends.
"""
LEAST_DAMPING = 0.1
"""Nonlinear over linear damping that a fit starts from at least."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """What of a record is fitted.

    begin [s]: of the decay; reference [dB]: its power there; used (n,): points of the record.
    """

    begin: float
    reference: float
    used: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Found:
    """The values of highest probability of a stretch.

    value: ln of the probability; covariance (k, k); correlation: time of the noise [points].
    """

    stretch: Stretch
    likelihood: Likelihood
    values: Array
    value: float
    covariance: Array
    correlation: float

    @property
    def named(self) -> dict[str, float]:
        """The parameters by name, rates and frequencies in SI, powers in ln over the reference."""
        values = self.values * self.likelihood.units
        return dict(zip(self.likelihood.names, values.tolist(), strict=True))


def wander(found: Found) -> float:
    """Return the rms of the power [dB] about a fit where the signal is strong."""
    return float(DB * np.sqrt(2 * np.exp(found.values[3]) / found.likelihood.averages))


def stretch_of(record: PowerRecord, segmentation: Segmentation) -> Stretch:
    """Return the decay and the floor that it ends in."""
    used = logical(segmentation, segmentation.decay + segmentation.floor, len(record.time))
    begin = segmentation.pieces[segmentation.decay[0]].begin
    return Stretch(begin, float(segmentation.line(begin)), used)


def fit_stretch(
    record: PowerRecord,
    segmentation: Segmentation,
    stretch: Stretch,
    term: Term | None = None,
    start: Sequence[float] = (),
) -> Found:
    """Fit a stretch, and again without what interrupts it; start: of a pair's parameters."""
    terms = () if term is None else (term,)
    lost = spikes(record.power, stretch.used)
    stretch = replace(stretch, used=without(stretch.used, lost))
    floor = without(logical(segmentation, segmentation.floor, len(record.time)), lost)
    log_power = (record.power - stretch.reference) / DB
    seen = float(np.log(np.mean(np.exp(log_power[floor])))) if floor.any() else None
    averages = averages_of(log_power[floor])
    for again in reversed(range(MOST_FITS)):
        time = record.time[stretch.used] - stretch.begin
        likelihood = Likelihood(time, log_power[stretch.used], averages, terms)
        lowest = seen if seen is not None else float(likelihood.log_power.min()) - FLOOR_BELOW
        level, rate, extra = _start_of(term, segmentation, stretch, float(time.max()), start)
        values, value = likelihood.fit(start_values(likelihood, level, rate, lowest, extra))
        interrupted = _interruptions(likelihood, values)
        if again == 0 or not interrupted.any():
            break
        used = stretch.used.copy()
        used[np.flatnonzero(used)[interrupted]] = False
        stretch = Stretch(stretch.begin, stretch.reference, used)
    covariance, correlation = likelihood.covariance(values)
    if correlation > SLOW_PART * len(likelihood.time):
        least = float(np.log(0.5 * averages * (GAIN / DB) ** 2))
        likelihood = replace(likelihood, least_wander=least)
        values, value = likelihood.fit(values)
        covariance, correlation = likelihood.covariance(values)
    return Found(stretch, likelihood, values, value, covariance, correlation)


def _start_of(
    term: Term | None,
    segmentation: Segmentation,
    stretch: Stretch,
    duration: float,
    start: Sequence[float],
) -> tuple[float, float, Sequence[float]]:
    """Return level [ln units], rate [1/s] and the term's parameters that a fit starts from.

    Args: duration: of the fitted record with its floor [s], the unit of a term's rates; start: the
    parameters of a pair in SI. Those of other terms follow from the pieces.
    """
    rate = -segmentation.line.slope / DB
    if term == "exit":
        level, rate, bend = _parabola(segmentation, stretch)
        return level, rate, (bend * duration**2,)
    if term == "damping":
        # The rate at the begin is (1 + d) times that of small motion, which the line has.
        first = segmentation.pieces[segmentation.decay[0]]
        level = (first.high - stretch.reference) / DB
        return level, rate, (max(first.slope / segmentation.line.slope - 1, LEAST_DAMPING),)
    if term == "pair":
        ratio, partner_rate, splitting, phase = start
        return 0.0, rate, (ratio, partner_rate * duration, splitting * duration, phase)
    return 0.0, rate, ()


def _parabola(segmentation: Segmentation, stretch: Stretch) -> tuple[float, float, float]:
    """Return level, rate [1/s] and bend [1/s²] of a parabola through the ends of pieces."""
    chosen = [segmentation.pieces[k] for k in segmentation.decay]
    time = np.array([end for piece in chosen for end in (piece.begin, piece.end)])
    power = np.array([end for piece in chosen for end in (piece.high, piece.low)])
    weight = np.repeat([np.sqrt(piece.count) for piece in chosen], 2)
    found = np.polyfit(time - stretch.begin, (power - stretch.reference) / DB, 2, w=weight)
    return float(found[2]), float(max(-found[1], 0.0)), float(max(-found[0], 0.0))


def _interruptions(likelihood: Likelihood, values: Array) -> NDArray[np.bool_]:
    """Return which data (n,) interrupt the decay: far off it, and far above the floor."""
    signal, _ = likelihood.signal(values)
    away = DB * (likelihood.log_power - np.log(signal))
    strong = DB * (np.log(signal) - values[2]) > THRESHOLDS.step
    if np.count_nonzero(strong) < 2:
        return np.zeros(len(away), dtype=bool)
    # Towards the floor there is more noise
    score = np.abs(likelihood.residual(values))
    usual = MAD * float(np.median(score[strong]))
    found = strong & (score > OUTLIER_SIGMAS * usual) & (np.abs(away) > THRESHOLDS.wobble)
    # A decay that is interrupted more often than not is none: the law is wrong instead.
    often = np.count_nonzero(found) >= 0.5 * np.count_nonzero(strong)
    return np.zeros(len(away), dtype=bool) if often else np.asarray(found)
