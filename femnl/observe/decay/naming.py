"""What the pieces of a record beside its decay are, such as driven, floor, or another try."""

from femnl.core.decay import Phase, PhaseName
from femnl.observe.decay.phases import THRESHOLDS, Line, Segmentation
from femnl.observe.decay.pieces import Array, Piece


def phases(time: Array, segmentation: Segmentation, floor: float) -> tuple[Phase, ...]:
    """Name every part of a record.

    Args: time (n,) [s] of the record; floor: level [dB] that the decay ends in.
    Returns: phases in the order of time, neighbours of one name joined.
    """
    found = segmentation.pieces
    named: list[Phase] = []
    for k, piece in enumerate(found):
        name = _name(k, segmentation, floor)
        end = found[k + 1].begin if k + 1 < len(found) else piece.end
        if named and named[-1].name == name:
            named[-1] = Phase(name, named[-1].begin, end)
        else:
            named.append(Phase(name, piece.begin, end))
    if segmentation.recorded < len(time):
        named.append(Phase("not recorded", float(time[segmentation.recorded]), float(time[-1])))
    return tuple(named)


def _name(k: int, segmentation: Segmentation, floor: float) -> PhaseName:
    """Return what one piece is."""
    piece = segmentation.pieces[k]
    line = segmentation.line
    decay = segmentation.decay
    name: PhaseName = "left out"
    if k in decay:
        name = "decay"
    elif k in segmentation.floor:
        name = "floor"
    elif decay[0] < k < decay[-1]:
        name = "dropout"
    elif k < decay[0] and _rests(k, segmentation, floor):
        name = "before"
    elif k > decay[-1] and piece.middle < segmentation.pieces[decay[-1]].low:
        name = "floor"
    elif _like(piece, line):
        name = "other try"
    elif k < decay[0]:
        name = "driven"
    return name


def _rests(k: int, segmentation: Segmentation, floor: float) -> bool:
    """Whether nothing moves yet in a piece before the decay.

    It is at the floor; or, as the floor of a record that ends early is not known, all of the record
    up to it lies a step below the begin of the decay and does not rise: a mode that rings up does.
    """
    piece = segmentation.pieces[k]
    if max(piece.high, piece.low) < floor + THRESHOLDS.step:
        return True
    top = segmentation.pieces[segmentation.decay[0]].high
    return all(
        max(earlier.high, earlier.low) < top - THRESHOLDS.step
        and -earlier.fall < THRESHOLDS.wander
        and earlier.spread < THRESHOLDS.noisy
        for earlier in segmentation.pieces[: k + 1]
    )


def _like(piece: Piece, line: Line) -> bool:
    """Whether a piece falls at the rate of the decay, far enough and as straight."""
    alike = 1 / THRESHOLDS.alike < piece.slope / line.slope < THRESHOLDS.alike
    return alike and piece.fall > THRESHOLDS.step and piece.spread < THRESHOLDS.wander
