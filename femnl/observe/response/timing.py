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
    it has. step (n_points,): time since the point before it in its sweep, in those that most points
    take. notes for the report.
    """

    time: Array
    recorded: bool
    step: Array
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
        return Timing(sweeps.sweep.astype(float), False, _steps(sweeps, turn), ())
    duration, note = _durations(dataset, times)
    direction = np.array(sweeps.direction)[sweeps.sweep]
    part = np.where(direction == 0, 0.5, (turn + 0.5) / count)
    time = times[rows][sweeps.sweep] + duration[rows][sweeps.sweep] * part
    dwell = duration[rows] / count
    pace = dwell / np.median(dwell) if np.all(dwell > 0) else np.ones(len(rows))
    step = _steps(sweeps, turn) * pace[sweeps.sweep]
    return Timing(time, bool(np.ptp(time) > 0), step, note)


def _steps(sweeps: Sweeps, turn: Index) -> Array:
    """Return how many points lie between each and the one before it in its sweep."""
    step = np.ones(len(turn))
    for span, direction in zip(sweeps.spans, sweeps.direction, strict=True):
        gaps = np.abs(np.diff(turn[span])).astype(float)
        # Points rise in frequency: the first of a sweep down is its last.
        step[span] = np.append(gaps, 1.0) if direction < 0 else np.append(1.0, gaps)
    return step


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
