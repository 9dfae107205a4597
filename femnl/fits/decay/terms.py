"""The terms that the law of a record needs beside a straight decay."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from femnl.fits.decay.leak import over_a_leak
from femnl.fits.decay.likelihood import STRONGEST_DAMPING
from femnl.fits.decay.periods import at_cycles
from femnl.fits.decay.readout import FEWEST_BEAT_POINTS, beats
from femnl.fits.decay.stretch import Found, fit_stretch, stretch_of, wander
from femnl.observe.decay.law import Term
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
Best = tuple[float, Segmentation, Found]
"""Evidence for the terms of a fit, its segmentation, and the fit."""


def fit_law(record: PowerRecord, segmentation: Segmentation) -> tuple[Segmentation, Found]:
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
    """Return the evidence for a term, and the fits without and with it.

    They are of the same data but for what interrupts the decay without the term.
    """
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
