"""What residuals are of: their quantities, their neighbours, and their ranks."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.readout import Array
from femnl.core.tables import Columns


@dataclass(frozen=True, eq=False)
class Ranked:
    """Residuals of values without names, which go to the predictions by rising size.

    (value − prediction)/sd, at these places.

    Approximate where frequencies drift, since the order is that of the values as measured. Data of
    more than EXACT residuals (`criticism`), as a spectrum joined with maps, are judged as if their
    frequencies had names.
    """

    at: NDArray[np.int64]
    value: Array
    sd: Array

    def rank(self, residuals: Array, noise: Array) -> None:
        """Turn noise (m, n_residuals) into the residuals that it gives beside those of the model.

        Close values change places.
        """
        predicted = self.value - residuals[self.at] * self.sd
        # That of the predictions, too, whose pairs may be equal to the last digit
        order = np.argsort(self.value, kind="stable")
        drawn = np.sort(predicted + self.sd * noise[:, self.at], axis=1)
        noise[:, self.at[order]] = (drawn - predicted[order]) / self.sd[order]


@dataclass(frozen=True, eq=False)
class Layout:
    """Which residuals lie beside each other, as noise and glitches see them.

    near (n_residuals, k): those around each one, −1 where there are fewer. previous (n_residuals,):
    the one before on its line of acquisition, −1 where a line begins. datum (n_residuals,): what is
    left out together, as both quadratures of a point; −1 is prior knowledge. repeated
    (n_residuals,): data of the same number were taken under the same conditions in other lines, so
    that deviations of several of them are no chance; −1 where there is nothing of the kind.
    planar: whether data have neighbours across the lines as well. oscillating: whether what a model
    misses varies from one datum to the next, as noise does. shuffled: whether the conditions change
    at random from one datum to the next, so that what a model misses is not alike in neighbours.
    """

    near: NDArray[np.int64]
    previous: NDArray[np.int64]
    datum: NDArray[np.int64]
    repeated: NDArray[np.int64]
    planar: bool = False
    oscillating: bool = False
    shuffled: bool = False


def apart(blocks: NDArray[np.int64]) -> Layout:
    """Return the layout of data without neighbours; block −1 is prior knowledge."""
    place = np.arange(len(blocks))
    none = np.full(len(blocks), -1)
    return Layout(np.empty((len(blocks), 0), np.int64), none, np.where(blocks < 0, -1, place), none)


@dataclass(frozen=True, eq=False)
class Quantity:
    """Data of one quantity: which residuals are theirs, and where each was taken.

    at (n,): their residuals. sd (n,): what one σ of each is, in `unit`. coordinates (n,) by name,
    with their SI units.
    """

    name: str
    unit: str
    at: NDArray[np.int64]
    sd: Array
    coordinates: Columns


def quadratures(name: str, unit: str, sd: Array, coordinates: Columns) -> tuple[Quantity, ...]:
    """Return complex data, whose real parts are the first residuals and imaginary ones the next.

    Args: sd (n,) of each part. coordinates (n,) of the complex data.
    """
    n = len(sd)
    twice = {axis: (np.tile(np.asarray(v), 2), of) for axis, (v, of) in coordinates.items()}
    twice["part"] = (np.repeat(["real", "imaginary"], n), "")
    return (Quantity(name, unit, np.arange(2 * n), np.tile(sd, 2), twice),)
