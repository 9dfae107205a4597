"""How large signals and motion of sweeps are, and where the mode moves strongly."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array
from femnl.observe.response.sweeps import Sweeps

MOVING = 0.3
"""Part of the largest signal from which on the mode moves strongly."""


@dataclass(frozen=True)
class Extent:
    """Of the points that count: the largest signal [V] and the largest motion [m].

    middle, width [Hz]: of the frequencies at which the mode moves strongly, a step at least.
    """

    largest: float
    motion: float
    middle: float
    width: float


def extent(sweeps: Sweeps, responsivity: Array, used: NDArray[np.bool_]) -> Extent:
    """Measure the extent of sweeps.

    Args:
        sweeps: the data.
        responsivity (n_positions,): V/m at each place.
        used (n_points,): the points that count; a glitch is no signal.
    """
    size = np.abs(sweeps.voltage[used])
    largest = float(size.max())
    moving = sweeps.frequency[used][size > MOVING * largest]
    step = float(np.median(np.abs(np.diff(sweeps.frequency))))
    return Extent(
        largest=largest,
        motion=float((size / responsivity[sweeps.position[used]]).max()),
        middle=float(moving.min() + moving.max()) / 2,
        width=max(float(np.ptp(moving)), step),
    )
