"""When each point of a sweep was measured."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from femnl.core.readout import Array
from femnl.observe.response.sweeps import Index, Sweeps


@dataclass(frozen=True)
class Timing:
    """When the points of sweeps were measured.

    time (n_points,) [s], or the number of the sweep where the file has no time; recorded: whether
    it has. turn (n_points,): the place of a point in the order of acquisition within its sweep,
    from 0. notes for the report.
    """

    time: Array
    recorded: bool
    turn: Index
    notes: tuple[str, ...]


def timing(dataset: xr.Dataset, sweeps: Sweeps) -> Timing:
    """Return when each point was measured.

    Each point of a sweep takes the same time. A sweep up begins at its lowest frequency, a sweep
    down at its highest; all points of a sweep of unknown direction count at its middle.
    """
    count = dataset.sizes["point"]
    turn = _turns(dataset, sweeps)
    rows = np.array([sweeps.row[span.start] for span in sweeps.spans])
    times = np.asarray(dataset["time"].values, float) if "time" in dataset else np.full(1, np.nan)
    if not np.isfinite(times).all():
        return Timing(sweeps.sweep.astype(float), False, turn, ())
    duration, note = _durations(dataset, times)
    direction = np.array(sweeps.direction)[sweeps.sweep]
    part = np.where(direction == 0, 0.5, (turn + 0.5) / count)
    time = times[rows][sweeps.sweep] + duration[rows][sweeps.sweep] * part
    return Timing(time, bool(np.ptp(time) > 0), turn, note)


def _turns(dataset: xr.Dataset, sweeps: Sweeps) -> Index:
    """Return the place of each point in the order of acquisition; missing points count."""
    turn = np.empty(len(sweeps.frequency), np.intp)
    last = dataset.sizes["point"] - 1
    for span, direction in zip(sweeps.spans, sweeps.direction, strict=True):
        column = sweeps.column[span]
        # By rising frequency, whichever way round the file has them.
        risen = column if column[-1] >= column[0] else last - column
        turn[span] = last - risen if direction < 0 else risen
    return turn


def _durations(dataset: xr.Dataset, times: Array) -> tuple[Array, tuple[str, ...]]:
    """Return how long each sweep took [s], and what that rests on."""
    if "duration" in dataset and np.isfinite(dataset["duration"].values).all():
        return np.asarray(dataset["duration"].values, float), ()
    starts = np.unique(times)
    if len(starts) < 2:
        return np.zeros(len(times)), (
            "duration is not in the file: f₀ is taken to rest in a sweep",
        )
    gaps = np.diff(starts)
    # The last sweep takes as long as most others.
    gaps = np.append(gaps, np.median(gaps))
    note = "duration is not in the file: each sweep is taken to last until the next one begins"
    return gaps[np.searchsorted(starts, times)], (note,)
