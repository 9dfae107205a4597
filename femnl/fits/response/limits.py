"""What a fit of a response may change: bounds, and parameters that are held."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femnl.core.errors import ParameterError
from femnl.fits.held import unknown
from femnl.fits.response.result import natural
from femnl.observe.response.sweeps import Array
from femnl.observe.response.theta import Layout

Bounds = Mapping[str, tuple[float, float]]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Limits:
    """Bounds of θ, and which parts of it are free, each (size,)."""

    low: Array
    high: Array
    free: Mask

    @classmethod
    def none(cls, layout: Layout) -> "Limits":
        """Return no limits at all."""
        endless = np.full(layout.size, np.inf)
        return cls(-endless, endless, np.ones(layout.size, bool))


def limits(layout: Layout, bounds: Bounds, fixed: Mapping[str, float], free: Mask) -> Limits:
    """Turn bounds and fixed values by name in SI into limits of θ.

    Args: free (size,): what the model itself fits.
    Raises: ParameterError for a name that the fit does not have, or bounds out of order.
    """
    names = natural(layout, np.zeros(layout.size))[0]
    low = np.full(layout.size, -np.inf)
    high = np.full(layout.size, np.inf)
    free = free.copy()
    # What is held without a value of its own is held at 0
    low[~free] = 0.0
    high[~free] = 0.0
    if layout.damping:
        low[3] = 0.0
    for name, pair in bounds.items():
        if name not in names or not pair[0] < pair[1]:
            raise ParameterError(
                f"bounds[{name!r}] = {pair}: give (low, high) for one of {', '.join(names)}"
            )
        k = names.index(name)
        if free[k]:
            low[k], high[k] = (layout.theta_of(k, value) for value in pair)
    for name, value in fixed.items():
        if name not in names:
            raise ParameterError(unknown(name, names, "a response"))
        k = names.index(name)
        low[k] = high[k] = layout.theta_of(k, value)
        free[k] = False
    return Limits(low, high, free)
