"""Where sweeps of a table of points begin, how long they last, and which way they go."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.io.labfiles.base import (
    direction_of,
)


def lasts(times: NDArray[Any]) -> float:
    """Return how long a sweep takes [s]: its last point as long as the others."""
    count = len(times)
    return float(abs(times[-1] - times[0])) * count / max(count - 1, 1)


def contradicted(
    frequency: NDArray[np.float64], stated: NDArray[Any], pieces: list[slice], where: str
) -> list[str]:
    """Say where the order of the points is not that of the direction column, which is taken."""
    wrong = 0
    for piece in pieces:
        wrong += direction_of(frequency[piece]) not in (0, stated[piece][0])
    if not wrong:
        return []
    return [f"{where}: {wrong} sweeps have their points in the other order than direction says"]


def cuts_of(frequency: NDArray[np.float64], changes: NDArray[np.bool_], turns: bool) -> list[int]:
    """Return where sweeps begin: where a label changes, or the frequency turns back.

    The latter if `turns`.
    """
    cuts = [0]
    heading = 0.0
    reached = 0
    steps = np.sign(np.nan_to_num(np.diff(frequency)))
    for index, (step, changed) in enumerate(zip(steps, changes, strict=True), start=1):
        if changed or (turns and heading * step < 0):
            cuts.append(index if changed else reached + 1)
            # A step from the turning point itself, measured twice, is already part of the way back.
            heading = step if cuts[-1] < index else 0.0
        elif step:
            heading = step
        if step:
            reached = index
    return [*cuts, frequency.size]
