"""Sweeps stored as a matrix, laid out as a long table with one sweep after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import PARTS, SWEEP_VALUES
from femnl.io.labfiles.named_columns import Columns

FEWEST_POINTS = 8
"""Points that a sweep has at least."""
EVEN = 10.0
"""Factor by which steps along sweeps must be more even than those from sweep to sweep."""
ROUNDING = 1e-6
"""Of a step, what it may be uneven by as it is rounded."""


def unrolled(
    columns: Columns, where: str, *, side_by_side: bool = False
) -> tuple[Columns, list[str]]:
    """Return a long table of sweeps of which some columns are matrices, and a note on its order.

    A sweep is a row or a column of a matrix. Frequencies of one sweep alone tell by their number.
    A matrix of frequencies tells by the axis along which they span more.

    Args: side_by_side: whether the rows were columns of a table, one a sweep.

    Returns: columns of sweeps × points rows, `sweep` among them, and notes.
    Raises: MeasurementError where sizes disagree, or where rows and columns are alike.
    """
    columns = {name: _without_idle_axes(values) for name, values in columns.items()}
    part = next(name for name in (*PARTS, *columns) if name in columns and columns[name].ndim > 1)
    shape = columns[part].shape
    if len(shape) != 2:
        raise MeasurementError(f"{where}: columns.{part} has {len(shape)} axes; save a matrix")
    columns = {
        name: values.ravel() if 1 in values.shape and values.shape != shape else values
        for name, values in columns.items()
    }
    along = 1 if side_by_side else _axis_of_points(columns, part, where)
    points = shape[along]
    sweeps = shape[1 - along]

    def long(name: str) -> NDArray[np.float64]:
        values = columns[name]
        if values.ndim > 1:
            matrix = values if along == 1 else values.T
        elif values.size in (1, sweeps) and (name in SWEEP_VALUES or values.size != points):
            matrix = np.broadcast_to(values.reshape(-1, 1), (sweeps, points))
        else:
            matrix = np.broadcast_to(values, (sweeps, points))
        return matrix.ravel()

    for name, values in columns.items():
        _refuse_size(name, values, (part, shape), points, sweeps, where)
    table = {name: long(name) for name in columns}
    table["sweep"] = np.repeat(np.arange(sweeps, dtype=float), points)
    one = "column" if along == 0 or side_by_side else "row"
    return table, [f"{where}: {part} has one sweep a {one}, {sweeps} of {points} points"]


def _axis_of_points(columns: Columns, part: str, where: str) -> int:
    """Return the axis of the matrix along which the points of a sweep lie."""
    if "frequency" not in columns:
        raise MeasurementError(f"{where}: columns.frequency is missing; say which column holds it")
    rows, cols = columns[part].shape
    frequency = columns["frequency"]
    if frequency.ndim > 1:
        return _along(columns, part, where)
    fitting = [axis for axis, size in enumerate((rows, cols)) if size == frequency.size]
    if len(fitting) == 2:
        raise MeasurementError(
            f"{where}: columns.{part} is {rows} × {cols} and there are {rows} frequencies, so "
            "whether a sweep is a row or a column is not told; save the frequencies as a matrix too"
        )
    if not fitting:
        raise MeasurementError(
            f"{where}: columns.{part} is {rows} × {cols}, and there are {frequency.size} "
            "frequencies; save one for each row, or one for each column"
        )
    return fitting[0]


def _along(columns: Columns, part: str, where: str) -> int:
    """Return the axis along which the frequencies of a matrix are those of a sweep.

    A column with one value a sweep tells by its length, and an axis that is too short for a sweep.
    Else frequencies must rise or fall along one axis alone, or in even steps along one alone.
    """
    shape = columns[part].shape
    lengths = {values.size for name, values in columns.items() if name in SWEEP_VALUES}
    told = [axis for axis in (0, 1) if shape[1 - axis] in lengths]
    if shape[0] != shape[1] and len(told) == 1:
        return told[0]
    long = [axis for axis in (0, 1) if shape[axis] >= FEWEST_POINTS]
    if len(long) == 1:
        return long[0]
    unevenness = [_unevenness(columns["frequency"], axis) for axis in (0, 1)]
    best = int(np.argmin(unevenness))
    if unevenness[1 - best] > EVEN * max(unevenness[best], ROUNDING):
        return best
    raise MeasurementError(
        f"{where}: frequencies of columns.{part}, {shape[0]} × {shape[1]}, run along its rows as "
        "well as along its columns; give a drive, or a sweep number, of each sweep"
    )


def _unevenness(frequency: NDArray[np.float64], axis: int) -> float:
    """Return how far steps along an axis are from their mean, over that; infinite if they turn."""
    steps = np.ma.masked_invalid(np.diff(frequency, axis=axis))
    mean = steps.mean(axis=axis, keepdims=True)
    if np.ma.any(steps * mean <= 0):
        return float(np.inf)
    return float(np.ma.max(np.abs(steps / mean - 1)))


def _without_idle_axes(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an array of more than two axes without those of length one."""
    return values.squeeze() if values.ndim > 2 else values


def _refuse_size(
    name: str,
    values: NDArray[np.float64],
    told_by: tuple[str, tuple[int, ...]],
    points: int,
    sweeps: int,
    where: str,
) -> None:
    part, shape = told_by
    fits = values.shape == shape if values.ndim > 1 else values.size in (1, sweeps, points)
    if not fits:
        size = "is " + " × ".join(map(str, values.shape))
        has = size if values.ndim > 1 else f"has {values.size} values"
        raise MeasurementError(
            f"{where}: columns.{name} {has} beside columns.{part} of {shape[0]} × {shape[1]}; save "
            f"one value for each of {sweeps} sweeps, or for each point"
        )
