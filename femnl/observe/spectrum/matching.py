"""Which changed mode each measured one is, by its label or by its rank."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from femnl.core.readout import Array

OWN = 0.75
"""Share of a base mode in a changed mode from which on the change keeps its label."""
CLOSE = 0.01
"""Relative distance in frequency up to which two modes may exchange labels."""
Index = NDArray[np.int64]
ReadOff = Callable[[Index, Index], tuple[Array, Array]]
"""Frequency (m, k) and loss (m, k) that are read off for some measured modes (k,), given the
changed mode (m, k) that each of them is in each of m films. The loss is (m, 0) where none was
measured.
"""


def by_label(
    share: Array, own: Array, frequency: Array, sd: Array, read_off: ReadOff
) -> tuple[Array, Array]:
    """Return frequency and loss (m, n) of each measured mode, which goes to a changed one by label.

    The share of what the label names in each changed mode decides. Pairs that mix are matched as
    they fit best.

    Args: share (m, n, n_changed), of m changed films. own (m, n): frequency of the base mode of
    each measured one [Hz]. frequency and sd (n,) [Hz]: as measured.
    """
    chosen = _assigned(share)
    films = np.arange(len(chosen))[:, None]
    everyone = np.arange(chosen.shape[1])
    mixed = share[films, everyone, chosen] < OWN
    pairs = _exchanging(mixed, own) if mixed.any() else {}
    if not pairs:
        return read_off(everyone, chosen)
    some = sorted({mode for pair in pairs for mode in pair})
    # Every one of them with the label of every other, read off at once
    crossed = np.repeat(some, len(some))
    taken = np.tile(chosen[:, some], (1, len(some)))
    found, loss = read_off(np.append(everyone, crossed), np.append(chosen, taken, axis=1))
    at = len(everyone) + np.arange(len(crossed)).reshape(len(some), len(some))
    square = ((frequency[some, None] - found[:, at]) / sd[some, None]) ** 2
    place = np.tile(everyone, (len(chosen), 1))
    place[:, some] = at[np.arange(len(some)), _partners(square, some, pairs)]
    return found[films, place], loss[films, place] if loss.size else loss


def _assigned(share: Array) -> Index:
    """Return the changed mode (m, n) of each label, none for two, with the largest sum of shares.

    Args: share (m, n, n_changed).
    """
    chosen = np.asarray(share.argmax(axis=2), dtype=np.int64)
    twice = np.any(np.diff(np.sort(chosen, axis=1), axis=1) == 0, axis=1)
    for k in np.flatnonzero(twice):
        _, chosen[k] = linear_sum_assignment(-share[k])
    return chosen


def _exchanging(mixed: NDArray[np.bool_], own: Array) -> dict[tuple[int, int], NDArray[np.bool_]]:
    """Return the pairs of measured modes that may exchange labels, and in which films (m,)."""
    close = np.abs(own[:, :, None] / own[:, None, :] - 1) < CLOSE
    may = close & mixed[:, :, None] & mixed[:, None, :]
    pairs = np.argwhere(np.triu(may.any(axis=0), 1)).tolist()
    return {(i, j): may[:, i, j] for i, j in pairs}


def _partners(
    square: Array, some: list[int], pairs: dict[tuple[int, int], NDArray[np.bool_]]
) -> Index:
    """Return whose changed mode (m, k) each of some modes has after exchanges that lower χ².

    Args: square (m, k, k): χ² of each mode with the changed mode of each.
    """
    films = np.arange(len(square))
    partner = np.tile(np.arange(len(some)), (len(square), 1))
    for (one, other), may in pairs.items():
        i, j = some.index(one), some.index(other)
        a, b = partner[:, i].copy(), partner[:, j].copy()
        as_they_are = square[films, i, a] + square[films, j, b]
        exchanged = may & (square[films, i, b] + square[films, j, a] < as_they_are)
        partner[:, i] = np.where(exchanged, b, a)
        partner[:, j] = np.where(exchanged, a, b)
    return partner


def by_rank(
    changed: Array, order: Index, frequency: Array, read_off: ReadOff
) -> tuple[Array, Array]:
    """Return frequency and loss (m, n) of each measured mode, which goes to a changed one by rank.

    Ranks are those among the measured modes at one moment: two close ones may have been measured
    in the wrong order by a film that drifts.

    Args: changed (m, n_changed): frequency of every changed mode of m films. order (n,): mode of
    the unchanged film that each measured one has the rank of. frequency (n,): as measured.
    """
    everyone = np.arange(len(order))
    first = np.tile(order, (len(changed), 1))
    moved = read_off(everyone, first)[0] / changed[:, order]
    return read_off(everyone, np.sort(order)[ranks(frequency / moved)])


def ranks(frequency: Array) -> Index:
    """Return the rank (…, n) of each frequency along the last axis, from 0."""
    order = np.argsort(frequency, axis=-1, kind="stable")
    return np.argsort(order, axis=-1, kind="stable")
