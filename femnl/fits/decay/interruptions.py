"""Where a record is left by a jump and taken up again: points that are no part of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.robust import MAD
from femnl.observe.decay.record import DB, PowerRecord, turning

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
JUMP = 8.0
"""Scatters of the usual difference of neighbours from which on a point interrupts the decay."""
LEAST_JUMP = 0.1
"""dB of the smallest jump: less is the wobble of a good record."""
LONGEST = 0.1
"""Longest interruption, in parts of the decay: what lasts longer is another state."""
MOST = 0.25
"""Part of the decay that may be interrupted: beyond, the law is wrong instead."""
NEIGHBOURS = 61
"""Differences around one that tell what is usual."""
BESIDE = 12
"""Points on either side of an interruption that tell the line which its edges are held against."""
EDGE = 6
"""Points on either side that a filter may smear a jump over."""
OFF = 5.0
"""Scatters about that line from which on such a point belongs to the interruption."""
SPIKE = 6.0
"""Scatters by which an amplitude is never off its neighbours: that of noise alone is above them by
so many once in 600 000 points.
"""
WEAKEST = 0.25
"""Part of the points, the weakest, whose scatter about the running median tells the noise."""
FOLLOWED = 1.3
"""Noise over that scatter: the median follows a part of noise that is alike in neighbours."""


@dataclass(frozen=True)
class Interruption:
    """Points first … stop − 1 of a record that are no part of it.

    sigma: their largest deviation, in scatters; what: of which quantity, `power` or `phase`.
    """

    first: int
    stop: int
    sigma: float
    what: str = "power"


def interruptions(power: Array, decay: Mask) -> tuple[Interruption, ...]:
    """Return where a decay is left by a jump and taken up again on the line that it had.

    A bend has no jumps, and a beat comes back without one. An analyser's filter smears a jump over
    its neighbours, which belong to it.
    Args: power (n,) [dB]; decay (n,): the points of one run that is to be looked at.
    """
    inside = np.flatnonzero(decay)
    if len(inside) < 2:
        return ()
    y = power[inside]
    difference = np.diff(y)
    usual, scatter = _around(difference)
    limit = np.maximum(JUMP * scatter, LEAST_JUMP)
    jumps = np.abs(difference - usual) > limit
    longest = int(LONGEST * len(y))
    found = []
    k = 0
    while k < len(jumps):
        stop = _taken_up(y, k, usual[k], limit, longest) if jumps[k] else None
        if stop is None:
            k += 1
            continue
        line = y[k] + usual[k] * np.arange(1, stop - k)
        sigma = float(np.max(np.abs(y[k + 1 : stop] - line)) / (limit[k] / JUMP))
        found.append(Interruption(k + 1, stop, sigma))
        k = stop
    return _in_record(_with_edges(y, found), inside)


def spikes(power: Array, points: Mask) -> tuple[Interruption, ...]:
    """Return where a record is off the running median of its neighbours by more than noise ever is.

    The amplitude of noise behind a filter has a Rayleigh distribution, that of a mode in it a
    normal one, or nearly: both end so fast that what is far off is no noise. In noise only what is
    above it can be a spike, as a fade loses no more than the whole amplitude. Neighbours tell how
    much the amplitude scatters, but never less than the noise that the weakest points show.
    Args: power (n,) [dB]; points (n,): those of the decay and of what comes after it.
    Returns: nothing of fewer than two windows of neighbours.
    """
    inside = np.flatnonzero(points)
    if len(inside) < 2 * NEIGHBOURS:
        return ()
    y = power[inside]
    slope, _ = _around(np.diff(y))
    fallen = np.concatenate([[0.0], np.cumsum(slope)])
    line = fallen + _around(y - fallen)[0]
    usual = 10 ** ((line - line.max()) / 20)
    amplitude = 10 ** ((y - line) / 20)
    weak = line <= np.quantile(line, WEAKEST)
    noise = FOLLOWED * MAD * float(np.median(np.abs(amplitude - 1)[weak] * usual[weak]))
    scatter = np.maximum(_around(amplitude)[1], noise / usual)
    off = np.abs(amplitude - 1) / np.maximum(scatter, LEAST_JUMP / (2 * DB * SPIKE))
    found = [
        Interruption(first, stop, float(off[first:stop].max())) for first, stop in runs(off > SPIKE)
    ]
    # At its begin a record may bend, and slow noise is off for longer
    sharp = [
        one
        for one in _with_edges(y, found)
        if one.first >= BESIDE and one.stop - one.first <= 2 * EDGE
    ]
    return _in_record(sharp, inside)


def turns(record: PowerRecord, decay: Mask) -> tuple[Interruption, ...]:
    """Return where the phase of a decay is left by a jump and taken up again.

    Args: decay (n,): points at which the phase stands out of the noise.
    """
    place = np.flatnonzero(decay)
    if record.phase is None or len(place) < NEIGHBOURS:
        return ()
    _, beside = turning(record.phase[place], record.time[place])
    turned = np.zeros(len(record.time))
    # Noise turns a phase as much as it changes ln of the amplitude
    turned[place] = 2 * DB * beside
    return tuple(replace(one, what="phase") for one in interruptions(turned, decay))


def _around(difference: Array) -> tuple[Array, Array]:
    """Return the usual difference of neighbours around each, and its scatter, (n,)."""
    half = NEIGHBOURS // 2
    padded = np.pad(difference, half, mode="reflect") if len(difference) > half else None
    if padded is None:
        middle = float(np.median(difference))
        spread = MAD * float(np.median(np.abs(difference - middle)))
        return np.full(len(difference), middle), np.full(len(difference), spread)
    rows = np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS)
    usual = np.median(rows, axis=1)
    return usual, MAD * np.median(np.abs(rows - usual[:, None]), axis=1)


def _taken_up(y: Array, k: int, slope: float, limit: Array, longest: int) -> int | None:
    """Return the first point after k that is back on the line through k, None where none is.

    Two in a row must be back, or a swing that only crosses the line would pass for it.
    """
    for stop in range(k + 2, min(k + 2 + longest, len(y) - 1)):
        back = [abs(y[j] - y[k] - slope * (j - k)) < 2 * limit[k] for j in (stop, stop + 1)]
        if all(back):
            return stop
    return None


def _with_edges(y: Array, found: Sequence[Interruption]) -> list[Interruption]:
    """Return interruptions with the points on either side that are off as well.

    They are held against a line through what lies beyond them.
    """
    lost = np.zeros(len(y), dtype=bool)
    for one in found:
        lost[one.first : one.stop] = True
    place = np.arange(len(y))
    wider = lost.copy()
    for one in found:
        near = (place >= one.first - EDGE) & (place < one.stop + EDGE)
        beyond = (place >= one.first - EDGE - BESIDE) & (place < one.stop + EDGE + BESIDE)
        beyond &= ~near & ~lost
        if np.count_nonzero(beyond) < BESIDE:
            continue
        line = np.polynomial.Polynomial.fit(place[beyond], y[beyond], 1)
        away = y - line(place)
        scatter = MAD * float(np.median(np.abs(away[beyond])))
        off = np.abs(away) > max(OFF * scatter, LEAST_JUMP)
        first = one.first
        while first > max(one.first - EDGE, 0) and off[first - 1]:
            first -= 1
        stop = one.stop
        while stop < min(one.stop + EDGE, len(y)) and off[stop]:
            stop += 1
        wider[first:stop] = True
    return [
        Interruption(first, stop, max(one.sigma for one in found if first <= one.first < stop))
        for first, stop in runs(wider)
    ]


def runs(mask: Mask) -> list[tuple[int, int]]:
    """Return first and stop of each run of true points."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def _in_record(found: Sequence[Interruption], inside: NDArray[np.intp]) -> tuple[Interruption, ...]:
    """Return interruptions of some points of a record as those of the record, unless too many."""
    if sum(one.stop - one.first for one in found) > MOST * len(inside):
        return ()
    return tuple(
        Interruption(int(inside[one.first]), int(inside[one.stop - 1]) + 1, one.sigma)
        for one in found
    )


def without(points: Mask, stopped: Sequence[Interruption]) -> Mask:
    """Return some points (n,) without those of interruptions."""
    left = points.copy()
    for one in stopped:
        left[one.first : one.stop] = False
    return left


def listed(record: PowerRecord, stopped: Sequence[Interruption]) -> tuple[tuple[str, float], ...]:
    """Return where each interruption is, in words, and by how many scatters it deviates."""
    found = []
    for one in stopped:
        begin = record.time[one.first]
        end = record.time[one.stop - 1]
        when = f" at {begin:.5g} s" if begin == end else f", {begin:.5g} … {end:.5g} s"
        found.append((one.what + when, one.sigma))
    return tuple(found)
