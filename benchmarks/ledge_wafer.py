"""How the wafer moves where the sides of a membrane pull on it: Cerruti's problem, side by side.

A point force P along the surface of a half-space displaces the surface by (r = |x|)

    u = P (1 + ν)/(π E) [(1 − ν)/r e + ν (e·x) x / r³].

Integrated along a side of finite length it is a closed form, whose logarithm ends at the length of
the side. Four sides that push inwards cancel far away, so the wafer beyond a few sides is at rest.

Source: K. L. Johnson, Contact Mechanics (1985), section 3.6. Limits: a half-space, isotropic.
"""

import numpy as np
from numpy.typing import NDArray

from benchmarks.ledge_section import USUAL, Ledge, Materials

Array = NDArray[np.float64]


def side_force(x: Array, y: Array, half: float, materials: Materials = USUAL) -> Array:
    """Displacement (2, n) of the surface [m²/N] by a unit force per length along x.

    Args: x, y, places (n,) [m], not on the side, which is |y| < half at x = 0.
    """
    young = materials.young[2]
    poisson = materials.poisson[2]
    along = np.zeros((2, len(x)))
    for sign in (1.0, -1.0):
        reach = half + sign * y
        radius = np.hypot(x, reach)
        along[0] += (1 - poisson) * np.arcsinh(reach / np.abs(x)) + poisson * reach / radius
        along[1] -= sign * poisson * x / radius
    return np.asarray(along * (1 + poisson) / np.pi / young)


def square_force(x: Array, y: Array, side: float, materials: Materials = USUAL) -> Array:
    """Displacement (2, n) of the surface [m²/N] by four sides that push inwards, a unit each.

    Args: x, y, places (n,) [m] from the centre, not on a side; side [m].
    """
    total = np.zeros((2, len(x)))
    for cos, sin in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        own = side_force(cos * x + sin * y - side / 2, cos * y - sin * x, side / 2, materials)
        total -= np.stack([cos * own[0] - sin * own[1], sin * own[0] + cos * own[1]])
    return total


def edge_motion(
    ledge: Ledge, places: Array, side: float, oxide: float, spread: float = 1e-6
) -> tuple[Array, Array]:
    """Displacement of the film's edge by a unit pull [m²/N] and by a unit of pressure [m/Pa].

    Each (2, n): inwards, and along the edge towards its middle. On either side of the line, at
    `spread` [m], the wafer moves by its logarithm and by what the sides' lengths make of it. The
    cross-section adds the layers' own part, which holds a few thicknesses away from the corners.

    Args: places along the right-hand side from its middle (n,) [m]; side; oxide, its thickness [m].
    """
    inner = square_force(np.full_like(places, side / 2 - spread), places, side, ledge.materials)
    outer = square_force(np.full_like(places, side / 2 + spread), places, side, ledge.materials)
    mean = (inner + outer) / 2
    wafer = np.stack([-mean[0], -np.sign(places) * mean[1]])
    wafer[0] += ledge.materials.logarithm * np.log(spread)
    own = np.array([[1.0], [0.0]])
    return wafer + own * ledge.pull, oxide * wafer + own * ledge.push
