"""What rounded corners do to the modes of a rectangle.

Near a corner a mode is A xy. Where a fillet of radius r cuts the corner, it becomes
A (xy − b r⁴ sin 2ϑ/ρ² − …), which vanishes on the arc, and k² grows by (π/2) b r⁴ A² (Green's
identity on an arc around the corner, ∫ξ² = 1).
"""

import numpy as np

from tests.blind.lab.bench import Array
from tests.blind.lab.film import Membrane

FILLET = 0.0283
"""b of a circular fillet: the harmonic function that is xy on an arc of radius 1, inverted at the
corner, by finite elements of second order; to half a per cent.
"""


def cut(modes: Membrane, radius: float) -> Array:
    """Return what four rounded corners add to k² between the modes of a rectangle, (n, n)."""
    k = np.pi * modes.orders / np.array(modes.inner)
    bend = 2 * k[:, 0] * k[:, 1]
    far = np.where(modes.orders % 2 == 1, 1.0, -1.0)
    found = np.zeros((len(bend), len(bend)))
    for x in (np.ones(len(bend)), far[:, 0]):
        for y in (np.ones(len(bend)), far[:, 1]):
            found += np.outer(bend * x * y, bend * x * y)
    return np.asarray(np.pi / 2 * FILLET * radius**4 / modes.area * found)
