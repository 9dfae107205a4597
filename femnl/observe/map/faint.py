"""Maps of a faint motion, of which the first harmonic tells a product alone."""

from functools import partial

import numpy as np

from femnl.core.effect import Values
from femnl.observe.model import KnownProduct

STRAIGHT = 1.0
"""Modulation z up to which the first harmonic hardly bends."""
NOTHING = 1e-12
"""Modulation z of a motion that a fit has lost."""
DARK = 0.01
"""|sin θ| below which the second harmonic of a faint motion may be the larger one."""


def contrast_of_faint(base: Values, wavelength: float) -> KnownProduct | None:
    """Return contrast times the rest of the first harmonic, where the motion is faint.

    The second harmonic tells the factors apart, the less the fainter the motion is.

    Args: base parameters; wavelength [m].
    """
    q = 4 * np.pi / wavelength
    faint = 0 < q * base["amplitude"] < STRAIGHT
    if not faint or abs(np.sin(base["theta"])) < DARK:
        return None
    return KnownProduct("contrast", ("amplitude", "theta"), partial(_first_harmonic, q))


def _first_harmonic(q: float, amplitude: float, theta: float) -> tuple[float, tuple[float, float]]:
    """Return z sin θ/(1 + z²/16)², which is 2 J₁(z) sin θ to order z³ and has no further zero.

    The slopes of its logarithm come with it.
    """
    z = max(q * amplitude, NOTHING)
    bent = 1 + z**2 / 16
    factor = float(z * np.sin(theta) / bent**2)
    return factor, (q * (1 / z - z / (4 * bent)), float(1 / np.tan(theta)))
