"""The decay of a record: which of its straight pieces are it, and which its floor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from femnl.core.errors import MeasurementError
from femnl.observe.decay.pieces import RESOLUTION, Array, Piece, pieces, points


@dataclass(frozen=True)
class Thresholds:
    """What the choice of the decay rests on.

    wander: the working point of an interferometer moves the power by about this much [dB], so that
    pieces of one decay may lie apart by it. wobble: rms [dB] that a straight decay has at best;
    keeps evidence finite. noisy: a larger spread [dB] is that of noise, 5.6 dB where it is not
    averaged. interruption: longest interruption in parts of the decay that is known already.
    errors: standard deviations of a piece that count as agreement. reproducible: an analyser
    repeats a reading no better than this [dB]; a smoother end of a record was drawn, not measured.
    alike: rates of two decays of one record agree within this factor. step: a piece is driven, or
    another state, where it lies above the floor by this much [dB]. fade: noise that is slower than
    the points fades by a step for a shorter time than this part of what lies above it; in real
    records for 0.2 of it, where a floor lasts 0.8 of it at least.
    """

    wander: float = 1.0
    wobble: float = 0.25
    noisy: float = 2.5
    interruption: float = 0.5
    errors: float = 4.0
    reproducible: float = 0.003
    alike: float = 1.3
    step: float = 10.0
    fade: float = 0.5


THRESHOLDS = Thresholds()
WINDOW = 9
"""Points of the running median of roughness."""
DRAWN = 12
"""Points that must be smooth before the end of a record counts as drawn."""


@dataclass(frozen=True)
class Line:
    """A straight decay: level [dB] at the time middle [s], slope [dB/s] and its error."""

    middle: float
    level: float
    slope: float
    slope_sd: float

    @property
    def evidence(self) -> float:
        """The slope over its standard error."""
        return -self.slope / self.slope_sd

    def __call__(self, time: Array | float) -> Array:
        """Return the power [dB]."""
        return np.asarray(self.level + self.slope * (np.asarray(time) - self.middle))


@dataclass(frozen=True)
class Segmentation:
    """The pieces of a record, and which are the decay.

    line: through the decay; decay, floor: indices of pieces; recorded: points before the end that
    was drawn.
    """

    pieces: tuple[Piece, ...]
    line: Line
    decay: tuple[int, ...]
    floor: tuple[int, ...]
    recorded: int


def recorded_points(power: Array) -> int:
    """Return how many points (n,) [dB] were measured, before an end that was only drawn.

    An analyser that is stopped before its sweep ends fills the rest of the trace with a smooth
    curve. It is smoother than the readings before it and than any analyser reproduces.
    """
    rough = median_filter(np.abs(np.diff(power, 3)), WINDOW, mode="nearest")
    measured = np.flatnonzero(rough >= THRESHOLDS.reproducible)
    if not measured.size:
        return len(power)
    first = int(measured[-1]) + 1
    drawn = len(rough) - first
    usual = float(np.median(rough[:first]))
    if drawn < DRAWN or usual < 3 * THRESHOLDS.reproducible:
        return len(power)
    return first + 2


def segment(time: Array, power: Array) -> Segmentation:
    """Find the decay in a record (n,) [s], [dB].

    Raises: MeasurementError where nothing falls by more than its scatter explains.
    """
    found = find_decay(time, power)
    if found is None:
        raise MeasurementError(
            "decay: the power falls nowhere, so that nothing rings down; record from before the "
            "switch-off on"
        )
    return found


def find_decay(
    time: Array, power: Array, resolution: float = RESOLUTION, ahead: int = 1
) -> Segmentation | None:
    """Find the decay in a record (n,) [s], [dB]; None where nothing falls for certain.

    Every falling piece is a candidate. It grows by pieces that lie on its line. The candidate whose
    slope is known best, by its fall over the scatter about its line, is the decay.

    Through beats, a coarse resolution [dB] looks for straight pieces, and where they are deep, the
    largest of so many points `ahead`: that leaves a switch-off where it is.
    """
    recorded = recorded_points(power)
    power = maximum_filter1d(power, ahead, origin=-(ahead // 2), mode="nearest")
    found = pieces(time[:recorded], power[:recorded], resolution)
    best: tuple[Line, tuple[int, ...]] | None = None
    for core in range(len(found)):
        if found[core].fall <= 0:
            continue
        line, members = _grow(core, found, time, power)
        if best is None or line.evidence > best[0].evidence:
            best = (line, members)
    if best is None or best[0].evidence < THRESHOLDS.errors:
        return None
    line, members = best
    return Segmentation(found, line, members, floor_after(line, members, found), recorded)


def _fit_line(members: Sequence[int], found: Sequence[Piece], time: Array, power: Array) -> Line:
    """Return the line through pieces, each weighted by its own spread.

    Its error counts blocks as independent, with as much scatter about the line as they show, and
    at least that of their pieces: a noisy end makes a line no worse.
    """
    chosen = [found[k] for k in sorted(members)]
    used = points(chosen)
    counts = [piece.stop - piece.first for piece in chosen]
    spread = np.repeat([np.hypot(p.spread, THRESHOLDS.wobble) for p in chosen], counts)
    middle = float(time[used].mean())
    slope, level = np.polyfit(time[used] - middle, power[used], 1, w=1 / spread)
    away = power[used] - level - slope * (time[used] - middle)
    # A piece counts by its blocks, which share its points
    blocks = np.repeat([p.count / (p.stop - p.first) for p in chosen], counts)
    weight = blocks / spread**2
    chi2 = float(np.sum(weight * away**2) / np.sum(blocks))
    centre = np.average(time[used], weights=weight)
    lever = float(np.sum(weight * (time[used] - centre) ** 2))
    error = float(np.sqrt(max(chi2, 1.0) / lever))
    return Line(middle, float(level), float(slope), error)


def _on_line(piece: Piece, line: Line) -> bool:
    """Whether both ends of a piece lie on a line, within what the working point may move."""
    own = piece.spread / np.sqrt(piece.count)
    for time, power in ((piece.begin, piece.high), (piece.end, piece.low)):
        error = float(np.hypot(own, line.slope_sd * (time - line.middle)))
        if abs(power - line(time)) > THRESHOLDS.wander + THRESHOLDS.errors * error:
            return False
    return piece.spread < THRESHOLDS.noisy


def _grow(
    core: int, found: Sequence[Piece], time: Array, power: Array
) -> tuple[Line, tuple[int, ...]]:
    """Add pieces before and after that lie on the line and tell more of it, over interruptions."""
    members = [core]
    line = _fit_line(members, found, time, power)
    for step in (-1, 1):
        missed = 0.0
        k = core + step
        while 0 <= k < len(found):
            longer = _fit_line([*members, k], found, time, power)
            on_line = _on_line(found[k], line)
            if on_line and longer.evidence > line.evidence:
                members.append(k)
                line = longer
                missed = 0.0
            elif not on_line and missed == 0 and _joined(found[k], found[k - step], step):
                # An interruption begins with a jump: this is a bend, which ends the straight part.
                break
            else:
                missed += found[k].duration
            known = found[max(members)].end - found[min(members)].begin
            if missed > THRESHOLDS.interruption * known:
                break
            k += step
    return line, tuple(sorted(members))


def floor_after(line: Line, members: Sequence[int], found: Sequence[Piece]) -> tuple[int, ...]:
    """Return the pieces after members that neither rise out of the decay nor fall as fast.

    They rise out of it above the begin of its last piece, and a step above the end of that.
    However slowly it falls, what lies far above the last of them for a while is signal.
    """
    last = found[members[-1]]
    highest = min(last.high, last.low + THRESHOLDS.step)
    floor = []
    for k in range(members[-1] + 1, len(found)):
        piece = found[k]
        known = THRESHOLDS.errors * piece.spread / np.sqrt(piece.count)
        rises = max(piece.high, piece.low) > highest + known
        if rises or abs(piece.slope) > abs(line.slope):
            break
        floor.append(k)
    return tuple(floor[_above_last(floor, found) :])


def _above_last(floor: Sequence[int], found: Sequence[Piece]) -> int:
    """Return how many pieces come before others that lie a step below them, not briefly.

    Noise that is slower than the points fades as deep, but only for a while.
    """
    if not floor:
        return 0
    most = found[floor[-1]].middle + THRESHOLDS.step
    above = [n for n, k in enumerate(floor) if found[k].middle > most]
    if not above:
        return 0
    count = above[-1] + 1
    turn = found[floor[count]].begin
    before = turn - found[floor[0]].begin
    after = found[floor[-1]].end - turn
    return count if after > THRESHOLDS.fade * before else 0


def steeper_before(found: Segmentation) -> tuple[int, ...]:
    """Return the pieces that run into the decay, steeper the earlier: what nonlinear damping makes.

    Jumps do not belong to it: the drive's feed-through goes at once.
    """
    return tuple(reversed(_run(found, -1, steeper=True)))


def shallower_before(found: Segmentation) -> tuple[int, ...]:
    """Return the pieces that run into the decay, shallower the earlier, as a frequency leaves."""
    return tuple(reversed(_run(found, -1, steeper=False)))


def steeper_after(found: Segmentation) -> tuple[int, ...]:
    """Return the pieces that the decay runs into, steeper the later: a frequency that leaves."""
    return tuple(_run(found, 1, steeper=True))


def _run(found: Segmentation, step: int, *, steeper: bool) -> list[int]:
    """Return falling pieces that continue the decay, each bent the same way from the one before.

    What interrupts them is skipped, as in a straight decay; a steeper run begins at the decay
    itself, as beyond an interruption it may be another one.
    Args: step: −1 for those before the decay, +1 for those after it.
    """
    run: list[int] = []
    near = found.pieces[found.decay[0 if step < 0 else -1]]
    slope = found.line.slope
    known = found.pieces[found.decay[-1]].end - found.pieces[found.decay[0]].begin
    missed = 0.0
    k = (found.decay[0] if step < 0 else found.decay[-1]) + step
    while 0 <= k < len(found.pieces):
        piece = found.pieces[k]
        bent = piece.slope < slope if steeper else slope < piece.slope < 0
        if bent and _joined(piece, near, step):
            run.append(k)
            known += piece.duration
            slope = piece.slope
            near = piece
            missed = 0.0
        else:
            missed += piece.duration
        if missed > THRESHOLDS.interruption * known or (missed > 0 and not run and steeper):
            break
        k += step
    return run


def _joined(piece: Piece, near: Piece, step: int) -> bool:
    """Whether two pieces meet, over what may lie between them, at the mean of their slopes."""
    first, second = (piece, near) if step < 0 else (near, piece)
    expected = 0.5 * (first.slope + second.slope) * (second.begin - first.end)
    apart = abs(second.high - first.low - expected)
    return apart < THRESHOLDS.wander and piece.spread < THRESHOLDS.noisy


def logical(segmentation: Segmentation, which: Sequence[int], count: int) -> NDArray[np.bool_]:
    """Return which of the points (count,) of a record belong to pieces."""
    inside = np.zeros(count, dtype=bool)
    for k in which:
        inside[segmentation.pieces[k].first : segmentation.pieces[k].stop] = True
    return inside
