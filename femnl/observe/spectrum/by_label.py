"""Which changed mode a measured one goes to by its label."""

from collections.abc import Callable
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from femnl.core.readout import Array
from femnl.core.stages import Lines

OWN = 0.75
"""Share of a base mode in a changed mode from which on the change keeps its label."""
CLOSE = 0.01
"""Relative distance in frequency up to which two modes may exchange labels."""
ReadOff = Callable[[NDArray[np.int64], NDArray[np.int64]], Lines]
"""What is read off for measured modes of the changed modes that they go to."""


def by_label(
    share: Array, own: Array, frequency: Array, sd: Array, read_off: ReadOff
) -> tuple[Array, Array]:
    """Return frequency and loss of each measured mode, which goes to a changed one by label.

    The share of what the label names in each changed mode decides. Pairs that mix are matched as
    they fit best.

    Args: share (n, n_changed). own (n,): frequency of the base mode of each measured one [Hz].
    frequency and sd (n,) [Hz]: as measured. read_off: what is read off for measured modes of
    changed ones.
    """
    _, chosen = linear_sum_assignment(-share)
    everyone = np.arange(len(chosen))
    mixed = np.flatnonzero(share[everyone, chosen] < OWN)
    bare = own[mixed]
    pairs = [
        (i, j) for i, j in combinations(range(len(mixed)), 2) if abs(bare[i] / bare[j] - 1) < CLOSE
    ]
    if not pairs:
        lines = read_off(everyone, chosen)
        return lines.frequency, lines.loss
    # Every mixed mode with the label of every other, read off at once
    crossed = np.repeat(mixed, len(mixed))
    lines = read_off(
        np.append(everyone, crossed), np.append(chosen, np.tile(chosen[mixed], len(mixed)))
    )
    at = len(everyone) + np.arange(len(crossed)).reshape(len(mixed), len(mixed))
    square = ((frequency[mixed, None] - lines.frequency[at]) / sd[mixed, None]) ** 2
    partner = np.arange(len(mixed))
    for i, j in pairs:
        as_they_are = square[i, partner[i]] + square[j, partner[j]]
        if square[i, partner[j]] + square[j, partner[i]] < as_they_are:
            partner[[i, j]] = partner[[j, i]]
    place = everyone.copy()
    place[mixed] = at[np.arange(len(mixed)), partner]
    return lines.frequency[place], lines.loss[place] if len(lines.loss) else lines.loss
