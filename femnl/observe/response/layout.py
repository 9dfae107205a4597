"""Which points of sweeps lie beside each other, and which of them are drawn as left out."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Curves
from femnl.observe.residuals import Layout
from femnl.observe.response.sweeps import Sweeps

NEAR = (-4, -3, -2, -1, 1, 2, 3, 4)
"""Steps along a sweep to the points beside one."""


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
