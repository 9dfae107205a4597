"""The numbers of one quantity of a chip."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from femnl.core.robust import MAD

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
LEAST_SD = 1e-7
"""Least relative standard deviation of a measured number: no counter of a laboratory is better."""

LEAST_SHARE = 1e-5
"""Least standard deviation of a measured number, over what devices of one group differ by.

Less changes nothing, and is rounded away where a device far off has it beside the rest of its film.
"""


@dataclass(frozen=True)
class Values:
    """A quantity of a chip, one entry for each mode of each device.

    y: its logarithm. sd: standard deviation of y by measurement. device: number of the device.
    group: number of the group that shares a mean. place: coordinates on the chip, (n, 2), in any
    unit.
    """

    y: Array
    sd: Array
    device: Integers
    group: Integers
    place: Array

    def bounded(self) -> "Values":
        """Return the values with no error that is lost beside what devices differ by."""
        if not self.y.size:  # of a quantity that no device has
            return self
        return replace(self, sd=np.maximum(self.sd, LEAST_SHARE * self.unit))

    def without(self, devices: frozenset[int]) -> "Values":
        """Return the entries of all other devices."""
        kept = ~np.isin(self.device, [*devices])
        return self.only(kept)

    def only(self, kept: npt.NDArray[Any]) -> "Values":
        """Return some entries."""
        return Values(
            self.y[kept], self.sd[kept], self.device[kept], self.group[kept], self.place[kept]
        )

    @cached_property
    def unit(self) -> float:
        """Robust standard deviation of y within its groups: 1.4826 of the median deviation.

        At least the smallest error of measurement: equal numbers are not known any better.
        """
        off = np.concatenate(
            [self.y[self.group == g] - np.median(self.y[self.group == g]) for g in self.groups]
        )
        large = off[np.abs(off) > 0]
        robust = MAD * float(np.median(np.abs(large))) if large.size else 0.0
        return max(robust, float(self.sd.min()))

    @property
    def groups(self) -> Integers:
        """Numbers of the groups that have entries."""
        return np.unique(self.group)
