"""Columns that are no plain numbers: levels in decibel, words for directions, rounded clocks."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import MeasurementError
from femnl.io.measurement import to_si

OHM = 50.0
"""Impedance that a level in dBm is over [Ω]."""
LEVELS: Mapping[str, float] = MappingProxyType(
    {
        "dB": 1.0,
        "dBV": float(np.sqrt(2)),
        "dBmV": float(np.sqrt(2)) * 1e-3,
        "dBuV": float(np.sqrt(2)) * 1e-6,
        "dBµV": float(np.sqrt(2)) * 1e-6,
        "dBm": float(np.sqrt(2 * OHM * 1e-3)),
    }
)
"""Amplitude [V] of 0 dB of each level: of a root mean square of 1 V, or 1 mW over 50 Ω."""
WORDS: Mapping[str, float] = MappingProxyType(
    {
        "up": 1.0,
        "forward": 1.0,
        "fwd": 1.0,
        "+": 1.0,
        "down": -1.0,
        "backward": -1.0,
        "reverse": -1.0,
        "bwd": -1.0,
        "-": -1.0,
    }
)
"""Words for the direction of a sweep."""
ROUNDED = 1.01
"""Steps of the rounding that an even clock may be away from rounded times."""


def is_level(unit: str | None) -> bool:
    """Whether a unit is a level in decibel."""
    return unit in LEVELS


def magnitudes(
    values: NDArray[Any], unit: str | None, heading: str, where: str
) -> NDArray[np.float64]:
    """Return magnitudes as amplitudes [V].

    Args: unit: of the column, one of volts or a level, None for V.
    Raises: MeasurementError for negative magnitudes or a heading in decibel without such a unit,
    and for values that are not numbers.
    """
    numbers = np.asarray(values)
    if numbers.dtype.kind not in "iuf":
        raise MeasurementError(f"{where}: holds text; correct those rows or mark them as NaN")
    if unit is not None and unit in LEVELS:
        return np.asarray(LEVELS[unit] * 10 ** (numbers.astype(float) / 20))
    if unit is not None and unit.lower().startswith("db"):
        raise MeasurementError(
            f"{where}: unit {unit!r} is no level that is known; they are {', '.join(LEVELS)}"
        )
    if unit is None and "db" in heading.lower():
        raise MeasurementError(
            f"{where}: the heading says decibel; give its unit, one of {', '.join(LEVELS)}"
        )
    volts = to_si(numbers, unit or "V", "V", where)
    if np.any(volts < 0):
        raise MeasurementError(
            f"{where}: {volts[volts < 0].flat[0]:g} V is negative; if it is a level, give its "
            f"unit, one of {', '.join(LEVELS)}"
        )
    return volts


def directions(values: NDArray[Any]) -> NDArray[Any]:
    """Return +1 and −1 for words such as up and down; numbers stay as they are."""
    if values.dtype.kind in "iuf":
        return values
    words = [str(value).strip().lower() for value in values.ravel()]
    if not all(word in WORDS for word in words):
        return values
    return np.array([WORDS[word] for word in words]).reshape(values.shape)


def refuse_times_that_go_back(time: NDArray[np.float64], places: Sequence[str]) -> None:
    """Refuse times that rise and go back: two records in one file, or a damaged number.

    Sorted, they would be one record that never was. Times that fall throughout are only reversed.
    Args: time (n,) [s]; places: what a message calls each of them.
    """
    steps = np.diff(time)
    back = np.flatnonzero(steps < 0)
    if back.size and np.any(steps > 0):
        row = int(back[0]) + 1
        raise MeasurementError(
            f"{places[row]}: the time goes back from {time[row - 1]:g} to "
            f"{time[row]:g}; correct the line, or put each record into a file of its own"
        )


def even_clock(time: NDArray[np.float64], where: str) -> tuple[NDArray[np.float64], list[str]]:
    """Return the times of an even clock where rounding made some of them equal.

    Seven digits cannot hold the samples of a long record: neighbours become equal, or jump. All are
    then within the step of the rounding of an even clock.
    """
    steps = np.diff(time)
    rising = steps[steps > 0]
    if len(time) < 3 or not len(rising) or np.all(steps > 0) or np.any(steps < 0):
        return time, []
    step = float(rising.min())
    slope, offset = np.polyfit(np.arange(len(time)), time - time[0], 1)
    clock = time[0] + offset + slope * np.arange(len(time))
    if np.max(np.abs(clock - time)) > ROUNDED * step:
        return time, []
    return clock, [
        f"{where}: times are rounded to {step:.3g} s, so that some are equal; taken as an even "
        f"clock of {slope:.9g} s"
    ]
