"""Tables of points cut into the sweeps of a response."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from femnl.io.labfiles.base import sweeps_to_response
from femnl.io.labfiles.cuts import contradicted, cuts_of, lasts
from femnl.io.labfiles.named_columns import Columns, need_columns
from femnl.io.labfiles.spec import Spec

if TYPE_CHECKING:
    import xarray as xr

PER_SWEEP = ("drive", "direction", "x", "y", "harmonic")
BESIDE = ("temperature", "pressure", "laser_power", "voltage")
"""What may change a little within a sweep, of which a sweep has the mean."""


def response_of(
    spec: Spec, columns: Columns, own: Mapping[str, str], where: str
) -> tuple[xr.Dataset, list[str]]:
    """Cut a long table of points into the sweeps of a response.

    A sweep begins where a per-sweep column changes or the frequency turns back.

    Args: own: SI units of the columns that are control variables of the file's own.
    Returns: the Dataset and notes. Raises: MeasurementError.
    """
    alone = "magnitude" in columns
    need_columns(columns, ("frequency", *(("magnitude",) if alone else ("real", "imag"))), where)
    frequency = columns["frequency"]
    volts = columns["magnitude"] + 0j if alone else columns["real"] + 1j * columns["imag"]
    keys = [columns[name] for name in ("sweep", *PER_SWEEP) if name in columns]
    changes = (
        np.logical_or.reduce([_changes(values) for values in keys])
        if keys
        else np.zeros(frequency.size - 1, dtype=bool)
    )
    cuts = cuts_of(frequency, changes, turns="sweep" not in columns)
    pieces = [slice(start, stop) for start, stop in pairwise(cuts)]
    labels = {
        name: np.array([columns[name][piece][0] for piece in pieces], dtype=float)
        for name in PER_SWEEP
        if name in columns
    }
    notes: list[str] = []
    for name in (*BESIDE, *own):
        if name in columns:
            labels[name] = np.array([_mean_of(columns[name][piece]) for piece in pieces])
            notes.append(f"{where}: {name} of a sweep is the mean over its points")
    for name in ("time", "duration"):
        if name in columns:
            labels[name] = np.array([columns[name][piece][0] for piece in pieces], dtype=float)
    if "time" in columns and "duration" not in columns:
        lasting = np.array([lasts(columns["time"][piece]) for piece in pieces])
        if np.any(lasting):  # a time of each sweep alone does not tell
            labels["duration"] = lasting
            notes.append(f"{where}: time and duration of a sweep are those of its points")
    dataset, found = sweeps_to_response(
        [(frequency[piece], volts[piece]) for piece in pieces], dict(labels), spec, where, own
    )
    if alone:
        dataset = dataset.drop_vars("imag").rename({"real": "magnitude"})
        notes.append(f"{where}: magnitudes alone; the phase is not known")
    if "direction" in columns:
        notes += contradicted(frequency, columns["direction"], pieces, where)
    return dataset, [*found, *notes]


def _changes(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Return where a column changes from row to row; what is missing (NaN) in both does not."""
    before = values[:-1]
    after = values[1:]
    missing = (before != before) & (after != after)
    return np.asarray((before != after) & ~missing, dtype=bool)


def _mean_of(values: NDArray[Any]) -> float:
    """Return the mean of the values that are known, NaN where none is."""
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else np.nan
