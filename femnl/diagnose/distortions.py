"""In what ways the equation of a cause may miss what the cause does to the data."""

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array
from femnl.observe.model import MeasurementModel
from femnl.observe.noisy import NoisyModel, without_noise
from femnl.observe.residuals import Layout

GROWING = (1, 2)
"""Powers of what a cause does to a datum with which its equation may be wrong."""
VARYING = 3
"""Highest power of the place along the data with which it may be wrong."""


class Distortions:
    """In what ways an equation may miss the whole of a cause, as columns (n, count).

    One is a part of what the cause does to the data that grows with its size there; others vary
    with the place of the data. For quadratures, some are also turned in phase, as a further pole of
    an amplifier turns them.
    """

    def __init__(self, done: Array, base_model: MeasurementModel) -> None:
        """Take what the cause changes of every residual (n,)."""
        self._done = done
        self._beside = _turned(done, base_model.layout)
        self._places = places_of(base_model)
        size = np.hypot(done, self._beside)
        self._size = size / max(float(size.max()), 1e-300)
        self._turns = bool(np.any(self._beside))
        shapes = len(GROWING) + len(self._places) * VARYING
        self.count = shapes + (1 + shapes if self._turns else 0)

    def of(self, data: slice) -> Array:
        """Return the columns of some of the data."""
        size = self._size[data]
        growing = [size**p for p in GROWING]
        # Products, since powers of arrays take ten times longer
        varying = [np.multiply.accumulate([along[data]] * VARYING) for along in self._places]
        shapes = [*growing, *(power for powers in varying for power in powers)]
        ways = [self._done[data, None] * np.stack(shapes, axis=1)]
        if self._turns:
            turned = np.stack([np.ones_like(size), *shapes], axis=1)
            ways.append(self._beside[data, None] * turned)
        return np.concatenate(ways, axis=1)


def _turned(done: Array, layout: Layout | None) -> Array:
    """Return changes (n,) turned by a quarter of a period, 0 where data are no quadratures."""
    turned = np.zeros_like(done)
    if layout is None:
        return turned
    order = np.argsort(layout.datum, kind="stable")
    number = layout.datum[order]
    first = np.flatnonzero((number[:-1] == number[1:]) & (number[:-1] >= 0))
    real = order[first]
    imaginary = order[first + 1]
    turned[real] = -done[imaginary]
    turned[imaginary] = done[real]
    return turned


def places_of(base_model: MeasurementModel) -> Array:
    """Return where each residual lies in the data, between −1 and 1, in every way (k, n).

    One way is the order of the data: modes by rising frequency, points of a series, sweeps one
    after the other. Another is by their conditions where these recur, such as the frequency within
    sweeps. Data over a plane are placed by all their coordinates, such as the number of a harmonic
    and the place on a film.
    """
    layout = base_model.layout
    if layout is None:
        return np.linspace(-1, 1, len(base_model.blocks))[None]
    if layout.planar:
        return _coordinates(base_model)
    places = [_placed(layout.datum)]
    if layout.repeated.max() >= 1:
        places.append(_placed(layout.repeated))
    return np.stack(places)


def _coordinates(base_model: MeasurementModel) -> Array:
    """Return the coordinates of data over a plane between −1 and 1 (k, n), but for their parts."""
    (data,) = without_noise(base_model).quantities
    axes = [np.asarray(values) for values, _ in data.coordinates.values()]
    numbers = [axis.astype(float) for axis in axes if axis.dtype.kind in "iuf"]
    places = np.stack([2 * (v - v.min()) / (np.ptp(v) or 1.0) - 1 for v in numbers])
    return places[:, base_model.kept] if isinstance(base_model, NoisyModel) else places


def _placed(number: NDArray[np.int64]) -> Array:
    """Return numbers from 0 on as places between −1 and 1; what has no number is in the middle."""
    return np.where(number < 0, 0.0, 2 * number / max(int(number.max()), 1) - 1)
