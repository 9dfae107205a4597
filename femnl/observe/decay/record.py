"""A decay as a record of power: what of it was measured, in dB and as a power in units of its own.

Power counts up to a constant factor, and so does the amplitude, which is its square root.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError

Array = NDArray[np.float64]
DB = 10 / np.log(10)
"""Decibels of a factor e of power."""
NEXT = 1.5
"""Time between two points over the usual one up to which nothing is left out between them."""


@dataclass(frozen=True, eq=False)
class PowerRecord:
    """Power (n,) [dB] at times (n,) [s] that rise, without missing points.

    frequency of the mode, bandwidth of the analyser [Hz]: None where not known. phase (n,) [rad],
    between −π and π: None where it was not recorded.
    """

    time: Array
    power: Array
    frequency: float | None
    bandwidth: float | None
    phase: Array | None = None

    @property
    def interval(self) -> float:
        """Typical time between points [s]."""
        return float(np.median(np.diff(self.time)))


def turning(phase: Array, time: Array) -> tuple[float, Array]:
    """Return how fast a phase turns [rad/s], and what else it does (n,) [rad], without jumps of 2π.

    Points that are left out would hide whole turns, were the steady turning not taken off first.
    Args: phase (n,) [rad], up to 2π; time (n,) [s] of its points, two at least.
    """
    step = np.diff(time)
    interval = float(np.median(step))
    near = step < NEXT * interval
    rate = float(np.angle(np.mean(np.exp(1j * np.diff(phase)[near])))) / interval
    return rate, np.asarray(np.unwrap(phase - rate * (time - time[0])))


def decibels(dataset: xr.Dataset) -> Array:
    """Return the power (time,) [dB] of a group of kind `decay`.

    Magnitudes and amplitudes count in dB of 1 V; where they vanish the power is missing (NaN).
    """
    if "power" in dataset:
        return np.asarray(dataset["power"].values, dtype=float)
    if "magnitude" in dataset:
        square = dataset["magnitude"].values.astype(float) ** 2
    else:
        square = dataset["real"].values ** 2 + dataset["imag"].values ** 2
    power = np.full(square.shape, np.nan)
    seen = square > 0
    power[seen] = DB * np.log(square[seen])
    return power


def power_record(dataset: xr.Dataset) -> PowerRecord:
    """Return the record of a group of kind `decay`.

    Raises: MeasurementError for another kind, and for fewer than 16 points.
    """
    kind = dataset.attrs.get("kind")
    if kind != "decay":
        raise MeasurementError(f"kind = {kind!r}: a decay is fitted to a group of kind 'decay'")
    power = decibels(dataset)
    time = np.asarray(dataset["time"].values, dtype=float)
    known = np.isfinite(power)
    if np.count_nonzero(known) < 16:
        raise MeasurementError(
            f"decay: {np.count_nonzero(known)} points with a power; a fit needs at least 16"
        )
    number = {
        key: float(dataset.attrs[key]) for key in ("frequency", "bandwidth") if key in dataset.attrs
    }
    phase = None
    if "real" in dataset and "imag" in dataset:
        phase = np.arctan2(dataset["imag"].values[known], dataset["real"].values[known])
    return PowerRecord(
        time[known], power[known], number.get("frequency"), number.get("bandwidth"), phase
    )
