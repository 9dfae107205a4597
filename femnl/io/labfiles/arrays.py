"""Arrays of NumPy (.npy): columns by name of a structured array, or by number from 1.

Arrays of objects, which could run code, are refused. Complex columns are an `amplitude`.
Source: NumPy Enhancement Proposal 1, "A simple file format for NumPy arrays".
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.labfiles.base import Format, Groups, head, need_size, undamaged
from femnl.io.labfiles.columns import one_table
from femnl.io.labfiles.spec import Spec


def _read(paths: Sequence[Path], spec: Spec) -> tuple[Groups, list[str]]:
    return one_table(paths, spec, "array", _table)


def _table(path: Path) -> dict[str, NDArray[Any]]:
    """Return the columns of the array: the shorter axis of two holds them."""
    need_size(path, "split it")
    # NumPy refuses arrays of objects by itself
    values = undamaged(path, "plain array of numbers", lambda: np.load(path, mmap_mode="r"))
    if values.dtype.names:
        return {name: values[name].reshape(-1) for name in values.dtype.names}
    if values.ndim not in (1, 2) or values.dtype.kind not in "iufc":
        raise MeasurementError(
            f"{path}: an array of {values.ndim} axes of {values.dtype}; save columns of numbers"
        )
    rows = np.atleast_2d(values)
    if rows.shape[0] > rows.shape[1]:
        rows = rows.T
    return {str(number): row for number, row in enumerate(rows, start=1)}


FORMAT = Format("NumPy array", lambda path: head(path).startswith(b"\x93NUMPY"), _read, priority=1)
