"""Parameters of several models at once: one set of them, a part of the sets, and beside data."""

from typing import cast

import numpy as np

from femnl.core.effect import ManyValues, Values
from femnl.core.readout import Array


def one_set(values: Values) -> dict[str, Array]:
    """Return the parameters of one model as those of several, (1,) each."""
    return {name: np.array([number]) for name, number in values.items()}


def of_set(values: ManyValues, which: int) -> dict[str, float]:
    """Return the parameters of one of the models."""
    return {name: float(numbers[which]) for name, numbers in values.items()}


def part_of(values: ManyValues, which: slice) -> dict[str, Array]:
    """Return the parameters of some of the models."""
    return {name: numbers[which] for name, numbers in values.items()}


def columns(values: ManyValues) -> Values:
    """Return the parameters of m models as columns (m, 1), to act on data (m, n).

    One that is the same in all of them stays a number. Effects that are `pointwise` take such a
    column for a number, but of what is whole or vanishes.
    """
    found = {
        name: float(numbers[0]) if np.all(numbers == numbers[0]) else numbers[:, None]
        for name, numbers in values.items()
    }
    return cast(Values, found)
