"""Where a decay is left by a jump and taken up again: points that are no part of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.observe.decay.record import PowerRecord

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
MAD = 1.4826


@dataclass(frozen=True)
class Interruption:
    """Points first … stop − 1 of a record, which deviate by up to so many scatters."""

    first: int
    stop: int
    sigma: float


def interruptions(power: Array, decay: Mask) -> tuple[Interruption, ...]:
    """Return where a decay is left by a jump and taken up again on the line that it had.

    A bend has no jumps, and a beat comes back without one.
    Args: power (n,) [dB]; decay (n,): the points of one run that is to be looked at.
    """
    inside = np.flatnonzero(decay)
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
        found.append(Interruption(int(inside[k + 1]), int(inside[stop - 1]) + 1, sigma))
        k = stop
    lost = sum(one.stop - one.first for one in found)
    return tuple(found) if lost <= MOST * len(y) else ()


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


def listed(record: PowerRecord, stopped: Sequence[Interruption]) -> tuple[tuple[str, float], ...]:
    """Return where each interruption is, in words, and by how many scatters it deviates."""
    found = []
    for one in stopped:
        begin = record.time[one.first]
        end = record.time[one.stop - 1]
        where = f"power at {begin:.5g} s" if begin == end else f"power, {begin:.5g} … {end:.5g} s"
        found.append((where, one.sigma))
    return tuple(found)
