"""Sweeps stored as a matrix, laid out as a long table with one sweep after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import PARTS, SWEEP_VALUES
from femnl.io.labfiles.named_columns import Columns


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
    part = next(name for name in (*PARTS, *columns) if name in columns and columns[name].ndim > 1)
    shape = columns[part].shape
    if len(shape) != 2:
        raise MeasurementError(f"{where}: columns.{part} has {len(shape)} axes; save a matrix")
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
        return int(np.argmax([_span(frequency, axis) for axis in (0, 1)]))
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


def _span(frequency: NDArray[np.float64], axis: int) -> float:
    """Return how far the frequencies reach along an axis, in the mean [Hz]."""
    known = np.ma.masked_invalid(frequency)
    return float(np.ma.filled((known.max(axis=axis) - known.min(axis=axis)).mean(), 0.0))


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
