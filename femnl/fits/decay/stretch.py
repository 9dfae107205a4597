"""The stretch of a record that is fitted, and the law that it needs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femnl.fits.decay.interruptions import spikes, without
from femnl.fits.decay.leak import over_a_leak
from femnl.fits.decay.likelihood import STRONGEST_DAMPING, Likelihood, averages_of, start_values
from femnl.fits.decay.periods import at_cycles
from femnl.fits.decay.readout import beats
from femnl.observe.decay.law import Array, Term
from femnl.observe.decay.phases import (
    THRESHOLDS,
    Segmentation,
    find_decay,
    logical,
    shallower_before,
    steeper_after,
    steeper_before,
)
from femnl.observe.decay.record import DB, PowerRecord

MOST_FITS = 3
"""Fits between which interruptions are looked for."""
OUTLIER_SIGMAS = 6.0
"""Standard deviations of a datum that interrupts the decay."""
MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""
FLOOR_BELOW = 2.0
"""ln of the weakest datum over the floor to begin with, where a record shows no floor."""
LEAST_EVIDENCE = 7.0
"""ln of the odds from which a term is taken: 1000 to 1."""
RATE_SIGMAS = 3.0
"""Standard errors from zero at which a decay rate counts as seen beside a term."""
BEAT_RESOLUTION = 3.0
"""Resolution [dB] at which beats look like scatter about one line."""
TOPS = (0.0, 1 / 40)
"""Parts of a record whose tops are taken for the power, which deep beats need; 0: as it is."""
DEEP = (2.0, 4.0)
"""rms [dB] and periods of such beats; less may be noise whose tops look like a decay."""
FEWEST_BEATS = 2.0
"""Periods from which beats are told from a bump."""
FEWEST_BEAT_POINTS = 24
"""Points of a decay in which beats can be seen."""
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


def choose(record: PowerRecord, segmentation: Segmentation) -> tuple[Segmentation, Found]:
    """Fit a straight decay, and with the terms that its record needs.

    Nonlinear damping is tried on the decay and the steeper pieces before it, an exit from the
    filter on the decay and the steeper pieces after it, a pair on what is one decay where beats are
    taken for scatter, and on all that follows the switch-off where that beats with a leak. Each is
    compared with a straight decay of the same data.
    """
    straight = fit_stretch(record, segmentation, stretch_of(record, segmentation))
    before = steeper_before(segmentation)
    shallow = shallower_before(segmentation)
    after = steeper_after(segmentation)
    tried: list[tuple[Term, Segmentation]] = []
    if before or wander(straight) > THRESHOLDS.wobble:
        tried.append(("damping", replace(segmentation, decay=before + segmentation.decay)))
    if shallow or after:
        whole = shallow + segmentation.decay + after
        floor = () if after else segmentation.floor
        tried.append(("exit", replace(segmentation, decay=whole, floor=floor)))
    best = (LEAST_EVIDENCE, segmentation, straight)
    for term, longer in tried:
        best = _better(record, longer, term, (), best)
    for part in TOPS:
        ahead = max(int(part * len(record.time)), 1)
        coarse = find_decay(record.time, record.power, BEAT_RESOLUTION, ahead)
        if coarse is None or not _hides_beats(segmentation, straight, coarse):
            continue
        inside = logical(coarse, coarse.decay, len(record.time))
        if ahead == 1 or beats(record.time[inside], record.power[inside], *DEEP):
            start = _beat(record, coarse)
            if start is not None:
                best = _better(record, coarse, "pair", start, best)
    leaking = over_a_leak(record, segmentation)
    if leaking is not None:
        with_leak, leak = leaking
        evidence, _, bent = _compared(record, with_leak, "pair", leak.as_pair)
        # Without the leak, a fit takes its beats for a floor, and wanders about nothing
        if evidence > best[0] and _rings_down(bent) and wander(bent) < THRESHOLDS.wander:
            best = (evidence, with_leak, bent)
    return best[1:]


def _hides_beats(fine: Segmentation, straight: Found, coarse: Segmentation) -> bool:
    """Whether a straight decay is worse than it should be, or only a part of a longer fall."""
    found = [
        pieces.pieces[pieces.decay[-1]].end - pieces.pieces[pieces.decay[0]].begin
        for pieces in (fine, coarse)
    ]
    return wander(straight) > THRESHOLDS.wobble or found[0] < 0.5 * found[1]


Best = tuple[float, Segmentation, Found]
"""Evidence for the terms of a fit, its segmentation, and the fit."""


def _better(
    record: PowerRecord, pieces: Segmentation, term: Term, start: Sequence[float], best: Best
) -> Best:
    """Return a fit with one term where its evidence is better, else the best so far."""
    evidence, plain, bent = _compared(record, pieces, term, start)
    if evidence > best[0] and _shows(plain, bent):
        return evidence, pieces, bent
    return best


def _compared(
    record: PowerRecord, pieces: Segmentation, term: Term, start: Sequence[float]
) -> tuple[float, Found, Found]:
    """Return the evidence for a term, and the fits of the same data without and with it."""
    bent = fit_stretch(record, pieces, stretch_of(record, pieces), term, start)
    plain = fit_stretch(record, pieces, bent.stretch)
    return _evidence(plain, bent), plain, bent


def _beat(record: PowerRecord, pieces: Segmentation) -> tuple[float, ...] | None:
    """Return the start of a pair, in SI, from the strongest period of a decay about its line.

    None where it is weaker than straight decays wobble, or has not come FEWEST_BEATS times.
    """
    inside = logical(pieces, pieces.decay, len(record.time))
    time = record.time[inside]
    count = len(time)
    if count < FEWEST_BEAT_POINTS:
        return None
    time = time - time[0]
    duration = float(time[-1])
    away = (record.power[inside] - pieces.line(record.time[inside])) / DB
    cycles = np.arange(FEWEST_BEATS, count / 4, 0.5)
    amplitude = 2 * at_cycles(time, away - away.mean(), cycles) / count
    best = int(np.argmax(np.abs(amplitude)))
    # ln |1 + r e^{iα}|² begins with 2 r cos α.
    ratio = float(np.abs(amplitude[best])) / 2
    if 2 * DB * ratio < 2 * THRESHOLDS.wobble:
        return None
    rate = -pieces.line.slope / DB
    splitting = float(cycles[best]) / duration
    return min(ratio, 0.9), rate, splitting, float(np.angle(amplitude[best]))


def _evidence(plain: Found, bent: Found) -> float:
    """Return ln of the odds of a law with more parameters, by what correlated data tell."""
    count = len(bent.likelihood.time) / bent.correlation
    free = len(bent.values) - len(plain.values)
    gain = (bent.value - plain.value) / bent.correlation
    return float(gain - 0.5 * free * np.log(max(count, 1.0)))


def _shows(plain: Found, bent: Found) -> bool:
    """Whether a bend is larger than straight decays wobble, and is taken up for the most part.

    A term must also leave a decay of its own to the mode.
    """
    if bent.likelihood.terms == ("damping",) and bent.values[-1] > 0.99 * STRONGEST_DAMPING:
        return False
    return _rings_down(bent) and THRESHOLDS.wobble < wander(plain) > 2 * wander(bent)


def _rings_down(found: Found) -> bool:
    """Whether the rate of a decay is seen."""
    return bool(found.values[1] > RATE_SIGMAS * np.sqrt(found.covariance[1, 1]))


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
    usual = MAD * float(np.median(np.abs(away[strong])))
    limit = max(OUTLIER_SIGMAS * usual, THRESHOLDS.wobble)
    found = strong & (np.abs(away) > limit)
    # A decay that is interrupted more often than not is none: the law is wrong instead.
    often = np.count_nonzero(found) >= 0.5 * np.count_nonzero(strong)
    return np.zeros(len(away), dtype=bool) if often else np.asarray(found)
