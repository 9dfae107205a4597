"""Which points of sweeps lie beside each other, are held out together, and drawn as left out."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curves
from femnl.observe.residuals import Layout
from femnl.observe.response.sweeps import Sweeps

NEAR = (-4, -3, -2, -1, 1, 2, 3, 4)
"""Steps along a sweep to the points beside one."""
HELD_OUT = 6
"""Parts that a single sweep is held out in."""
STRETCH = 8
"""Neighbouring points that are held out together, fewer where a part has no three of them."""


def along_sweeps(sweeps: Sweeps, known: bool) -> Layout:
    """Return the neighbours of all real, then of all imaginary parts of the points.

    −1 stands for none. Args: known: whether a residual of prior knowledge comes last, which has
    no neighbours.
    """
    n = len(sweeps.frequency)
    place = np.arange(n)
    near = np.stack([_beside(sweeps, step) for step in NEAR], axis=1)
    before = _beside(sweeps, -1)
    last = [-1] if known else []
    return Layout(
        np.concatenate(
            [near, np.where(near < 0, -1, near + n), np.full((len(last), len(NEAR)), -1)]
        ),
        np.concatenate([before, np.where(before < 0, -1, before + n), last]).astype(np.int64),
        np.concatenate([place, place, last]).astype(np.int64),
        np.concatenate([sweeps.column, sweeps.column, last]).astype(np.int64),
    )


def blocks_of(sweeps: Sweeps, known: bool) -> NDArray[np.int64]:
    """Return the block of held-out data of all real, then of all imaginary parts of the points.

    Every sweep is a block, or every part of a single one. Args: known: whether a residual of prior
    knowledge comes last, which is a block of its own.
    """
    block = sweeps.sweep if len(sweeps.spans) > 1 else parts_of_sweep(len(sweeps.frequency))
    last = [block.max() + 1] if known else []
    return np.concatenate([block, block, last]).astype(np.int64)


def parts_of_sweep(n: int) -> NDArray[np.int64]:
    """Return the part (n,) of each point of a sweep: stretches are dealt to the parts in turns.

    So what is held out lies between what is not.
    """
    stretch = max(min(STRETCH, n // (3 * HELD_OUT)), 1)
    turns = max(n // (HELD_OUT * stretch), 1)
    return np.arange(n) * (HELD_OUT * turns) // n % HELD_OUT


def _beside(sweeps: Sweeps, step: int) -> NDArray[np.int64]:
    """Return the points some steps away in the same sweep (n,), −1 where it has none."""
    n = len(sweeps.frequency)
    place = np.arange(n)
    there = np.clip(place + step, 0, n - 1)
    same = (place + step == there) & (sweeps.sweep[there] == sweeps.sweep)
    return np.where(same, there, -1)


def marked(
    comparisons: tuple[Comparison, ...], sweeps: Sweeps, residuals: Sequence[int]
) -> tuple[Comparison, ...]:
    """Return curves, one a sweep, with the points of these residuals marked as left out."""
    points = np.unique(np.asarray(residuals, np.int64) % len(sweeps.frequency))
    found: list[Comparison] = []
    for shown in comparisons:
        if isinstance(shown, Curves):
            pairs = zip(shown.curves, sweeps.spans, strict=True)
            curves = tuple(replace(curve, excluded=_within(points, s)) for curve, s in pairs)
            shown = replace(shown, curves=curves)
        found.append(shown)
    return tuple(found)


def _within(points: NDArray[np.int64], span: slice) -> tuple[int, ...]:
    """Return the places in a sweep of those points that are in it."""
    mine = points[(points >= span.start) & (points < span.stop)] - span.start
    return tuple(int(i) for i in mine)
