"""What of a record a diagnosis compares: from the switch-off to the floor, less interruptions."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from femnl.fits.decay.interruptions import (
    LONGEST,
    Interruption,
    interruptions,
    spikes,
    turns,
    without,
)
from femnl.fits.decay.likelihood import STRONGEST_DAMPING
from femnl.fits.decay.readout import beats
from femnl.fits.decay.stretch import Found, fit_stretch, stretch_of
from femnl.fits.decay.terms import DEEP, fit_law
from femnl.observe.decay.phases import (
    THRESHOLDS,
    Segmentation,
    find_decay,
    floor_after,
    logical,
    segment,
)
from femnl.observe.decay.pieces import Piece
from femnl.observe.decay.record import DB, PowerRecord

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
EDGE = 3
EDGE_PART = 0.02
"""Points, and part of the decay, after a switch-off in which the drive may still be in the filter:
so long are the corners of one record in five.
"""
COARSE = (3.0, 6.0)
"""Resolutions [dB] at which beats, and deep ones, look like scatter."""
AHEAD = (0.0, 1 / 40, 1 / 20)
"""Parts of a record whose tops are taken for the power; 0 takes it as it is."""
LONGER = 1.5
"""Times that a decay must be longer where beats count as scatter."""
SAME = 0.8
"""Part of two decays, of all points of either, from which on they are one."""
SHALLOW = (0.5, 2.5)
"""rms [dB] and periods of beats that hide a decay."""
FLATTER = 0.35
STEEPER = 1 + STRONGEST_DAMPING
"""Slopes of a neighbour that still belongs to a decay, in parts of its own: a plateau of the drive
is flatter, a drive that dies in the filter steeper.
"""
FLATTER_AFTER = 0.02
SLOWED = 0.5
"""Slope of one after a decay that has slowed, in parts of its own, and fall of all that is so flat,
in parts of that before: less is a floor that drifts.
"""
LEAST_FALL = 2.0
SPREADS = 3.0
"""dB, and scatters, by which a piece must fall to be no floor."""
PHASED = 13.0
"""dB over the noise from which on a phase can be followed from point to point."""
FLOOR_PART = 0.5
"""Floor that is compared, in parts of the decay: more of it says nothing of the mode."""


@dataclass(frozen=True, eq=False)
class Window:
    """What of a record is compared.

    decay, floor (n,): its points, without interruptions. found: the fit of a law that
    `fit_law` finds, from which noise and start values follow.
    """

    decay: Mask
    floor: Mask
    interruptions: tuple[Interruption, ...]
    found: Found

    @property
    def used(self) -> Mask:
        """Points that are compared."""
        return self.decay | self.floor


def window(record: PowerRecord) -> Window:
    """Return what of a record a diagnosis compares.

    More than what one law is fitted to: the steeper pieces on either side of a straight decay
    belong to it, whatever made them, and where a record beats, the whole of the beats.
    Raises: MeasurementError where nothing falls by more than its scatter explains.
    """
    fine = segment(record.time, record.power)
    chosen, found = fit_law(record, fine)
    # Beats that are followed to the end of a record are all that there is to compare
    whole = found.likelihood.terms == ("pair",) and chosen.decay[-1] == len(chosen.pieces) - 1
    members = chosen if whole else _members(record, fine, chosen)
    if members.pieces is not chosen.pieces:
        # The law of a part of the beats says nothing of the noise
        found = fit_stretch(record, members, stretch_of(record, members))
    count = len(record.time)
    pieces = members.pieces
    decay = np.zeros(count, dtype=bool)
    first = pieces[members.decay[0]].first
    stop = pieces[members.decay[-1]].stop
    falling = _stronger(found, record.time[first:stop]) if whole else stop - first
    # Where the record begins with the decay, nothing was switched off
    corner = EDGE + int(EDGE_PART * falling) if first else 0
    decay[first + corner : stop] = True
    length = np.count_nonzero(decay)
    floor = logical(members, members.floor, count)
    floor[np.flatnonzero(floor)[int(FLOOR_PART * length) :]] = False
    floor &= ~decay
    stopped = list(interruptions(record.power, decay))
    # What comes after the decay tells how large the noise is, recognised as a floor or not
    after = np.zeros(count, dtype=bool)
    after[first : members.recorded] = True
    sharp = spikes(record.power, without(after, stopped))
    stopped += [one for one in sharp if (decay | floor)[one.first : one.stop].any()]
    left = without(decay | floor, stopped)
    noise = found.stretch.reference + DB * found.values[2]
    stopped += turns(record, left & decay & (record.power > noise + PHASED))
    left = without(left, stopped)
    return Window(left & decay, left & floor, tuple(stopped), found)


def _stronger(found: Found, time: Array) -> int:
    """Return at how many times (n,) [s] a mode is stronger than what it beats with.

    It falls to a leak as another one does to its floor.
    """
    named = found.named
    since = time - found.stretch.begin
    partner = named["partner"] * np.exp(0.5 * (named["decay_rate"] - named["partner_rate"]) * since)
    return int(np.count_nonzero(partner < 1))


def _members(record: PowerRecord, fine: Segmentation, chosen: Segmentation) -> Segmentation:
    """Return a segmentation whose decay is all that may belong to it, and the floor after it."""
    if chosen.pieces is fine.pieces:
        members = _grown_after(_grown(chosen.decay, fine, -1, FLATTER), fine)
        floor = floor_after(fine.line, members, fine.pieces)
        if floor:
            # What falls slowly and lies far above the floor is signal, too
            members += tuple(range(members[-1] + 1, floor[0]))
        chosen = Segmentation(fine.pieces, fine.line, members, floor, fine.recorded)
    return beating(record, chosen) or chosen


def _grown_after(members: tuple[int, ...], found: Segmentation) -> tuple[int, ...]:
    """Return members with the falling pieces that they run into, with flat ones that fall far."""
    steady = _grown(members, found, 1, FLATTER)
    slowed = _grown(steady, found, 1, FLATTER_AFTER)
    begin, bend, end = (found.pieces[k] for k in (steady[0], steady[-1], slowed[-1]))
    return slowed if bend.low - end.low > SLOWED * (begin.high - bend.low) else steady


def _grown(
    members: tuple[int, ...], found: Segmentation, step: int, flattest: float
) -> tuple[int, ...]:
    """Return members with the falling pieces that run into them without a jump.

    Interruptions are skipped. Args: step: −1 for those before the decay, +1 for those after it;
    flattest: slope of a piece, in parts of that of its neighbour.
    """
    pieces = found.pieces
    grown = list(members)
    k = grown[0 if step < 0 else -1] + step
    missed = 0.0
    while 0 <= k < len(pieces) and missed <= LONGEST * _duration(found, grown):
        near = pieces[grown[0 if step < 0 else -1]]
        piece = pieces[k]
        ratio = piece.slope / near.slope
        falls = piece.fall > max(LEAST_FALL, SPREADS * piece.spread)
        if falls and flattest < ratio < STEEPER and _meet(piece, near, step):
            grown.insert(0 if step < 0 else len(grown), k)
            missed = 0.0
        else:
            missed += piece.duration
        k += step
    return tuple(grown)


def _meet(piece: Piece, near: Piece, step: int) -> bool:
    """Whether two pieces meet, over what may lie between them, at the mean of their slopes.

    Where a record begins with a piece that falls much faster, a few points of that may count with
    the other. After a plateau they would be those of a drive that dies in the filter.
    """
    first, second = (piece, near) if step < 0 else (near, piece)
    expected = 0.5 * (first.slope + second.slope) * (second.begin - first.end)
    apart = abs(second.high - first.low - expected)
    # The ends of a line through n points are known to 2/√n of their scatter
    known = sum(2 * one.spread / np.sqrt(one.count) for one in (first, second))
    misplaced = 0.0
    if piece.first == 0 and piece.slope < near.slope:
        interval = piece.duration / (piece.stop - 1)
        misplaced = EDGE * interval * abs(first.slope - second.slope)
    return bool(apart < THRESHOLDS.wander + known + misplaced)


def _duration(found: Segmentation, members: Sequence[int]) -> float:
    """Return the time from the begin of the first member to the end of the last [s]."""
    return found.pieces[members[-1]].end - found.pieces[members[0]].begin


def beating(record: PowerRecord, straight: Segmentation) -> Segmentation | None:
    """Return the segmentation of a record whose decay beats, None where it does not.

    A coarse resolution takes beats for scatter about one line, and their tops tell the decay where
    they are deep. That the scatter is beats, one period tells, which makes up most of it. Beats
    that one resolution shows may have a floor at another.
    """
    known = _duration(straight, straight.decay)
    tried = []
    proven = []
    for part, resolution in product(AHEAD, COARSE):
        ahead = max(int(part * len(record.time)), 1)
        found = find_decay(record.time, record.power, resolution, ahead)
        if found is None or _holds_drive(found, straight):
            continue
        tried.append(found)
        longer = _duration(found, found.decay) >= LONGER * known
        # Beats go on where a leak of the drive takes over, and no piece of them is a floor
        ends = bool(found.floor) and not straight.floor
        inside = logical(found, found.decay, len(record.time))
        least = SHALLOW if longer and not part else DEEP
        if (longer or ends) and beats(record.time[inside], record.power[inside], *least):
            proven.append(found)
    if not proven:
        return None
    alike = [found for found in tried if _same(found, proven[0])]
    return next((found for found in [*alike, *proven] if found.floor), proven[0])


def _holds_drive(coarse: Segmentation, fine: Segmentation) -> bool:
    """Whether a decay that a coarse resolution finds holds a plateau that ends by a jump."""
    begin = coarse.pieces[coarse.decay[0]].first
    before = fine.pieces[: fine.decay[0] + 1]
    return any(
        piece.first >= begin
        and max(abs(piece.fall), piece.spread) < THRESHOLDS.wobble
        and not _meet(piece, after, -1)
        for piece, after in pairwise(before)
    )


def _same(one: Segmentation, other: Segmentation) -> bool:
    """Whether two decays have most of their points in common."""
    count = max(found.pieces[-1].stop for found in (one, other))
    first, second = (logical(found, found.decay, count) for found in (one, other))
    return bool(np.count_nonzero(first & second) > SAME * np.count_nonzero(first | second))
