"""The places of a map: which lie beside each other, when they were read, where data deviate."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from femnl.core.comparison import Comparison, Images
from femnl.core.numbers import micrometres
from femnl.core.readout import Array
from femnl.observe.map.spots import Grid
from femnl.observe.residuals import Layout

AROUND = 2
"""Steps along each axis to the places around one."""


def around_places(grid: Grid, present: NDArray[np.bool_], column_by_column: bool) -> Layout:
    """Return the neighbours of all real, then of all imaginary parts of a map.

    Args: present (n_harmonics, n_points): where there are data. column_by_column: whether the
    columns are the slow axis.
    """
    index = np.full((len(present), *grid.sizes), -1)
    rows, places = np.nonzero(present)
    up = grid.row[places]
    right = grid.column[places]
    n = len(rows)
    index[rows, up, right] = np.arange(n)
    padded = np.pad(index, ((0, 0), (AROUND, AROUND), (AROUND, AROUND)), constant_values=-1)

    def beside(a: int, b: int) -> NDArray[np.int64]:
        return padded[rows, up + AROUND + a, right + AROUND + b]

    steps = range(-AROUND, AROUND + 1)
    near = np.stack([beside(a, b) for a in steps for b in steps if a or b], axis=1)
    before = beside(-1, 0) if column_by_column else beside(0, -1)
    return Layout(
        np.concatenate([near, np.where(near < 0, -1, near + n)]),
        np.concatenate([before, np.where(before < 0, -1, before + n)]),
        np.tile(np.arange(n), 2),
        np.full(2 * n, -1),
        planar=True,
    )


def marked(
    comparisons: tuple[Comparison, ...],
    grid: Grid,
    present: NDArray[np.bool_],
    residuals: Sequence[int],
) -> tuple[Comparison, ...]:
    """Return maps with the places of these residuals marked; of a single line nothing is marked."""
    rows, places = np.nonzero(present)
    at = np.unique(np.asarray(residuals, np.int64) % len(rows))
    up = grid.row[places[at]]
    right = grid.column[places[at]]
    marks = tuple(zip(rows[at].tolist(), up.tolist(), right.tolist(), strict=True))
    return tuple(
        replace(shown, excluded=marks) if isinstance(shown, Images) else shown
        for shown in comparisons
    )


def follows(time: Array, steps: NDArray[np.int64]) -> float:
    """Return how far times [s] grow with the steps along an axis: the size of their covariance."""
    spread = float(np.std(steps)) or 1.0
    return float(np.abs(np.mean((time - time.mean()) * (steps - steps.mean()))) / spread)


def time_across(grid: Grid, time: Array, column_by_column: bool) -> Array:
    """Return times of the points (n_points,) [s] if the slow axis were the other one."""
    slow, fast = (grid.row, grid.column) if column_by_column else (grid.column, grid.row)
    order = np.argsort(np.lexsort((fast, slow)))
    return np.asarray(time.min() + np.ptp(time) * order / max(len(order) - 1, 1))


def where_most(
    residuals: Array, harmonic: NDArray[np.int64], grid: Grid, present: NDArray[np.bool_]
) -> str:
    """Say which harmonic deviates most, and where on the map."""
    half = len(residuals) // 2
    power = np.zeros(present.shape)
    power[present] = (residuals[:half] ** 2 + residuals[half:] ** 2) / 2
    by_order = power.sum(axis=1) / np.maximum(present.sum(axis=1), 1)
    k = int(np.argmax(by_order))
    p = int(np.argmax(power[k]))
    rms = ", ".join(
        f"{n}: {np.sqrt(value):.2f}σ" for n, value in zip(harmonic, by_order, strict=True)
    )
    x, y = (micrometres(round(float(axis[p]), 6)) for axis in (grid.x, grid.y))
    return (
        f"harmonic {harmonic[k]} deviates most, and most strongly near x = {x} µm, y = {y} µm; rms "
        f"by harmonic {rms}"
    )
