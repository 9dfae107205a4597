"""Measured beside predicted, ready to be drawn: what a diagnosis shows of its data."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.arrays import freeze
from femnl.core.readout import Array, ComplexArray


@dataclass(frozen=True)
class Curve:
    """One curve of a `Curves`: x, data, sd (n,); predictions (n_models, n).

    NaN where nothing was measured. excluded: places (indices) of data that no fit has seen.
    """

    name: str
    x: Array
    data: Array
    sd: Array
    predictions: Array
    excluded: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        freeze(self)


@dataclass(frozen=True)
class Curves:
    """Real quantities against an axis: `x` and `y` name the axes, with their SI units.

    ticks: names of the x where it only counts.

    joined: whether neighbouring points belong together. models: the names of the predictions, in
    their order.
    """

    title: str
    x: str
    x_unit: str
    y: str
    y_unit: str
    models: tuple[str, ...]
    curves: tuple[Curve, ...]
    ticks: tuple[str, ...] = ()
    joined: bool = True


@dataclass(frozen=True)
class Images:
    """Harmonics over the film.

    data (n_harmonics, n_y, n_x), predictions (n_models, n_harmonics, n_y, n_x) [V], NaN where not
    measured.

    harmonic (n_harmonics,); x (n_x,), y (n_y,) [m]; noise [V]: sd of each quadrature. excluded:
    harmonic, row and column of data that no fit has seen.
    """

    title: str
    models: tuple[str, ...]
    harmonic: NDArray[np.int64]
    x: Array
    y: Array
    data: ComplexArray
    predictions: ComplexArray
    noise: float
    excluded: tuple[tuple[int, int, int], ...] = ()

    def __post_init__(self) -> None:
        freeze(self)


Comparison = Curves | Images
