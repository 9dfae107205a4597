"""Bands in words."""

import numpy as np

from femnl.mechanics.bands.solve import ALIKE, Bands


def speeds(bands: Bands, decimals: int) -> str:
    """Return the speed of long waves, or those of the slowest and the fastest."""
    slow, fast = bands.speed
    if fast - slow < ALIKE * fast:
        return f"{fast:.{decimals}f} m/s"
    x, y = bands.axes[1]
    angle = np.degrees(np.arctan2(y, x)) % 180
    return f"{slow:.{decimals}f} to {fast:.{decimals}f} m/s, the fastest {angle:.0f}° from x"
